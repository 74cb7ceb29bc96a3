// Small episodes that once violated an invariant, as reduced by the shrinker.
#pragma once

#include <array>
#include <string_view>

#include "lab/soak/plan.h"

namespace hord::lab {

struct Found {
    std::string_view bug;      // tests/system/mutants/BUG.patch plants it again
    std::string_view promise;  // the invariant that was violated
    std::uint64_t seed, parts;
    LineProfile line;
    std::string_view faults;
};

inline constexpr std::array kFound{
    Found{"late-verdict-accepted", "own-data", 8410883890119106219U, 217, LineProfile::encoder,
          "inspector-slow@209+556000us"},
    Found{"touching-parts-unseen", "no-bad-part-passes", 7461442279635777055U, 34, LineProfile::encoder,
          "part-touching@24"},
    Found{"token-forgotten", "commands-once", 9950621557077242515U, 41, LineProfile::encoder, "plc-repeats@40"},
    Found{"lost-edges-run-on", "no-bad-part-passes", 3439141232638176491U, 43, LineProfile::encoder, "edge-lost@33"},
};

inline Result<EpisodePlan> plan_of(const Found& found) {
    auto faults = faults_of(found.faults);
    if (!faults) return tl::unexpected(faults.error());
    return EpisodePlan{found.seed, found.parts, found.line, false, std::move(*faults)};
}

}  // namespace hord::lab
