// Production in virtual time with random faults; an omniscient observer checks every promise.
//
// The parts are split into episodes. Each draws its line (timed or with encoder) and its faults from the seed and its
// number, so any episode can be run again alone, bit for bit.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/result.h"
#include "lab/soak/coverage.h"
#include "lab/soak/plan.h"
#include "lab/soak/simulated_line.h"

namespace hord::lab {

struct SoakOptions {
    std::uint64_t parts = 100'000;
    std::uint64_t seed = 1;
    std::uint64_t parts_an_episode = 5'000;
    bool all_pairs = false;  // first an episode for each pair of faults, and walks through all states with each fault
    bool until_violation = false;  // ends with the first episode that breaks a promise
    // One episode in fifty shows rendered frames to the real pipeline; rendering takes some seconds.
    bool real_parts = true;
    int threads = 1;                            // episodes at the same time; the report is the same for every number
    std::function<void(double done)> progress;  // 0..1; may be empty
};

struct SoakReport {
    std::uint64_t parts = 0, episodes = 0, results = 0;
    std::uint64_t violations = 0;
    std::array<std::uint64_t, kPromises> broken{};  // violations by Promise
    std::vector<std::string> first_violations;      // each with the command that reproduces it
    std::optional<EpisodePlan> first_broken;        // the first episode that broke a promise, for shrink()
    std::uint64_t parts_to_violation = 0;           // arrived before the first violation; 0: there is none
    std::uint64_t line_stops = 0, resets = 0, excused = 0;
    std::uint64_t stored = 0, lost = 0;  // results on disks; results that the stores report as lost
    std::uint64_t virtual_s = 0;
    std::array<std::uint64_t, 32> reasons{};                    // by PartReason
    std::array<std::uint64_t, sim::kInjectedFaults> planned{};  // episodes whose plan names the fault
    std::array<std::uint64_t, sim::kInjectedFaults> fired{};    // times
    std::uint64_t real_parts = 0, passed_bad = 0;  // rendered parts, and bad ones of these that the pipeline passed
    std::uint64_t undisturbed = 0;                 // parts checked for Promise::undisturbed_parts
    std::uint64_t processes = 0;                   // those beyond the number of episodes died or were restarted
    Coverage coverage;
    std::vector<std::string> never_fired;  // planned faults that did not fire in their episode
    std::uint64_t fingerprint = 0;         // over all results; equal for equal options

    void add(const SoakReport& later);  // the fingerprint depends on the order

    // No violation, no episode that did not end, no planned fault that never fired.
    [[nodiscard]] bool good() const { return violations == 0 && never_fired.empty(); }
};

// One episode. The same plan gives the same bits.
Result<LineOptions> line_of(const EpisodePlan& plan);
std::string command_of(const EpisodePlan& plan);
Result<SoakReport> run_episode(const EpisodePlan& plan);

// Fails with invalid_argument when the options are impossible.
Result<SoakReport> soak(const SoakOptions& options);

// The report as text of some lines.
std::string describe(const SoakReport& report);

}  // namespace hord::lab
