// The mask of the recipe's zones (algo/recipe/recipe.h): which lenslets may be judged.
//
// A lenslet belongs to a zone if its centre does. A circle includes its edge. A polygon is closed and filled by the
// even-odd rule; a centre exactly on an edge belongs to the side to the right or below.
#pragma once

#include <cstdint>
#include <span>

#include "algo/frame/extents.h"
#include "algo/recipe/recipe.h"

namespace hord::algo {

// Sets kOutside outside the `inspect` zones (if there are any) and inside the `ignore` zones; kValid elsewhere.
// `lenslet_mm` must be above 0 if a zone is in mm. A centre in mm is (m - (M-1)/2) lenslet_mm, rounded once to float.
void paint_zones(std::span<const Zone> zones, const Extents& extents, std::span<std::uint8_t> mask,
                 float lenslet_mm = 0);

// Whether no lenslet is left to judge. Allocates.
bool leaves_nothing(std::span<const Zone> zones, const Extents& extents, float lenslet_mm);

}  // namespace hord::algo
