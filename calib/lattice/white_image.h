// A white frame less its dark frame and over its flat one, read in windows: no copy of the whole frame is made.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/frame.h"
#include "common/result.h"

namespace hord::calib {

class WhiteImage {
  public:
    // The frames are borrowed. A flat frame shows what each pixel makes of even light (no lenslets in front of it);
    // with one, light is multiplied by the flat's mean over the flat, less its dark level. Fails with invalid_argument
    // when the sizes of `white`, `dark` and `flat` differ, a side is below 24 px (three lenslets of the smallest
    // pitch), or the flat is dark.
    static Result<WhiteImage> open(const FrameView& white, const std::optional<FrameView>& dark,
                                   const std::optional<FrameView>& flat = {});

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
    [[nodiscard]] bool learn_gain(const FrameView& flat);
    FrameView white_;
    std::optional<FrameView> dark_;
    std::vector<float> gain_;  // one a pixel; empty without a flat frame
    std::uint32_t saturated_dn_ = 0;
    bool any_saturated_ = false;
};

}  // namespace hord::calib
