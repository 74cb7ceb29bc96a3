#include "algo/drift.h"

#include <algorithm>
#include <cmath>

#include "algo/deflection.h"

namespace hord::algo {
namespace {

constexpr float kLeastSigma = 0.005F;  // bins: of a median, below which lenslets are trusted alike
constexpr int kRounds = 8;
constexpr int kLeastSeen = DriftEstimator::kWindow / 2;

std::vector<int> spread(int count, int most) {
    std::vector<int> out;
    const int taken = std::min(count, most);
    for (int k = 0; k < taken; ++k) out.push_back(static_cast<int>((k + 0.5) * count / taken));
    return out;
}

float median(float* values, int count) {
    std::nth_element(values, values + count / 2, values + count);
    return values[count / 2];
}

}  // namespace

DriftEstimator::DriftEstimator(const Extents& extents, const LightLevels& levels)
    : extents_(extents), levels_(levels), row_(extents), columns_(spread(extents.m, kSampled)), rows_(spread(extents.n, kSampled)),
      samples_(columns_.size() * rows_.size()), window_x_(samples_.size() * kWindow), window_y_(window_x_.size()), shift_x_(samples_.size()),
      shift_y_(samples_.size()), trust_(samples_.size()), scratch_(kWindow) {
    residuals_.reserve(samples_.size());
    std::size_t k = 0;
    for (const int n : rows_) {
        for (const int m : columns_) {
            samples_[k].x_bins = (m - 0.5 * (extents.m - 1)) * extents.i;
            samples_[k].y_bins = (n - 0.5 * (extents.n - 1)) * extents.j;
            ++k;
        }
    }
}

Result<DriftEstimator> DriftEstimator::create(const Extents& extents, const LightLevels& levels) {
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    return DriftEstimator(extents, levels);
}

void DriftEstimator::restart() {
    for (Sample& sample : samples_) sample.seen = 0;
    in_window_ = 0;
    has_base_ = false;
    parts_ = 0;
    latest_.reset();
}

bool DriftEstimator::add(const FrameView& frame) {
    std::size_t lit = 0;
    std::size_t k = 0;
    for (const int n : rows_) {
        hord::algo::decode_row(frame, extents_, levels_, n, row_);
        for (const int m : columns_) {
            const auto at = static_cast<std::size_t>(m);
            Sample& sample = samples_[k];
            if (row_.has_hord(m)) {
                const Deflection d = mean_deflection(row_.sums()[at], row_.moments_x()[at], row_.moments_y()[at]);
                const std::size_t place = k * kWindow + static_cast<std::size_t>(sample.seen);
                window_x_[place] = d.x.to_float_rounded();
                window_y_[place] = d.y.to_float_rounded();
                ++sample.seen;
                ++lit;
            }
            ++k;
        }
    }
    if (lit * 10 < samples_.size()) {  // a dark frame says nothing: take back what little it said
        k = 0;
        for (const int n : rows_) {
            hord::algo::decode_row(frame, extents_, levels_, n, row_);
            for (const int m : columns_) {
                if (row_.has_hord(m)) --samples_[k].seen;
                ++k;
            }
        }
        return false;
    }
    ++parts_;
    if (++in_window_ < kWindow) return false;
    const bool estimated = has_base_;
    close_window();
    return estimated;
}

void DriftEstimator::close_window() {
    for (std::size_t k = 0; k < samples_.size(); ++k) {
        Sample& sample = samples_[k];
        trust_[k] = 0;
        const bool enough = sample.seen >= kLeastSeen;
        const auto middle_of = [&](const std::vector<float>& window) {
            std::copy_n(window.begin() + static_cast<std::ptrdiff_t>(k * kWindow), sample.seen, scratch_.begin());
            return median(scratch_.data(), sample.seen);
        };
        if (enough && !has_base_) {
            sample.base_x = middle_of(window_x_);
            sample.base_y = middle_of(window_y_);
            // The median distance from the median, as a standard deviation of the median of a window.
            for (int part = 0; part < sample.seen; ++part) {
                const auto place = k * kWindow + static_cast<std::size_t>(part);
                scratch_[static_cast<std::size_t>(part)] =
                    std::max(std::abs(window_x_[place] - sample.base_x), std::abs(window_y_[place] - sample.base_y));
            }
            const float sigma = std::max(kLeastSigma, 1.4826F * 1.2533F * median(scratch_.data(), sample.seen) / std::sqrt(static_cast<float>(sample.seen)));
            sample.weight = 1 / (sigma * sigma);
        } else if (enough && sample.weight > 0) {
            shift_x_[k] = middle_of(window_x_) - sample.base_x;
            shift_y_[k] = middle_of(window_y_) - sample.base_y;
            trust_[k] = sample.weight;
        } else if (!has_base_) {
            sample.weight = 0;
        }
        sample.seen = 0;
    }
    in_window_ = 0;
    if (has_base_) fit(parts_);
    has_base_ = true;
}

// A similarity, reweighted: closed form each round.
void DriftEstimator::fit(std::int64_t parts) {
    Drift drift;
    drift.parts = parts;
    double scale = 0;  // of normalised residuals
    for (int round = 0; round < kRounds; ++round) {
        double sum = 0, x = 0, y = 0, dx = 0, dy = 0;
        const auto weight_of = [&](std::size_t k) {
            if (trust_[k] == 0 || round == 0) return trust_[k];
            const double rx = shift_x_[k] - (drift.shift_x_bins + drift.growth * samples_[k].x_bins - drift.turn_rad * samples_[k].y_bins);
            const double ry = shift_y_[k] - (drift.shift_y_bins + drift.turn_rad * samples_[k].x_bins + drift.growth * samples_[k].y_bins);
            const double far = std::sqrt((rx * rx + ry * ry) * trust_[k]) / scale;
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
        Drift next = drift;
        next.growth = moment > 0 ? growth / moment : 0;
        next.turn_rad = moment > 0 ? turn / moment : 0;
        next.shift_x_bins = dx - next.growth * x + next.turn_rad * y;
        next.shift_y_bins = dy - next.turn_rad * x - next.growth * y;
        drift = next;
        // The median normalised residual, as a standard deviation (of a Rayleigh distance).
        residuals_.clear();
        for (std::size_t k = 0; k < samples_.size(); ++k) {
            if (trust_[k] == 0) continue;
            const double rx = shift_x_[k] - (drift.shift_x_bins + drift.growth * samples_[k].x_bins - drift.turn_rad * samples_[k].y_bins);
            const double ry = shift_y_[k] - (drift.shift_y_bins + drift.turn_rad * samples_[k].x_bins + drift.growth * samples_[k].y_bins);
            residuals_.push_back(std::sqrt((rx * rx + ry * ry) * trust_[k]));
        }
        const auto middle = residuals_.begin() + static_cast<std::ptrdiff_t>(residuals_.size() / 2);
        std::nth_element(residuals_.begin(), middle, residuals_.end());
        scale = std::max(*middle / 1.1774, 1e-3);
        drift.noise_bins = scale / std::sqrt(sum);
    }
    for (const double sx : {-1.0, 1.0}) {
        for (const double sy : {-1.0, 1.0}) {
            const double px = sx * 0.5 * (extents_.m - 1) * extents_.i, py = sy * 0.5 * (extents_.n - 1) * extents_.j;
            drift.largest_bins = std::max(drift.largest_bins, std::hypot(drift.shift_x_bins + drift.growth * px - drift.turn_rad * py,
                                                                         drift.shift_y_bins + drift.turn_rad * px + drift.growth * py));
        }
    }
    // At a corner the fit is as uncertain as three parameters together: shift, turn and growth weigh about alike there.
    drift.noise_bins *= 2;
    latest_ = drift;
}

}  // namespace hord::algo
