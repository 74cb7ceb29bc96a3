// What the dark level leaves of a lenslet that shows a share of the free light.
//
// The dark level is subtracted from every sample, and fainter samples count as none. So the sum of a lenslet that is
// lit in part is less than its share of the free light's sum: the fainter the frame, the less. The free light's mean
// spot L_b, above the pedestal, tells how much is left of the share f of it:
//
//     left(f) = sum over the bins b of max(0, f * L_b - d) / sum of max(0, L_b - d),    d = dark level - pedestal
//
// The bins far from the spot's middle are lost first. So the mean deflection of what is left moves, towards the middle
// of the brightest bin, though no light is deflected: shift(f), from that of the free light.
//
// left(f) grows with f, and left(1) = 1. Shares whose brightest bin does not exceed d leave 0. Noise is left out: it
// leaves a little more where samples lie about the dark level.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo {

class LightScale {
  public:
    LightScale();  // nothing is lost: left(f) = f

    // `free_light`: lenslets of the frame that show free light. Nothing is lost if there are none.
    LightScale(const FrameView& frame, const Extents& extents, std::span<const std::uint32_t> free_light,
               double pedestal_dn, double dark_dn);

    [[nodiscard]] double left(double share) const;  // share: 0 and more
    [[nodiscard]] double share(double left) const;  // the inverse; of 0 the largest share that leaves nothing

    // Bin pitches. Where left(share) is 0: of the least share that leaves light.
    struct Shift {
        double x = 0, y = 0;
    };
    [[nodiscard]] Shift shift(double share) const;

  private:
    static constexpr int kSteps = 64;  // of the shares 0..1, between which it is taken for linear
    std::array<double, kSteps + 1> left_{};
    std::array<Shift, kSteps + 1> shift_{};
};

}  // namespace hord::algo
