// Whether a part's edges are wider than the reference's at its pose: it moved while the light was on, or was exposed
// twice (docs/notes/reference.md, "Registration").
#pragma once

#include <array>
#include <cstddef>

#include "algo/frame/extents.h"
#include "algo/reference/pose.h"
#include "algo/reference/registered_maps.h"
#include "algo/reference/size_difference.h"

namespace hord::algo {

// Along x and along y. Only edges of the light count.
struct EdgeBlur {
    std::array<bool, 2> known{};
    // The change from the reference's edges to the part's, over that to the mean of two exposures a lenslet before and
    // behind: below 0 the part's are sharper. 1/3 is that of a smooth edge that moved by two lenslets.
    std::array<double, 2> blur{};
    std::array<double, 2> noise{};    // standard deviation of `blur` by what the part's edges differ beside it
    std::array<double, 2> allowed{};  // what it may be, by ReferenceMaps::blur_limits and `noise`; 0: not known

    // What another one says along an axis.
    void take(std::size_t axis, const EdgeBlur& from) {
        known[axis] = from.known[axis], blur[axis] = from.blur[axis];
        noise[axis] = from.noise[axis], allowed[axis] = from.allowed[axis];
    }
    [[nodiscard]] bool exceeds(std::size_t axis) const {
        return known[axis] && allowed[axis] > 0 && blur[axis] > allowed[axis];
    }
    [[nodiscard]] bool exceeds() const { return exceeds(0) || exceeds(1); }
};

// `size`: compare_sizes() of the same part and pose. `typical`: the reference's typical light, DN. `light`: the part's
// light over the reference's.
EdgeBlur compare_blur(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map,
                      const SizeDifference& size, double typical, double light);

// How good parts differ in it, from parts that are compared with the mean of others.
class BlurSpread {
  public:
    void add(const EdgeBlur& blur);
    // What one of 10,000 good parts exceeds, if theirs are normally distributed, at least kOfAperture. 0, no limit, of
    // an axis along which less than 8 parts show edges.
    [[nodiscard]] std::array<float, 2> limits() const;

  private:
    std::array<double, 2> sums_{}, squares_{};
    std::array<std::size_t, 2> parts_{};
};

}  // namespace hord::algo
