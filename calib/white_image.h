// A white frame less its dark frame, read in windows: no copy of the whole frame is made.
#pragma once

#include <cstdint>
#include <optional>

#include "algo/frame.h"
#include "algo/result.h"

namespace hord::calib {

class WhiteImage {
  public:
    // The frames are borrowed. Fails with invalid_argument when the sizes of `white` and `dark` differ, or a side
    // is below 24 px (three lenslets of the smallest pitch).
    static Result<WhiteImage> open(const algo::FrameView& white, const std::optional<algo::FrameView>& dark);

    [[nodiscard]] int width_px() const { return white_.width_px; }
    [[nodiscard]] int height_px() const { return white_.height_px; }

    // Light at one pixel, in DN; may be slightly negative where a dark frame is subtracted.
    [[nodiscard]] float at(int x, int y) const;
    // The largest value a sample of this frame takes: at or above it a pixel is saturated. Full scale, or, where many
    // samples share the frame's own maximum, that maximum.
    [[nodiscard]] std::uint32_t saturated_dn() const { return saturated_dn_; }
    // Whether any of every 4th pixel is saturated: a frame without is spared a closer look.
    [[nodiscard]] bool any_saturated() const { return any_saturated_; }
    [[nodiscard]] bool saturated(int x, int y) const { return white_.sample(x, y) >= saturated_dn_; }

    // Copies the window of width x height pixels with top-left (x, y) to `out`, row by row, `stride` floats apart.
    // Pixels outside the frame become 0.
    void window(int x, int y, int width, int height, float* out, int stride) const;

  private:
    algo::FrameView white_;
    std::optional<algo::FrameView> dark_;
    std::uint32_t saturated_dn_ = 0;
    bool any_saturated_ = false;
};

}  // namespace hord::calib
