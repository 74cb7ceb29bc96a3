#include "algo/ageing/drift.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "algo/ageing/subsample.h"
#include "algo/features/deflection.h"
#include "algo/inspection/rim.h"

namespace hord::algo {
namespace {

constexpr float kMinSigma = 0.005F;  // bins: least standard deviation of a lenslet's median
constexpr int kRounds = 8;
constexpr int kMinSeen = DriftEstimator::kWindow / 2;

}  // namespace

DriftEstimator::DriftEstimator(const Extents& extents, const LightLevels& levels, DriftZero zero)
    : extents_(extents), levels_(levels), row_(extents), columns_(spread(extents.m, kSampled)),
      rows_(spread(extents.n, kSampled)), samples_(columns_.size() * rows_.size()),
      window_x_(samples_.size() * kWindow), window_y_(window_x_.size()), shift_x_(samples_.size()),
      shift_y_(samples_.size()), trust_(samples_.size()), scratch_(std::max(samples_.size(), std::size_t{kWindow})),
      zero_(zero) {
    residuals_.reserve(samples_.size());
    std::size_t k = 0;
    for (const int n : rows_) {
        for (const int m : columns_) {
            samples_[k].x_bins = (m - 0.5 * (extents.m - 1)) * extents.i;
            samples_[k].y_bins = (n - 0.5 * (extents.n - 1)) * extents.j;
            samples_[k].outermost =
                m == columns_.front() || m == columns_.back() || n == rows_.front() || n == rows_.back();
            ++k;
        }
    }
}

Result<DriftEstimator> DriftEstimator::create(const Extents& extents, const LightLevels& levels, DriftZero zero) {
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    return DriftEstimator(extents, levels, zero);
}

bool DriftEstimator::add(const FrameView& frame, std::uint32_t dark_dn) {
    levels_.dark = dark_dn;
    std::size_t lit = 0, k = 0;
    for (const int n : rows_) {
        decode_row(frame, extents_, levels_, n, row_);
        for (const int m : columns_) {
            Sample& sample = samples_[k];
            sample.lit = row_.has_hord(m);
            if (sample.lit) {
                const auto at = static_cast<std::size_t>(m);
                const Deflection d = mean_deflection(row_.sums()[at], row_.moments_x()[at], row_.moments_y()[at]);
                const std::size_t place = k * kWindow + static_cast<std::size_t>(sample.values);
                window_x_[place] = d.x.to_float_rounded();
                window_y_[place] = d.y.to_float_rounded();
                ++lit;
            }
            ++k;
        }
    }
    if (lit * 10 < samples_.size()) return false;  // a dark frame: the next one overwrites its values
    for (Sample& sample : samples_) sample.values += sample.lit ? 1 : 0;
    ++parts_;
    if (++in_window_ < kWindow) return false;
    const std::optional<Drift> before = std::exchange(latest_, std::nullopt);
    close_window();
    if (latest_) return true;
    latest_ = before;
    return false;
}

// The median of one lenslet over this window; weight 0 if there are too few values.
DriftEstimator::WindowMedian DriftEstimator::median_of(std::size_t k) {
    const int values = samples_[k].values;
    if (values < kMinSeen) return {};
    const auto first = static_cast<std::ptrdiff_t>(k * kWindow);
    const auto middle_of = [&](const std::vector<float>& window) {
        std::copy_n(window.begin() + first, values, scratch_.begin());
        return median(scratch_.data(), values);
    };
    WindowMedian centre;
    centre.x = middle_of(window_x_);
    centre.y = middle_of(window_y_);
    // The standard deviation of the window's median, from the median distance to it.
    for (int part = 0; part < values; ++part) {
        const auto place = k * kWindow + static_cast<std::size_t>(part);
        scratch_[static_cast<std::size_t>(part)] =
            std::max(std::abs(window_x_[place] - centre.x), std::abs(window_y_[place] - centre.y));
    }
    const float sigma = std::max(
        kMinSigma, 1.4826F * 1.2533F * median(scratch_.data(), values) / std::sqrt(static_cast<float>(values)));
    centre.weight = 1 / (sigma * sigma);
    return centre;
}

void DriftEstimator::close_window() {
    const bool undecided = zero_ == DriftZero::calibration && !has_base_;
    for (std::size_t k = 0; k < samples_.size(); ++k) {
        Sample& sample = samples_[k];
        const WindowMedian centre = median_of(k);
        sample.values = 0;
        trust_[k] = 0;
        if (!has_base_) {
            sample.base_x = centre.x;
            sample.base_y = centre.y;
            sample.weight = centre.weight;
        }
        if (centre.weight > 0 && (undecided || from_calibration_)) {
            shift_x_[k] = centre.x;
            shift_y_[k] = centre.y;
            trust_[k] = centre.weight;
        } else if (centre.weight > 0 && has_base_ && sample.weight > 0) {
            shift_x_[k] = centre.x - sample.base_x;
            shift_y_[k] = centre.y - sample.base_y;
            trust_[k] = sample.weight;
        }
    }
    in_window_ = 0;
    if (undecided || from_calibration_) {
        Drift start;
        start.since_calibration = true;
        const bool agree = outermost_agree(start);
        if (undecided) from_calibration_ = agree;
        if (agree) fit(start, true);
    } else if (has_base_) {
        fit({}, false);
    }
    has_base_ = true;
}

// True if the outermost lenslets show free light: at least half of them agree. Sets `start` to their median.
bool DriftEstimator::outermost_agree(Drift& start) {
    int outermost = 0;
    const auto median_of = [&](const std::vector<double>& shifts) {
        int count = 0;
        outermost = 0;
        for (std::size_t k = 0; k < samples_.size(); ++k) {
            if (!samples_[k].outermost) continue;
            ++outermost;
            if (trust_[k] > 0) scratch_[static_cast<std::size_t>(count++)] = static_cast<float>(shifts[k]);
        }
        return 2 * count < outermost ? std::numeric_limits<float>::infinity() : median(scratch_.data(), count);
    };
    start.shift_x_bins = median_of(shift_x_);
    start.shift_y_bins = median_of(shift_y_);
    if (!std::isfinite(start.shift_x_bins)) return false;
    int alike = 0;
    for (std::size_t k = 0; k < samples_.size(); ++k) {
        if (samples_[k].outermost && trust_[k] > 0 &&
            std::abs(shift_x_[k] - start.shift_x_bins) <= kFreeToleranceBins &&
            std::abs(shift_y_[k] - start.shift_y_bins) <= kFreeToleranceBins) {
            ++alike;
        }
    }
    return 2 * alike >= outermost;
}

double DriftEstimator::residual(const Drift& drift, std::size_t k) const {
    const double rx =
        shift_x_[k] - (drift.shift_x_bins + drift.growth * samples_[k].x_bins - drift.turn_rad * samples_[k].y_bins);
    const double ry =
        shift_y_[k] - (drift.shift_y_bins + drift.turn_rad * samples_[k].x_bins + drift.growth * samples_[k].y_bins);
    return std::sqrt((rx * rx + ry * ry) * trust_[k]);
}

// One iteration of reweighted least squares for a similarity, in closed form. `scale`: the residuals' standard
// deviation, updated.
void DriftEstimator::fit_round(Drift& drift, double& scale, bool first, bool of_outermost) {
    double sum = 0, x = 0, y = 0, dx = 0, dy = 0;
    const auto weight_of = [&](std::size_t k) {
        if (trust_[k] == 0 || (of_outermost && !samples_[k].outermost)) return 0.0;
        if (first) return trust_[k];
        const double far = residual(drift, k) / scale;
        const double near = 1 - far * far / 36;
        return near > 0 ? trust_[k] * near * near : 0.0;
    };
    for (std::size_t k = 0; k < samples_.size(); ++k) {
        const double w = weight_of(k);
        sum += w;
        x += w * samples_[k].x_bins;
        y += w * samples_[k].y_bins;
        dx += w * shift_x_[k];
        dy += w * shift_y_[k];
    }
    if (!(sum > 0)) return;
    x /= sum, y /= sum, dx /= sum, dy /= sum;
    double moment = 0, growth = 0, turn = 0;
    for (std::size_t k = 0; k < samples_.size(); ++k) {
        const double w = weight_of(k);
        const double px = samples_[k].x_bins - x, py = samples_[k].y_bins - y;
        const double qx = shift_x_[k] - dx, qy = shift_y_[k] - dy;
        moment += w * (px * px + py * py);
        growth += w * (px * qx + py * qy);
        turn += w * (px * qy - py * qx);
    }
    drift.growth = moment > 0 ? growth / moment : 0;
    drift.turn_rad = moment > 0 ? turn / moment : 0;
    drift.shift_x_bins = dx - drift.growth * x + drift.turn_rad * y;
    drift.shift_y_bins = dy - drift.turn_rad * x - drift.growth * y;
    drift.noise_bins = scale / std::sqrt(sum);
}

// Against the calibration, first the outermost lenslets, then all that follow the fit. Against a baseline, all at once.
void DriftEstimator::fit(Drift drift, bool from_outermost) {
    drift.parts = parts_;
    double scale = 0;
    // The standard deviation from the median residual (Rayleigh distribution).
    const auto measure_scale = [&] {
        residuals_.clear();
        for (std::size_t k = 0; k < samples_.size(); ++k) {
            if (trust_[k] > 0 && (!from_outermost || samples_[k].outermost)) residuals_.push_back(residual(drift, k));
        }
        if (residuals_.empty()) return;
        scale = std::max(common::upper_median(std::span(residuals_)) / 1.1774, 1e-3);
    };
    if (from_outermost) measure_scale();  // about their median
    for (int round = 0; round < kRounds; ++round) {
        fit_round(drift, scale, !from_outermost && round == 0, from_outermost);
        measure_scale();
    }
    if (from_outermost) {
        for (int round = 0; round < kRounds; ++round) fit_round(drift, scale, false, false);
    }
    if (scale == 0) return;
    for (const double sx : {-1.0, 1.0}) {
        for (const double sy : {-1.0, 1.0}) {
            const double px = sx * 0.5 * (extents_.m - 1) * extents_.i, py = sy * 0.5 * (extents_.n - 1) * extents_.j;
            drift.largest_bins = std::max(drift.largest_bins,
                                          std::hypot(drift.shift_x_bins + drift.growth * px - drift.turn_rad * py,
                                                     drift.shift_y_bins + drift.turn_rad * px + drift.growth * py));
        }
    }
    // At a corner shift, turn and growth contribute about equally to the error of the fit.
    drift.noise_bins *= 2;
    latest_ = drift;
}

}  // namespace hord::algo
