// An episode: its line, its parts and its faults, drawn from a seed. Faults have a text form for the command line.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "common/result.h"
#include "hal_sim/world/fault_injection.h"

namespace hord::lab {

enum class LineProfile : std::uint8_t { timed, encoder };
std::string_view name_of(LineProfile profile);

struct EpisodePlan {
    std::uint64_t seed = 1;
    std::uint64_t parts = 5'000;
    LineProfile line = LineProfile::timed;
    bool real = false;  // rendered frames and the real pipeline; else tokens and a stand-in
    std::vector<sim::InjectionRule> faults;
    // The seed also decides the policy for a lost PLC and everything random.
};

// One to four faults. Each fires at least once, early in the episode and near the others, and then at random until nine
// tenths of it; in the last tenth the line must recover. In half of the episodes the operator stops the line besides.
// One episode in fifty shows real parts.
EpisodePlan draw_plan(std::uint64_t seed, std::uint64_t parts);
// The same with these faults.
EpisodePlan draw_plan(std::uint64_t seed, std::uint64_t parts, const std::vector<sim::InjectedFault>& faults);

// Whether the fault can happen on a line of this profile. A line without an encoder has no encoder faults, and does not
// notice a belt that stops by itself (such a line must be wired to stop by its permit only).
bool possible(sim::InjectedFault fault, LineProfile line);

// "frame-drop@5", "frame-late@6-900:0.01+200ms": opportunities, probability, amount; several with commas. faults_of()
// fails with invalid_argument.
std::string text_of(const std::vector<sim::InjectionRule>& faults);
Result<std::vector<sim::InjectionRule>> faults_of(std::string_view text);

}  // namespace hord::lab
