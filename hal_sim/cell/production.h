// Parts for the simulated cell, drawn from a seed: good ones, and each kind of defect at random places.
//
// bubble, cut, speck and scratch take light away. dimple (a shallow hollow in the face towards the source), stria and
// inclusion (glass of slightly another index) deflect it by less than a bin pitch, haze scatters it into neighbouring
// bins: a camera with a wide light behind the part does not see them. Their sizes and depths, and why:
// docs/notes/optics.md.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "hal_sim/optics/scene/scene.h"
#include "hal_sim/world/world.h"

namespace hord::sim {

enum class PartClass : std::uint8_t { good, bubble, cut, speck, dimple, stria, inclusion, haze, scratch };
constexpr std::array<std::string_view, 9> kPartClassNames{"good",  "bubble",    "cut",  "speck",  "dimple",
                                                          "stria", "inclusion", "haze", "scratch"};
constexpr std::string_view name_of(PartClass made_as) { return kPartClassNames[static_cast<std::size_t>(made_as)]; }

inline constexpr std::array kLightTakers = {PartClass::bubble, PartClass::cut, PartClass::speck};
inline constexpr std::array kDeflectors = {PartClass::dimple, PartClass::stria, PartClass::inclusion};
inline constexpr std::array kAllDefects = {PartClass::bubble, PartClass::cut,    PartClass::speck,
                                           PartClass::dimple, PartClass::stria,  PartClass::inclusion,
                                           PartClass::haze,   PartClass::scratch};

struct ProductionOptions {
    Scene clean;  // the good part: a double-convex lens; its camera, light and noise are used for all
    std::uint64_t seed = 1;
    int good_parts = 6;       // different good parts in the pool (they lie a little differently)
    int of_each_defect = 4;   // different parts of each defect kind
    double good_share = 0.7;  // of all parts, 0..1
    double wobble_mm = 0.1;   // parts lie within this of the field's centre
    std::vector<PartClass> defects{kLightTakers.begin(), kLightTakers.end()};  // the kinds; drawn in this order
};

// The good part of the simulated line, and its camera: the lens of hal_sim/scenes/lens.toml in a field of 111x111
// lenslets, 8 bits, with photon noise, read noise and a pedestal of 1 DN. It sees sharply what lies just below the face
// towards the source.
Scene line_lens(int bins_i, int bins_j);

// The pool of parts, for RenderedFrames and for the world's schedule: kinds[k] looks like scenes[k] and is named after
// its class. The good parts together have the share `good_share`.
struct Production {
    std::vector<Scene> scenes;
    std::vector<PartKind> kinds;
};

// The same options give the same parts. Parts of a kind do not depend on the kinds after it in `defects`. Fails with
// unsupported when the clean part is not a double-convex lens.
Result<Production> draw_production(const ProductionOptions& options);

}  // namespace hord::sim
