// The PLC's side of the station: commands exactly once, heartbeat, acknowledgement of results, staged recipe.
//
// Sans-I/O: time comes from the injected clock, what is to be done goes to the handler. Loop thread only.
//
// A command is one write of COMMAND from its token on. A token that was seen before does nothing again: the
// reply that it had is shown once more. So a sender that does not know whether its write arrived writes it
// again, on any connection, until REPLY shows its token. The last 256 tokens are remembered; `boot` guards
// against repeating a command to a station that was restarted meanwhile. While a command is executing, any
// other but stop, abort and halt is answered with exception 06 and not remembered; a teach, which takes as long as
// its parts, goes on beside others.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "drivers/hal/clock.h"
#include "firmware/modbus/dispatcher.h"
#include "firmware/registers/register_values.h"

namespace hord::firmware {

// What a command came to: completed, failed with an error, or executing, and then PlcInterface::finish() follows.
struct CommandOutcome {
    CommandState state = CommandState::completed;
    CommandError error = CommandError::none;
    std::uint32_t result = 0;
};

// What the station does about it. Called on the loop's thread, in the middle of a Modbus request: must not
// block.
class PlcHandler {
  public:
    virtual ~PlcHandler() = default;
    // Never commit_recipe, never the same token twice. Unknown codes come, too.
    virtual CommandOutcome on_command(const modbus::Origin& origin, const CommandRequest& request) = 0;
    // commit_recipe with the right checksum, while the station does not execute.
    virtual CommandOutcome on_recipe(const modbus::Origin& origin, const CommandRequest& request,
                                     const StagedRecipe& staged) = 0;
    // The PLC wants to take the results up to `sequence`; they are its own once the answer is none. busy: in a moment,
    // ask again; device_failure: they cannot be kept now.
    virtual modbus::Exception on_acknowledged(const modbus::Origin& origin, std::uint32_t sequence) = 0;
    virtual void on_plc_lost(PlcPolicy policy) = 0;
    virtual void on_plc_back() = 0;
};

struct PlcOptions {
    PlcPolicy policy = PlcPolicy::none;
    hal::Duration timeout = std::chrono::seconds(2);
    std::uint32_t boot_id = 0;
};

// What the desk must know of the station to decide.
struct StationNow {
    State state = State::preoperational;
    std::uint32_t newest_sequence = 0;
};

class PlcInterface {
  public:
    PlcInterface(const hal::Clock& clock, PlcHandler& handler, PlcOptions options);

    // Writes whole rows that the map calls writable, or nothing: 02 for any other register, 03 for half a
    // value, a value that means "not available", or one that cannot be; 06 while a command is executing. An
    // acknowledgement is refused with 06 until what it takes is stored, with 04 while it cannot be; a heartbeat in
    // the same write has counted.
    modbus::Exception write(const modbus::Origin& origin, const StationNow& now, std::uint16_t address,
                            std::span<const std::uint16_t> values);

    // The outcome of a command that was executing, or how far it has come (executing, with a result). Not from inside
    // the on_command() that began it. No effect for a token that is not executing.
    void finish(std::uint32_t token, const CommandOutcome& outcome);

    // Results up to `newest_sequence` exist: counts those that the ring lost before they were acknowledged.
    void note_results(std::uint32_t newest_sequence);

    // Tells the handler once when the heartbeat has stopped for longer than the timeout. Before the first
    // heartbeat the PLC cannot be lost. To be called several times within the timeout.
    void check_heartbeat();

    void set_timeout(hal::Duration timeout) { options_.timeout = timeout; }

    // The staged values are these from now on: those of the recipe in use, when it changes.
    void stage(const StagedRecipe& recipe);

    [[nodiscard]] PlcView view() const;

  private:
    struct Remembered {
        CommandRequest request;
        CommandReply reply;
    };
    modbus::Exception take_command(const modbus::Origin& origin, const StationNow& now,
                                   std::span<const std::uint16_t> values);
    modbus::Exception take_plc(const modbus::Origin& origin, const StationNow& now, std::uint16_t address,
                               std::span<const std::uint16_t> values);
    [[nodiscard]] CommandOutcome execute(const modbus::Origin& origin, const StationNow& now,
                                         const CommandRequest& request);
    [[nodiscard]] Remembered* find(std::uint32_t token);
    [[nodiscard]] StagedRecipe staged() const;

    const hal::Clock& clock_;
    PlcHandler& handler_;
    PlcOptions options_;

    std::array<Remembered, 256> memory_{};  // a ring; token 0: empty
    std::size_t next_ = 0;
    Remembered shown_{};
    std::uint32_t commands_done_ = 0;

    std::uint16_t heartbeat_ = 0;
    std::optional<hal::TimePoint> heartbeat_at_;
    bool lost_ = false;

    std::uint32_t acknowledged_ = 0, overruns_ = 0, counted_until_ = 0;
    bool acknowledges_ = false;
    std::array<std::uint16_t, 8> staged_words_{};  // registers 8202 to 8209
};

}  // namespace hord::firmware
