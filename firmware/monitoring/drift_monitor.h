// Watches the lenslet grid while the station works: fed with every inspected frame, from any thread; says when the grid
// has moved.
#pragma once

#include <memory>
#include <mutex>
#include <optional>

#include "algo/ageing/drift.h"

namespace hord::firmware {

// From here on drift is reported. What must not go unnoticed is 0.1 px; a fifth of it is left for the estimate's own
// error.
inline constexpr double kDriftNoticedPx = 0.08;
// What was reported is over below this; in between nothing changes.
inline constexpr double kDriftGonePx = 0.06;

class DriftMonitor {
  public:
    // Of macro-pixel frames. `px_a_bin`: of the sensor; 1 where its own frames are macro-pixels.
    static Result<std::unique_ptr<DriftMonitor>> create(const algo::Extents& extents, const algo::LightLevels& levels,
                                                        algo::DriftZero zero, double px_a_bin);

    // Any thread. True when this frame made the watch change its mind.
    bool add(const FrameView& frame);

    struct View {
        std::optional<double> largest_px;  // of the shift, anywhere in the field; none: too few parts yet
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
