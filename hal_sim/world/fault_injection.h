// The faults of the simulated cell, as rules and a seed. The plan counts how often each fault fires: a test whose fault
// never fired is void.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "drivers/hal/clock.h"

namespace hord::sim {

// Second column: the opportunity at which the fault may fire. Third: its effect, with the default `amount` in brackets.
enum class InjectedFault : std::uint8_t {
    frame_drop,             // each exposure       never delivered; the device's count shows a gap
    frame_duplicate,        // each exposure       delivered twice, same sequence
    frame_stale,            // each exposure       replaced by the previous frame, with that frame's time
    frame_late,             // each exposure       delivered `amount` later (200 ms)
    frame_short,            // each exposure       delivered with half of its bytes
    frame_corrupt,          // each exposure       flagged by the device
    frame_dark,             // each exposure       no light reached the sensor
    frame_saturated,        // each exposure       every sample at full scale
    sensor_lost,            // each exposure       the device goes; start() fails for `amount` (100 ms)
    strobe_dead,            // each pulse          reported as lit, no light
    strobe_refused,         // each pulse          no light; reported as not lit
    strobe_weak,            // each pulse          a quarter of the light
    strobe_double,          // each pulse          a second pulse, `amount` after the first ends (50 us)
    strobe_late,            // each pulse          begins `amount` late (2 ms); reported with the late time
    strobe_lost,            // each pulse          the device goes; start() fails for `amount` (100 ms)
    edge_bounce,            // each arrival        two more pairs of edges within `amount` (200 us)
    edge_lost,              // each arrival        not delivered; the sequence shows a gap
    edge_missed,            // each arrival        not delivered; the sequence shows no gap
    edge_ghost,             // each arrival        a second arrival `amount` later (10 ms), without a part
    encoder_slip,           // each arrival        the encoder loses the counts of `amount` at nominal speed (1 ms)
    encoder_silent,         // each arrival        no encoder reading, also none with an edge, for `amount` (300 ms)
    part_sensor_lost,       // each arrival        the device goes; start() fails for `amount` (100 ms)
    reject_lost,            // each command        never acts, never acknowledged
    reject_unacknowledged,  // each command        acts, never acknowledged
    reject_late,            // each command        acts `amount` late (100 ms), acknowledged then
    reject_twice,           // each command        acts again `amount` after the first pulse ends (20 ms)
    ejector_stuck,          // each command        acknowledged, the valve does not move
    rejector_down,          // each command        the link is down for `amount` (100 ms); the command is lost
    part_close,  // each part           its front is a tenth to six tenths of its length behind the end of the one ahead
    part_touching,     // each part           its front touches the one ahead: no edge between the two
    part_missing,      // each part           its place on the belt is empty
    part_removed,      // each arrival        taken off the belt by hand `amount` after its arrival (150 ms)
    belt_stop,         // each arrival        the belt stops for `amount` (300 ms), also with run permit
    inspector_slow,    // each inspection     takes `amount` longer (1 s)
    inspector_failed,  // each inspection     answers with a failure
    process_stalled,   // each arrival        the process is not scheduled for `amount` (120 ms)
    process_crash,  // each arrival        the process dies a moment later and is started again after `amount` (400 ms)
    restart_ordered,   // each arrival        the station is halted, and started again with its configuration read anew
    plc_silent,        // each arrival        the PLC sends no heartbeat and no request for `amount` (3 s)
    plc_repeats,       // each arrival        an answer is lost: the PLC sends its next command four times
    plc_commands,      // each arrival        the PLC sends a random command in any state
    plc_nonsense,      // each arrival        writes random registers, half a command, and a command with an old boot id
    scada_floods,      // each arrival        twenty reads of random registers
    store_error,       // each arrival        the disk answers every write with an error for `amount` (1 s)
    store_in_doubt,    // each arrival        the disk writes but reports an error for `amount` (1 s)
    store_slow,        // each arrival        nothing is written for `amount`, without an error (2 s)
    disk_full,         // each arrival        no space for `amount` (3 s)
    clock_set,         // each arrival        the machine's wall clock is set forward or back by `amount` (1 h)
    inspector_hangs,   // each inspection     no inspection is answered for `amount`, then all are (1.5 s)
    device_unplugged,  // each arrival        a random device goes at a random time within 1.5 s; start() fails for
    // `amount` (300 ms)
    plc_walks,  // each arrival        the PLC commands the station to a random state and leaves it there for `amount`
                // (1.5 s)
    strobe_short,  // each pulse          lit for `amount` less (22 us); reported so
    trigger_late,  // each exposure       the camera obeys its trigger `amount` late (60 ms), and says which trigger it
                   // was
    plc_orders,    // each arrival        the operator stops the line by one to three commands; `amount` (1 s) after
                   // the last one it is started again
    belt_coasts,   // each arrival        from now on the belt runs on for `amount` (60 ms) when the permit falls
};
inline constexpr std::size_t kInjectedFaults = static_cast<std::size_t>(InjectedFault::belt_coasts) + 1;

std::string_view name_of(InjectedFault fault);  // "frame-drop"
std::optional<InjectedFault> injected_fault_named(std::string_view name);

struct InjectionRule {
    InjectedFault fault = InjectedFault::frame_drop;
    double probability = 1;           // of each opportunity in [first, last]
    std::uint64_t first = 0;          // opportunities count from 0
    std::uint64_t last = UINT64_MAX;  // inclusive
    hal::Duration amount{};           // 0: the fault's default
};

class InjectionPlan {
  public:
    InjectionPlan(std::uint64_t seed, std::vector<InjectionRule> rules);

    // Counts an opportunity. Returns the amount of the first rule that fires, if any. Depends only on the seed, the
    // fault and the number of the opportunity, so removing a rule does not change the others.
    std::optional<hal::Duration> fires(InjectedFault fault);

    // The callback runs whenever a fault fires.
    void watch(std::function<void(InjectedFault, hal::Duration amount)> watcher) { watcher_ = std::move(watcher); }

    // The next opportunity fires once, regardless of the rules. amount 0: the default.
    void fire_next(InjectedFault fault, hal::Duration amount = {});

    [[nodiscard]] bool names(InjectedFault fault) const { return !tracks_[index(fault)].rules.empty(); }
    [[nodiscard]] std::uint64_t fired(InjectedFault fault) const { return tracks_[index(fault)].fired; }
    [[nodiscard]] std::vector<InjectedFault> never_fired() const;  // named by a rule

  private:
    static std::size_t index(InjectedFault fault) { return static_cast<std::size_t>(fault); }
    struct Track {
        std::vector<InjectionRule> rules;
        std::optional<hal::Duration> next;
        std::uint64_t opportunities = 0, fired = 0;
    };
    std::optional<hal::Duration> fire(Track& track, InjectedFault fault, hal::Duration amount);

    std::uint64_t seed_;
    std::array<Track, kInjectedFaults> tracks_;
    std::function<void(InjectedFault, hal::Duration)> watcher_;
};

}  // namespace hord::sim
