// The registers that a PLC writes: commands (exactly once), heartbeat, acknowledgement of results, staged recipe.
//
// Sans-I/O: time comes from the injected clock, actions go to the handler. Loop thread only.
//
// A command is one write of COMMAND from its token on. Tokens belong to a client: the address of its connections. A
// token that this client has used in this boot is not executed again: its reply is shown again for kReplyKept, then the
// repeat is refused (token_reused). So a sender that does not know whether its write arrived repeats it, on any
// connection, until REPLY shows its token; and a sender whose counter began again is never told that an old command was
// completed. `boot` prevents repeating a command to a station that was restarted meanwhile. Stop, abort and halt act
// always, whatever their token and boot. A repeat of them finds nothing to do and shows the first reply. While a
// command executes, any other is answered with exception 06 and not remembered; exceptions are stop, abort and halt,
// and a teach does not block others.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/hal/clock.h"
#include "firmware/modbus/dispatcher.h"
#include "firmware/plc/used_tokens.h"
#include "firmware/registers/register_values.h"

namespace hord::firmware {

// Outcome of a command: completed, failed, or executing; after executing, PlcInterface::finish() follows.
struct CommandOutcome {
    CommandState state = CommandState::completed;
    CommandError error = CommandError::none;
    std::uint32_t result = 0;
    RemarkText remarks = {};  // for people
};

// Executes what the PLC writes. Called on the loop's thread during a Modbus request: must not block.
class PlcHandler {
  public:
    virtual ~PlcHandler() = default;
    // Every command, once a token; stop, abort and halt each time they are written; unknown codes, too. commit_recipe
    // only with the right checksum, while the station does not execute; it and use_recipe only with an argument.
    virtual CommandOutcome on_command(const modbus::Origin& origin, const CommandRequest& request) = 0;
    // The PLC acknowledges the results up to `sequence`. none: accepted; busy: not stored yet, repeat; device_failure:
    // they cannot be stored now.
    virtual modbus::Exception on_acknowledged(const modbus::Origin& origin, std::uint32_t sequence) = 0;
    virtual void on_plc_lost(PlcPolicy policy) = 0;
    virtual void on_plc_back() = 0;
};

struct PlcOptions {
    PlcPolicy policy = PlcPolicy::none;
    hal::Duration timeout = std::chrono::seconds(2);
    std::uint32_t boot_id = 0;
};

// The station's state that a write depends on.
struct StationNow {
    State state = State::preoperational;
    std::uint32_t newest_sequence = 0;
};

class PlcInterface {
  public:
    // The reply of a completed or failed command is shown again to a repeat for this long.
    static constexpr hal::Duration kReplyKept = std::chrono::minutes(1);
    // Clients beyond this number share the tokens of the last one.
    static constexpr std::size_t kMaxClients = 16;

    PlcInterface(const hal::Clock& clock, PlcHandler& handler, PlcOptions options);

    // Writes whole writable rows, or nothing. Exception 02: another register; 03: half a value, "not available" where
    // the row is not nullable, or an impossible value; 06: a command is executing. An acknowledgement is refused with
    // 06 until its results are stored, with 04 while they cannot be; a heartbeat in the same write counts.
    modbus::Exception write(const modbus::Origin& origin, const StationNow& now, std::uint16_t address,
                            std::span<const std::uint16_t> values);

    // Outcome or progress (executing, with a result) of an executing command. Not to be called inside its on_command().
    // No effect for a request that is not executing.
    void finish(const CommandRequest& request, const CommandOutcome& outcome);

    // Results up to `newest_sequence` exist. Counts those overwritten in the ring before they were acknowledged.
    void note_results(std::uint32_t newest_sequence);

    // Calls on_plc_lost() once when the heartbeat has not changed for longer than the timeout. Before the first
    // heartbeat the PLC cannot be lost. Call it several times within the timeout.
    void check_plc_heartbeat();

    void set_timeout(hal::Duration timeout) { options_.timeout = timeout; }

    // Sets the staged values, to those of the recipe in use when it changes.
    void stage(const StagedRecipe& recipe) { staged_words_ = std::bit_cast<StagedWords>(recipe); }

    [[nodiscard]] PlcView view() const;

  private:
    struct Client {
        std::string address;
        UsedTokens used;
    };
    struct Remembered {
        const Client* client = nullptr;
        CommandRequest request;
        CommandReply reply;
        hal::TimePoint replied_at{};
        void set(const CommandOutcome& outcome, hal::TimePoint now);
        [[nodiscard]] bool executing() const { return reply.state == CommandState::executing; }
    };
    modbus::Exception write_command(const modbus::Origin& origin, const StationNow& now,
                                    std::span<const std::uint16_t> values);
    modbus::Exception write_plc(const modbus::Origin& origin, const StationNow& now, std::uint16_t address,
                                std::span<const std::uint16_t> values);
    [[nodiscard]] CommandOutcome execute(const modbus::Origin& origin, const StationNow& now,
                                         const CommandRequest& request, bool has_argument);
    [[nodiscard]] Client& client_at(std::string_view peer);
    [[nodiscard]] const Remembered* kept_reply(const Client& client, const CommandRequest& request) const;
    Remembered& remember(Client& client, const CommandRequest& request);

    const hal::Clock& clock_;
    PlcHandler& handler_;
    PlcOptions options_;

    std::vector<Client> clients_;           // never moves: its capacity is kMaxClients
    std::array<Remembered, 256> memory_{};  // a ring of the last commands; token 0: empty
    std::size_t next_ = 0;
    Remembered shown_{};
    std::uint32_t commands_done_ = 0;

    std::uint16_t heartbeat_ = 0;
    std::optional<hal::TimePoint> heartbeat_at_;
    bool lost_ = false;

    std::uint32_t acknowledged_ = 0, overruns_ = 0, counted_until_ = 0;
    bool acknowledges_ = false;
    StagedWords staged_words_ = std::bit_cast<StagedWords>(StagedRecipe{});
};

}  // namespace hord::firmware
