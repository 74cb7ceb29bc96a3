// Frames that a station may get and must not pass, and good ones beside them: the kinds of the table in
// docs/notes/inspection.md. Drawn without a renderer, from a seed.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo::testing {

struct Kind {
    std::string name;
    // None where the extents do not allow this kind.
    std::function<std::optional<Frame>(const Extents& extents, std::uint64_t seed)> frame;
};
// Show no part that can be judged: nothing, or something else, or not one whole part. For extents of at least 24
// lenslets and 5 bins a side.
const std::vector<Kind>& unfit_kinds();
// Good parts that must pass with the default recipe.
const std::vector<Kind>& good_kinds();

}  // namespace hord::algo::testing
