// The PLC and SCADA at the line: what they read must be what the station reported, what they command is done once.
//
// PlcEndpoint is the station's half: registers and desk, put up as the service does it, one set a process. PlcSimulator
// is the other half: a PLC that beats, acknowledges, brings a station that was stopped back to work, and sometimes
// misbehaves. It speaks in whole register requests; a request may be lost, and so may its answer, and then it is sent
// again.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include "firmware/plc/command_handler.h"
#include "firmware/plc/register_server_model.h"
#include "hal_sim/world/random.h"
#include "lab/soak/invariants.h"
#include "lab/soak/store_observer.h"

namespace hord::lab {

using namespace firmware;

class PlcEndpoint {
  public:
    PlcEndpoint(hal::EventLoop& loop, const CoreConfig& config, std::uint32_t boot_id);
    void open(Station& station, Inspector& inspector, ResultSink& recorder);  // all outlive the doors

    void take(const PartResult& result) { unpublished_.push_back(result); }
    void publish();
    void check_plc_heartbeat() { desk_.check_plc_heartbeat(); }

    [[nodiscard]] RegisterServerModel& registers() { return registers_; }
    [[nodiscard]] const Station& station() const { return *station_; }
    // How often the command with this token was carried out, of the last ones.
    [[nodiscard]] int executed(std::uint32_t token) const { return handler_.executed(token); }

  private:
    // Counts what reaches the station.
    class Counting final : public PlcHandler {
      public:
        explicit Counting(hal::EventLoop& loop) : operations(loop) {}
        CommandOutcome on_command(const modbus::Origin& origin, const CommandRequest& request) override;
        CommandOutcome on_recipe(const modbus::Origin& origin, const CommandRequest& request,
                                 const StagedRecipe& staged) override;
        modbus::Exception on_acknowledged(const modbus::Origin& origin, std::uint32_t sequence) override {
            return operations.on_acknowledged(origin, sequence);
        }
        void on_plc_lost(PlcPolicy policy) override { operations.on_plc_lost(policy); }
        void on_plc_back() override { operations.on_plc_back(); }
        [[nodiscard]] int executed(std::uint32_t token) const;
        CommandHandler operations;

      private:
        void count(std::uint32_t token) { tokens_[next_++ % tokens_.size()] = token; }
        std::array<std::uint32_t, 64> tokens_{};
        std::size_t next_ = 0;
    };
    Counting handler_;
    PlcInterface desk_;
    RegisterServerModel registers_;
    Station* station_ = nullptr;
    std::vector<PartResult> unpublished_;
};

class PlcSimulator {
  public:
    static constexpr Duration kEvery = milliseconds(250);     // the PLC's cycle
    static constexpr Duration kTimeout = milliseconds(1000);  // without a beat for so long it counts as lost

    PlcSimulator(hal::EventLoop& loop, Invariants& invariants, StoreObserver& books, std::uint64_t seed)
        : loop_(loop), invariants_(invariants), books_(books), seed_(seed) {}

    // Null while no process answers.
    void connect(PlcEndpoint* doors) { doors_ = doors; }
    // A person who resets takes the parts off the belt first: so does who resets by the PLC.
    void clear_with(std::function<void()> take_parts_off) { take_parts_off_ = std::move(take_parts_off); }

    void told(const PartResult& result) { told_[result.sequence % told_.size()] = result; }
    void cycle();  // every kEvery

    // Misbehaviour, as faults name it.
    void be_silent(Duration amount) { silent_until_ = std::max(silent_until_, loop_.now() + amount); }
    void repeat_a_command();
    void write_nonsense();
    void read_everything();
    void command_something();
    void walk(Duration amount);

  private:
    using Words = std::vector<std::uint16_t>;
    [[nodiscard]] std::uint64_t draw() { return sim::random_bits(seed_, 0x97C5, drawn_++); }
    [[nodiscard]] Words read(std::uint16_t address, std::uint16_t count);
    modbus::Exception write(std::uint16_t address, const Words& words);
    void command(Command code, bool meant_for_this_boot = true);
    void bring_back();
    void try_anything();
    void command_with_care(Command code);
    void check_status();
    void check_results();

    hal::EventLoop& loop_;
    Invariants& invariants_;
    StoreObserver& books_;
    std::uint64_t seed_, drawn_ = 0;
    PlcEndpoint* doors_ = nullptr;
    std::function<void()> take_parts_off_;
    hal::TimePoint silent_until_{}, leave_alone_until_{}, restless_until_{};
    int repeats_ = 0;
    std::uint16_t beat_ = 0;
    std::uint32_t boot_id_ = 0, token_ = 0;
    std::uint32_t read_ = 0, asked_ = 0, taken_ = 0;  // results: looked at, to be acknowledged, acknowledged
    std::array<PartResult, kRingSlots> told_{};
};

}  // namespace hord::lab
