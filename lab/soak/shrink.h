// From an episode that breaks a promise to the smallest one that still does.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "lab/soak/plan.h"

namespace hord::lab {

struct Shrunk {
    EpisodePlan plan;
    std::string promise;     // which is broken, "own-data"
    std::uint64_t runs = 0;  // episodes tried
};

// What an episode breaks first: the promise's name and the parts that had come; empty: nothing.
struct Breakage {
    std::string promise;
    std::uint64_t parts = 0;
};
using Try = std::function<Result<Breakage>(const EpisodePlan&)>;

// Removes rules, pins each that is left to the opportunities at which it has to fire, and cuts the parts, as long as
// the same promise is broken. Deterministic. At most `most_runs` episodes. Fails with invalid_argument when `plan`
// breaks nothing.
Result<Shrunk> shrink(const EpisodePlan& plan, const Try& attempt, std::uint64_t most_runs = 400);

// Runs the episode (soak.h).
Result<Breakage> try_episode(const EpisodePlan& plan);

}  // namespace hord::lab
