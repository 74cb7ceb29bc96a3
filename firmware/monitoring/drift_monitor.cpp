#include "firmware/monitoring/drift_monitor.h"

namespace hord::firmware {

Result<std::unique_ptr<DriftMonitor>> DriftMonitor::create(const algo::Extents& extents,
                                                           const algo::LightLevels& levels, algo::DriftZero zero,
                                                           double px_a_bin) {
    auto estimator = algo::DriftEstimator::create(extents, levels, zero);
    if (!estimator) return tl::unexpected(estimator.error());
    return std::unique_ptr<DriftMonitor>(new DriftMonitor(std::move(*estimator), px_a_bin));
}

bool DriftMonitor::add(const FrameView& frame, std::uint32_t dark_dn) {
    const std::lock_guard lock(mutex_);
    if (!estimator_.add(frame, dark_dn)) return false;
    const bool before = noticed_;
    const algo::Drift& drift = *estimator_.latest();
    const double px = drift.largest_bins * px_a_bin_;
    // Three standard deviations prevent false alarms of a noisy estimate.
    if (before) noticed_ = px >= kDriftGonePx;
    else noticed_ = px >= kDriftNoticedPx && drift.largest_bins > 3 * drift.noise_bins;
    return noticed_ != before;
}

DriftMonitor::View DriftMonitor::view() const {
    const std::lock_guard lock(mutex_);
    const auto& latest = estimator_.latest();
    if (!latest) return {};
    return {latest->largest_bins * px_a_bin_, latest->since_calibration, noticed_};
}

}  // namespace hord::firmware
