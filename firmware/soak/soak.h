// Production in virtual time, with faults: many parts, seeded, every promise checked by an omniscient observer.
//
// The parts are run in episodes of their own. Each draws its line (timed or with encoder) and its faults from the seed and
// its number, so any episode can be run again alone, bit for bit.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "algo/result.h"
#include "hal_sim/cell/faults.h"

namespace hord::firmware {

struct SoakOptions {
    std::uint64_t parts = 100'000;
    std::uint64_t seed = 1;
    std::uint64_t parts_an_episode = 5'000;
    bool until_violation = false;              // ends with the first episode that breaks a promise
    std::uint64_t first_episode = 0;           // to run one episode again: its number, and parts = parts_an_episode
    std::vector<sim::FaultRule> faults;        // the same in every episode; none: each draws its own
    std::function<void(double done)> progress;  // 0..1; may be empty
};

struct SoakReport {
    std::uint64_t parts = 0, episodes = 0, results = 0;
    std::uint64_t violations = 0;
    std::vector<std::string> first_violations;  // each names seed, episode and plan
    std::uint64_t parts_to_violation = 0;       // that had come when the first promise was broken; 0: none was
    std::uint64_t line_stops = 0, resets = 0, excused = 0;
    std::uint64_t virtual_s = 0;
    std::array<std::uint64_t, 32> reasons{};              // by PartReason
    std::array<std::uint64_t, sim::kFaults> planned{};    // episodes whose plan names the fault
    std::array<std::uint64_t, sim::kFaults> fired{};      // times
    std::uint64_t pairs = 0;                              // of faults that fired in one episode, different ones
    std::vector<std::string> never_fired;                 // planned in an episode and not seen there
    std::uint64_t fingerprint = 0;                        // of every result: equal for equal options

    // No violation, no episode that did not end, no planned fault that never fired.
    [[nodiscard]] bool good() const { return violations == 0 && never_fired.empty(); }
};

// Fails with invalid_argument when the options are impossible.
Result<SoakReport> soak(const SoakOptions& options);

// The report for people, some lines.
std::string describe(const SoakReport& report);

}  // namespace hord::firmware
