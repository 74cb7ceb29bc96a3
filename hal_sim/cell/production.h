// Parts for the simulated cell, drawn from a seed: good ones, and each kind of defect at random places.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "hal_sim/optics/scene/scene.h"
#include "hal_sim/world/world.h"

namespace hord::sim {

enum class PartClass : std::uint8_t { good, bubble, cut, speck };
constexpr std::array<std::string_view, 4> kPartClassNames{"good", "bubble", "cut", "speck"};

struct ProductionOptions {
    Scene clean;  // the good part: a double-convex lens; its camera, light and noise are used for all
    std::uint64_t seed = 1;
    int good_parts = 6;       // different good parts in the pool (they lie a little differently)
    int of_each_defect = 4;   // different parts of each defect kind
    double good_share = 0.7;  // of all parts, 0..1
    double wobble_mm = 0.1;   // parts lie within this of the field's centre
};

// The pool of parts, for RenderedFrames and for the world's schedule: kinds[k] looks like scenes[k] and is named after
// its class. The good parts together have the share `good_share`.
struct Production {
    std::vector<Scene> scenes;
    std::vector<PartKind> kinds;
};

// The same options give the same parts. Fails with unsupported when the clean part is not a double-convex lens.
Result<Production> draw_production(const ProductionOptions& options);

}  // namespace hord::sim
