// Watches the lenslet grid while the station works: fed with every inspected frame, from any thread; says when the grid has moved.
#pragma once

#include <memory>
#include <mutex>
#include <optional>

#include "algo/drift.h"

namespace hord::firmware {

// From here on drift is reported. What must not go unnoticed is 0.1 px; a fifth of it is left for the estimate's own error.
inline constexpr double kDriftNoticedPx = 0.08;

class DriftWatch {
  public:
    // Of macro-pixel frames, a bin of which is a pixel.
    static Result<std::unique_ptr<DriftWatch>> create(const algo::Extents& extents, const algo::LightLevels& levels);

    // Any thread. True when this frame made the watch change its mind.
    bool add(const algo::FrameView& frame);

    struct View {
        std::optional<algo::Drift> drift;  // none: too few parts yet
        bool noticed = false;
    };
    [[nodiscard]] View view() const;  // any thread

  private:
    explicit DriftWatch(algo::DriftEstimator estimator) : estimator_(std::move(estimator)) {}
    mutable std::mutex mutex_;
    algo::DriftEstimator estimator_;
    bool noticed_ = false;
};

}  // namespace hord::firmware
