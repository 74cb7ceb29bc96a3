// Drift of the lenslet grid, estimated from production frames: shift, turn and growth against the calibration, or
// against the first parts after the start. A robust fit to the mean deflections of at most 24 x 24 lenslets, each the
// median over a window of 25 parts. How: docs/notes/ageing.md.
//
// create() allocates all memory. For monitoring only: no part is judged by it.
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
    double shift_x_bins = 0, shift_y_bins = 0;  // at the middle of the field
    double turn_rad = 0, growth = 0;            // growth 0.001: a thousandth larger
    double largest_bins = 0;                    // the largest shift anywhere in the field
    double noise_bins = 0;                      // standard deviation of largest_bins, from the residuals
    std::int64_t parts = 0;                     // since the start
    bool since_calibration = false;             // else since the first parts
};

class DriftEstimator {
  public:
    static constexpr int kWindow = 25;   // parts
    static constexpr int kSampled = 24;  // lenslets a side, at most

    // `levels` are those of the pipeline. Fails with invalid_argument for extents that check() refuses.
    static Result<DriftEstimator> create(const Extents& extents, const LightLevels& levels,
                                         DriftZero zero = DriftZero::first_parts);

    // Adds one part's macro-pixel frame, of the extents' size. `dark_dn`: of its inspection (Inspection::dark_dn). True
    // if it completed a window and latest() is new. Ignores frames with less than a tenth of the sampled lenslets lit.
    bool add(const FrameView& frame, std::uint32_t dark_dn);

    // None until the first window, after the baseline if there is one.
    [[nodiscard]] const std::optional<Drift>& latest() const { return latest_; }

  private:
    DriftEstimator(const Extents& extents, const LightLevels& levels, DriftZero zero);
    struct Sample {
        double x_bins = 0, y_bins = 0;             // position, from the middle of the field
        float base_x = 0, base_y = 0, weight = 0;  // median and 1 / variance of the baseline; weight 0: too few values
        int values = 0;                            // in this window
        bool outermost = false;
        bool lit = false;  // in this frame
    };
    struct WindowMedian {
        float x = 0, y = 0, weight = 0;  // of a lenslet; 1 / variance of the median
    };
    WindowMedian median_of(std::size_t sample);
    void close_window();
    bool outermost_agree(Drift& start);
    void fit(Drift start, bool of_outermost);
    void fit_round(Drift& drift, double& scale, bool first, bool of_outermost);
    // In standard deviations of the sample.
    [[nodiscard]] double residual(const Drift& drift, std::size_t sample) const;

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
    bool has_base_ = false;          // there is a baseline
    bool from_calibration_ = false;  // the baseline is the calibration
    std::int64_t parts_ = 0;
    std::optional<Drift> latest_;
};

}  // namespace hord::algo
