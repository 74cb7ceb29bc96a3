// Whether a part is as large as the reference's parts: how far its opposite edges lie apart at its pose. A shift moves
// both alike, another size does not (docs/notes/reference.md, "Registration").
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "algo/frame/extents.h"
#include "algo/reference/pose.h"
#include "algo/reference/registered_maps.h"

namespace hord::algo {

// Along x and along y. Only edges of the light count.
struct SizeDifference {
    std::array<bool, 2> known{};  // both sides show their edges
    std::array<double, 2>
        wider{};  // lenslets by which opposite edges lie farther apart than the reference's; below 0: closer
    std::array<double, 2> apart{};    // the larger of both sides' offsets, without sign, lenslets
    std::array<double, 2> shift{};    // lenslets by which both sides lie beside the reference's, mean
    std::array<double, 2> allowed{};  // what it may be, by ReferenceMaps::size_limits and the noise of the part's edges

    [[nodiscard]] bool exceeds(std::size_t axis) const {
        return known[axis] && allowed[axis] > 0 && std::abs(wider[axis]) > allowed[axis];
    }
    // Lenslets by which the side before (0) or behind (1) the middle lies beside the reference's; 0 if it is not known.
    [[nodiscard]] double offset(std::size_t axis, std::size_t side) const {
        return shift[axis] + (side == 0 ? -0.5 : 0.5) * wider[axis];
    }
    // What another one says along an axis.
    void take(std::size_t axis, const SizeDifference& from) {
        known[axis] = from.known[axis], wider[axis] = from.wider[axis], apart[axis] = from.apart[axis];
        shift[axis] = from.shift[axis], allowed[axis] = from.allowed[axis];
    }
    // Lenslets, along the axis with more.
    [[nodiscard]] double shifted() const { return std::max(std::abs(shift[0]), std::abs(shift[1])); }
    [[nodiscard]] bool exceeds() const { return exceeds(0) || exceeds(1); }
};

// `typical`: the reference's typical light, DN. `light`: the part's light over the reference's.
SizeDifference compare_sizes(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part,
                             const PoseMap& map, double typical, double light);

// How good parts differ in size, from parts that are compared with the mean of others.
class SizeSpread {
  public:
    void add(const SizeDifference& size);
    // Lenslets that one of 10,000 good parts exceeds, if their sizes are normally distributed. 0, no limit, of an axis
    // along which less than 8 parts show their size.
    [[nodiscard]] std::array<float, 2> limits() const;

  private:
    std::array<double, 2> squares_{};
    std::array<std::size_t, 2> parts_{};
};

}  // namespace hord::algo
