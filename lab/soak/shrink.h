// Reduces an episode that breaks a promise to a small one that still breaks it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "lab/soak/plan.h"

namespace hord::lab {

struct Shrunk {
    EpisodePlan plan;
    std::string promise;     // the broken one, for example "own-data"
    std::uint64_t runs = 0;  // episodes tried
};

// The promise that an episode breaks first, and how many parts had arrived by then. Empty: it breaks none.
struct Breakage {
    std::string promise;
    std::uint64_t parts = 0;
};
using Try = std::function<Result<Breakage>(const EpisodePlan&)>;

// Removes rules, narrows the others to the opportunities at which they must fire, and cuts parts, as long as the same
// promise is broken. Deterministic. Runs at most `max_runs` episodes. Fails with invalid_argument when `plan` breaks
// nothing.
Result<Shrunk> shrink(const EpisodePlan& plan, const Try& attempt, std::uint64_t max_runs = 400);

// Runs the episode (soak.h).
Result<Breakage> try_episode(const EpisodePlan& plan);

}  // namespace hord::lab
