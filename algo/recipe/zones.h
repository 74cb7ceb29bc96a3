// The recipe's zones, painted: which lenslets may be judged at all (Zone::contains is in algo/recipe/recipe.h).
//
// A lenslet belongs to a zone when its centre does. A circle includes its edge. A polygon is filled by the even-odd
// rule, its last corner joined to its first; a centre exactly on an edge belongs to the side that is to the right or
// below.
#pragma once

#include <cstdint>
#include <span>

#include "algo/frame/extents.h"
#include "algo/recipe/recipe.h"

namespace hord::algo {

// Sets kOutside where no `inspect` zone is (if there are any) and where an `ignore` zone is; 0 elsewhere. `lenslet_mm`:
// above 0 where a zone is in mm. A lenslet's centre in mm is (m - (M-1)/2) lenslet_mm, rounded to the nearest float
// once.
void paint_zones(std::span<const Zone> zones, const Extents& extents, std::span<std::uint8_t> mask,
                 float lenslet_mm = 0);

}  // namespace hord::algo
