// A simulated PLC at the station's registers. It checks that they show what the station reported, and that each command
// is carried out exactly once.
//
// PlcEndpoint is the station's side: registers and PlcInterface, assembled as in the service, one for each process.
// PlcSimulator is the PLC: it sends heartbeats, acknowledges results, restarts a stopped station, and sometimes
// misbehaves. It reads and writes whole register requests; it repeats a request whose answer was lost.
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
    void open(Station& station, Inspector& inspector, ResultSink& recorder);  // all outlive this

    void add_result(const PartResult& result) { unpublished_.push_back(result); }
    void publish();
    void check_plc_heartbeat() { plc_.check_plc_heartbeat(); }

    [[nodiscard]] RegisterServerModel& registers() { return registers_; }
    [[nodiscard]] const Station& station() const { return *station_; }
    // How often the command with this token was carried out, among the last 64 commands.
    [[nodiscard]] int executed(std::uint32_t token) const { return handler_.executed(token); }

  private:
    // Counts the commands that reach the station.
    class CountingHandler final : public PlcHandler {
      public:
        CommandOutcome on_command(const modbus::Origin& origin, const CommandRequest& request) override;
        modbus::Exception on_acknowledged(const modbus::Origin& origin, std::uint32_t sequence) override {
            return commands.on_acknowledged(origin, sequence);
        }
        void on_plc_lost(PlcPolicy policy) override { commands.on_plc_lost(policy); }
        void on_plc_back() override { commands.on_plc_back(); }
        [[nodiscard]] int executed(std::uint32_t token) const;
        CommandHandler commands;

      private:
        std::array<std::uint32_t, 64> tokens_{};
        std::size_t next_ = 0;
    };
    CountingHandler handler_;
    PlcInterface plc_;
    RegisterServerModel registers_;
    Station* station_ = nullptr;
    std::vector<PartResult> unpublished_;
};

class PlcSimulator {
  public:
    static constexpr Duration kCycle = milliseconds(250);  // the PLC's cycle
    // The station beats every 500 ms; a few stalls may delay that.
    static constexpr Duration kMaxBeat = milliseconds(2500);
    static constexpr Duration kTimeout = milliseconds(1000);  // without a heartbeat for this long it counts as lost

    PlcSimulator(hal::EventLoop& loop, Invariants& invariants, StoreObserver& store_observer, std::uint64_t seed)
        : loop_(loop), invariants_(invariants), store_observer_(store_observer), seed_(seed) {}

    // Null while no process runs.
    void connect(PlcEndpoint* endpoint) {
        endpoint_ = endpoint;
        station_beat_at_ = {};
    }
    // Called before a reset after line stop, by which a person takes all parts off the belt.
    void clear_with(std::function<void()> take_parts_off) { take_parts_off_ = std::move(take_parts_off); }

    void expect_result(const PartResult& result) {
        expected_results_[result.sequence % expected_results_.size()] = result;
    }
    void cycle();  // every kCycle

    // Misbehaviour, one function for each fault.
    void be_silent(Duration amount) { silent_until_ = std::max(silent_until_, loop_.now() + amount); }
    void repeat_a_command();
    void write_nonsense();
    void read_everything();
    void misuse_commands();
    void walk_states(Duration amount);

    // For the operator. Before a reset after line stop the parts are taken off.
    void command_with_care(Command code);
    // The PLC starts a stopped station only after this time.
    void leave_alone(Duration amount) { idle_until_ = loop_.now() + amount; }

  private:
    using Words = std::vector<std::uint16_t>;
    [[nodiscard]] std::uint64_t draw() { return sim::random_bits(seed_, 0x97C5, drawn_++); }
    [[nodiscard]] Words read(std::uint16_t address, std::uint16_t count);
    modbus::Exception write(std::uint16_t address, const Words& words);
    void command(Command code, bool meant_for_this_boot = true);
    void recover_station();
    void send_random_command();
    void check_status();
    void check_results();

    hal::EventLoop& loop_;
    Invariants& invariants_;
    StoreObserver& store_observer_;
    std::uint64_t seed_, drawn_ = 0;
    PlcEndpoint* endpoint_ = nullptr;
    std::function<void()> take_parts_off_;
    hal::TimePoint silent_until_{}, idle_until_{}, restless_until_{};
    int repeats_ = 0;
    std::uint16_t beat_ = 0, station_beat_ = 0;
    hal::TimePoint station_beat_at_{};  // when station_beat_ was seen first; zero: not read yet
    std::uint32_t boot_id_ = 0, token_ = 0;
    std::uint32_t read_ = 0, to_acknowledge_ = 0,
                  acknowledged_ = 0;  // sequences of results: checked, to be acknowledged, acknowledged
    std::array<PartResult, kRingSlots> expected_results_{};
};

}  // namespace hord::lab
