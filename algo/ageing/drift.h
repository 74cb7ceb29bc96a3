// Drift of the lenslet grid, estimated from production frames: shift, turn and growth against the calibration, or
// against the first parts after the start.
//
// Where no part is in the way, light is undeflected and lands where the calibration puts it; a grid that has moved
// shifts it by as much. Of a regular sample of lenslets (24 x 24 at most) the mean deflection of every part is kept.
// The shifts, each the median of a lenslet over a window of 25 parts, are fitted robustly (Tukey) by
//     d(m, n) = shift + (growth, -turn; turn, growth) * (position from the middle, bins)
// A shift that happens at any moment fills a window after at most 50 parts.
//
// Against the first parts (DriftZero::first_parts): less the lenslet's median over the first 25, so that identical
// parts cancel, and weighed by how little it varied over them (free light: photon noise; behind a part: as much as
// parts differ). Against the calibration (DriftZero::calibration): undeflected light belongs at zero. Which light is
// undeflected is told by the outermost sampled lenslets: at least half of them agree to a quarter of a bin, as
// algo/inspection/rim.h asks of free light. The fit starts from them and takes in what follows it. Where a part fills
// the field and they do not agree, the first window is the baseline instead, and Drift::since_calibration says so.
//
// All memory is taken by create(). Doubles: this watches the station, it judges no part.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "algo/frame/decode.h"
#include "algo/frame/extents.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::algo {

enum class DriftZero : std::uint8_t { first_parts, calibration };

struct Drift {
    double shift_x_bins = 0, shift_y_bins = 0;  // at the middle
    double turn_rad = 0, growth = 0;            // growth 0.001: a thousandth larger
    double largest_bins = 0;                    // the largest shift anywhere in the field
    double noise_bins = 0;                      // of that, one standard deviation, from the residuals
    std::int64_t parts = 0;                     // seen until then
    bool since_calibration = false;             // else since the first parts
};

class DriftEstimator {
  public:
    static constexpr int kWindow = 25;   // parts
    static constexpr int kSampled = 24;  // lenslets a side, at most

    // `levels` as the pipeline's. Fails with invalid_argument for extents that check() refuses.
    static Result<DriftEstimator> create(const Extents& extents, const LightLevels& levels,
                                         DriftZero zero = DriftZero::first_parts);

    // One part's macro-pixel frame, of the extents' size. True when a window was completed and latest() is new. Frames
    // with less than a tenth of the sampled lenslets lit are not looked at.
    bool add(const FrameView& frame);

    // None until the first window, after the baseline if there is one.
    [[nodiscard]] const std::optional<Drift>& latest() const { return latest_; }

    // Forgets everything: what comes next is the baseline (another calibration, another recipe).
    void restart();

  private:
    DriftEstimator(const Extents& extents, const LightLevels& levels, DriftZero zero);
    struct Sample {
        double x_bins = 0, y_bins = 0;  // position, from the middle of the field
        float base_x = 0, base_y = 0,
              weight = 0;  // median and 1 / variance of the baseline; weight 0: not seen often enough
        int seen = 0;      // in this window
        bool outermost = false;
    };
    struct Centre {
        float x = 0, y = 0, weight = 0;  // median of a lenslet over a window, and 1 / variance of it
    };
    Centre centre_of(std::size_t sample);
    void close_window();
    bool outermost_agree(Drift& start);
    void fit(Drift start, bool of_outermost);
    void fit_round(Drift& drift, double& scale, bool first, bool of_outermost);
    [[nodiscard]] double residual(const Drift& drift,
                                  std::size_t sample) const;  // in standard deviations of the sample

    Extents extents_;
    LightLevels levels_;
    HordRow row_;
    std::vector<int> columns_, rows_;         // sampled
    std::vector<Sample> samples_;             // rows x columns
    std::vector<float> window_x_, window_y_;  // kWindow a sample
    std::vector<double> shift_x_, shift_y_, trust_, residuals_;
    std::vector<float> scratch_;
    DriftZero zero_;
    int in_window_ = 0;
    bool has_base_ = false;          // there is something to compare with
    bool from_calibration_ = false;  // and it is the calibration
    std::int64_t parts_ = 0;
    std::optional<Drift> latest_;
};

}  // namespace hord::algo
