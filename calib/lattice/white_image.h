// A white frame, corrected by dark and flat frame. Read in windows: the whole frame is not copied.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/frame.h"
#include "common/result.h"

namespace hord::calib {

class WhiteImage {
  public:
    // The frames are not copied and must outlive the image. A flat frame is one of even light without lenslets; light
    // is multiplied by the mean of flat minus dark over flat minus dark. Fails with invalid_argument if the sizes of
    // the frames differ, some have 8 bits and others more, a side is below 24 px (three lenslets of the smallest
    // pitch), or the flat is dark.
    static Result<WhiteImage> open(const FrameView& white, const std::optional<FrameView>& dark,
                                   const std::optional<FrameView>& flat = {});

    // The same frame, blurred by a Gaussian of this sigma, px; saturation is that of the frame itself.
    [[nodiscard]] WhiteImage smoothed(double sigma_px) const;

    // Sigma of the Gaussian that the frame was smoothed by; 0 if it was not.
    [[nodiscard]] double smoothed_px() const { return smoothed_px_; }
    // Of a smoothed frame, pixels from its border on that what lies outside would change; 0 else.
    [[nodiscard]] double margin_px() const { return 2 * smoothed_px_; }

    [[nodiscard]] int width_px() const { return white_.width_px; }
    [[nodiscard]] int height_px() const { return white_.height_px; }

    // Light at one pixel, DN; may be slightly negative after subtraction of a dark frame.
    [[nodiscard]] float at(int x, int y) const;
    // A sample at or above this value is saturated: full scale, or the frame's maximum if samples pile up there.
    [[nodiscard]] std::uint32_t saturated_dn() const { return saturated_dn_; }
    // True if one of every 4th pixel is saturated.
    [[nodiscard]] bool any_saturated() const { return any_saturated_; }
    [[nodiscard]] bool saturated(int x, int y) const { return white_.sample(x, y) >= saturated_dn_; }

    // Copies the window of width x height pixels with top-left (x, y) to `out`, row by row, `stride` floats apart.
    // Pixels outside the frame become 0.
    void window(int x, int y, int width, int height, float* out, int stride) const;

  private:
    [[nodiscard]] bool learn_gain(const FrameView& flat);
    FrameView white_;
    std::optional<FrameView> dark_;
    std::vector<float> gain_;    // one a pixel; empty without a flat frame
    std::vector<float> smooth_;  // light of each pixel; empty if not smoothed
    double smoothed_px_ = 0;
    std::uint32_t saturated_dn_ = 0;
    bool any_saturated_ = false;
};

}  // namespace hord::calib
