// Monitors drift of the lenslet grid at run time, from every inspected frame.
#pragma once

#include <memory>
#include <mutex>
#include <optional>

#include "algo/ageing/drift.h"

namespace hord::firmware {

// Drift is reported from here on. The requirement is 0.1 px; a fifth of it is margin for the estimate's error.
inline constexpr double kDriftNoticedPx = 0.08;
// Reported drift is over below this (hysteresis).
inline constexpr double kDriftGonePx = 0.06;

class DriftMonitor {
  public:
    // For macro-pixel frames. `px_a_bin`: sensor pixels a bin; 1 if the sensor delivers macro-pixels.
    static Result<std::unique_ptr<DriftMonitor>> create(const algo::Extents& extents, const algo::LightLevels& levels,
                                                        algo::DriftZero zero, double px_a_bin);

    // Any thread. True when `noticed` has changed.
    bool add(const FrameView& frame, std::uint32_t dark_dn);

    struct View {
        std::optional<double> largest_px;  // largest shift in the field; empty: too few parts yet
        bool since_calibration = false;    // else since the first parts
        bool noticed = false;
    };
    [[nodiscard]] View view() const;  // any thread

  private:
    DriftMonitor(algo::DriftEstimator estimator, double px_a_bin)
        : estimator_(std::move(estimator)), px_a_bin_(px_a_bin) {}
    mutable std::mutex mutex_;
    algo::DriftEstimator estimator_;
    double px_a_bin_;
    bool noticed_ = false;
};

}  // namespace hord::firmware
