// Ground truth of a rendered scene: which lenslets show which defect.
#pragma once

#include <cstdint>
#include <vector>

#include "hal_sim/optics/scene/scene.h"

namespace hord::lab {

// The true positions of the defects, in lenslets.
struct TruthDefect {
    double m = 0, n = 0;  // centre
    double radius_lenslets = 0;
    std::uint32_t area_lenslets = 0;  // lenslets touched by it
    const char* kind = "";            // as in the scene file: bubble, cut, speck, ...
};
struct Truth {
    bool defect_free = true;
    std::vector<TruthDefect> defects;
    // One value a lenslet: 0 free field, 1 part, 2 the part's border, 3 defect, 4 defect inside the border.
    std::vector<std::uint8_t> labels;
};

Truth truth_of(const sim::Scene& scene);

}  // namespace hord::lab
