// Drift of the lenslet grid, estimated from production frames: shift, turn and growth against the first parts after the start.
//
// Where no part is in the way, light is undeflected and lands where the calibration puts it; a grid that has moved shifts it by as much.
// Of a regular sample of lenslets (24 x 24 at most) the mean deflection of every part is kept. A lenslet's median over a window of 25
// parts, less its median over the first 25, is its shift: parts come and go, and identical parts cancel. The shifts are fitted by
//     d(m, n) = shift + (growth, -turn; turn, growth) * (position from the middle, bins)
// weighed by how little each lenslet varied over the first parts (free light: photon noise; behind a part: as much as parts differ), and
// robustly (Tukey). A shift that happens at any moment fills a window after at most 50 parts.
//
// All memory is taken by create(). Doubles: this watches the station, it judges no part.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "algo/decode.h"
#include "algo/frame.h"
#include "algo/light_field.h"
#include "algo/result.h"

namespace hord::algo {

struct Drift {
    double shift_x_bins = 0, shift_y_bins = 0;  // at the middle
    double turn_rad = 0, growth = 0;            // growth 0.001: a thousandth larger
    double largest_bins = 0;                    // the largest shift anywhere in the field
    double noise_bins = 0;                      // of that, one standard deviation, from the residuals
    std::int64_t parts = 0;                     // seen until then
};

class DriftEstimator {
  public:
    static constexpr int kWindow = 25;   // parts
    static constexpr int kSampled = 24;  // lenslets a side, at most

    // `levels` as the pipeline's. Fails with invalid_argument for extents that check() refuses.
    static Result<DriftEstimator> create(const Extents& extents, const LightLevels& levels);

    // One part's macro-pixel frame, of the extents' size. True when a window was completed and latest() is new. Frames with less
    // than a tenth of the sampled lenslets lit are not looked at.
    bool add(const FrameView& frame);

    // None until the first window after the baseline.
    [[nodiscard]] const std::optional<Drift>& latest() const { return latest_; }

    // Forgets everything: what comes next is the baseline (another calibration, another recipe).
    void restart();

  private:
    DriftEstimator(const Extents& extents, const LightLevels& levels);
    struct Sample {
        double x_bins = 0, y_bins = 0;            // position, from the middle of the field
        float base_x = 0, base_y = 0, weight = 0;  // median and 1 / variance of the baseline; weight 0: not seen often enough
        int seen = 0;                             // in this window
    };
    void close_window();
    void fit(std::int64_t parts);

    Extents extents_;
    LightLevels levels_;
    HordRow row_;
    std::vector<int> columns_, rows_;      // sampled
    std::vector<Sample> samples_;          // rows x columns
    std::vector<float> window_x_, window_y_;  // kWindow a sample
    std::vector<double> shift_x_, shift_y_, trust_, residuals_;
    std::vector<float> scratch_;
    int in_window_ = 0;
    bool has_base_ = false;
    std::int64_t parts_ = 0;
    std::optional<Drift> latest_;
};

}  // namespace hord::algo
