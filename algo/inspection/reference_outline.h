// Where the part of a reference lies: lenslets that a frame's own light shows as free field, but that lie inside the
// reference's part, belong to the part. So a defect there is never taken for free field.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/pose.h"

namespace hord::algo {

class ReferenceOutline {
  public:
    // Finds the outline of the recipe's reference, which has these extents. Allocates all memory.
    ReferenceOutline(const Recipe& recipe, const Extents& extents);

    // Clears kOutside in `mask` where the reference's part, beyond its rim, lies at this pose. `zones`: kOutside where
    // the recipe's zones say so; it stays. Both: one value a lenslet, row by row. Rows `first` to `last` - 1; different
    // rows by any threads at once.
    void take_in(const PoseMap& pose, std::span<const std::uint8_t> zones, std::span<std::uint8_t> mask, int first,
                 int last) const;

  private:
    Extents extents_;
    std::vector<std::uint8_t> outline_;  // kOutside and kRim of the reference
};

}  // namespace hord::algo
