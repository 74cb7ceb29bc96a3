#include "firmware/drift_watch.h"

namespace hord::firmware {

Result<std::unique_ptr<DriftWatch>> DriftWatch::create(const algo::Extents& extents, const algo::LightLevels& levels) {
    auto estimator = algo::DriftEstimator::create(extents, levels);
    if (!estimator) return tl::unexpected(estimator.error());
    return std::unique_ptr<DriftWatch>(new DriftWatch(std::move(*estimator)));
}

bool DriftWatch::add(const algo::FrameView& frame) {
    const std::lock_guard lock(mutex_);
    if (!estimator_.add(frame)) return false;
    const bool before = noticed_;
    // Three standard deviations keep a noisy estimate from crying wolf.
    const algo::Drift& drift = *estimator_.latest();
    noticed_ = drift.largest_bins >= kDriftNoticedPx && drift.largest_bins > 3 * drift.noise_bins;
    return noticed_ != before;
}

DriftWatch::View DriftWatch::view() const {
    const std::lock_guard lock(mutex_);
    return {estimator_.latest(), noticed_};
}

}  // namespace hord::firmware
