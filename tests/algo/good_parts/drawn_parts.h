// Parts drawn for these tests: a weak lens that fills a field of 26x24 lenslets of 9x9 bins, 12 bits, one electron a
// DN.
#pragma once

#include <cstdint>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo::testing {

constexpr Extents kDrawn{26, 24, 9, 9};

struct DrawnPart {
    double x = 0, y = 0;      // where it lies, lenslets
    double power = 0.08;      // bins a lenslet
    double light = 1;         // brightness of the light
    std::uint64_t noise = 1;  // seed
};
Frame draw(const DrawnPart& part);

// A part in a pose of its own, within +-0.5 lenslets.
DrawnPart placed_part(std::uint64_t seed);

}  // namespace hord::algo::testing
