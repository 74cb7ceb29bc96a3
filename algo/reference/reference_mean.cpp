#include "algo/reference/reference_mean.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"
#include "algo/reference/clipped_noise.h"

namespace hord::algo {
namespace {

constexpr double kShareOne = 1 << Reference::kShareBits;
// Standard deviations of a dark bin's mean; less is noise. Its variance is at least a sixteenth of the reading noise
// (docs/notes/reference.md).
constexpr double kNoise = 3;

// Sets bins of a sum of shares to 0 that hold noise only, which makes the comparison faster: bins below `least` without
// a neighbour at or above it, and bins below a third of `least`.
void drop_noise(const Reference& r, std::span<float> bins, double least) {
    const auto limit = static_cast<float>(least);
    std::vector<bool> keep(bins.size());  // the border, too
    for (int j = 0; j < r.extents.j; ++j) {
        for (int i = 0; i < r.extents.i; ++i) {
            if (bins[r.place(i, j)] < limit) continue;
            for (int y = j - 1; y <= j + 1; ++y) {
                for (int x = i - 1; x <= i + 1; ++x) keep[r.place(x, y)] = true;
            }
        }
    }
    for (std::size_t place = 0; place < keep.size(); ++place) {
        if (!keep[place] || bins[place] < limit / 3) bins[place] = 0;
    }
}

}  // namespace

std::size_t ReferenceMean::stride_of(const Extents& extents) {
    Reference r;
    r.extents = extents;
    return r.stride();
}

void ReferenceMean::clear() {
    const std::size_t count = extents_.lenslets();
    shares_.assign(count * stride_of(extents_), 0);
    light_.assign(count, 0);
    light_count_.assign(count, 0);
    hord_count_.assign(count, 0);
}

void ReferenceMean::sum_up(const DecodedPart& part, const PoseMap& pose, double light, int sign) {
    const std::size_t stride = stride_of(extents_);
    const auto count = static_cast<std::uint16_t>(sign);  // -1 wraps
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            const auto p = pose.to_part(m, n);
            const auto window_without = [&](std::uint8_t bits) {
                return InterpolationWindow::of(
                    p.m, p.n, extents_, [&](int x, int y) { return (part.mask[extents_.index(x, y)] & bits) == 0; });
            };
            auto near = window_without(kNoHord);
            const bool dark = !near.found;
            if (dark) {
                near = window_without(kSaturated);
                if (!near.found) continue;
                near.along = CubicWeights::linear_at(p.m - std::floor(p.m)),
                near.across = CubicWeights::linear_at(p.n - std::floor(p.n));
            }
            float* to = shares_.data() + k * stride;
            double sum = 0;
            for (int r = 0; r < 4; ++r) {
                for (int c = 0; c < 4; ++c) {
                    const double w = near.along.of[c] * near.across.of[r];
                    if (w == 0) continue;
                    const std::size_t from = extents_.index(near.m + c, near.n + r);
                    sum += w * static_cast<double>(part.sums[from]);
                    if (dark) continue;
                    const std::uint16_t* share = part.shares.data() + from * stride;
                    const auto weight = static_cast<float>(sign * w);
                    for (std::size_t b = 0; b < stride; ++b) to[b] += weight * static_cast<float>(share[b]);
                }
            }
            light_[k] += sign * sum / light;
            light_count_[k] = static_cast<std::uint16_t>(light_count_[k] + count);
            if (!dark) hord_count_[k] = static_cast<std::uint16_t>(hord_count_[k] + count);
        }
    }
}

void ReferenceMean::finish(double parts, double light, Reference& r) const {
    const std::size_t count = extents_.lenslets(), stride = r.stride();
    r.parts = static_cast<std::uint32_t>(parts);
    r.shares.assign(count * stride, 0);
    r.light.assign(count, 0);
    r.x.assign(count, 0);
    r.y.assign(count, 0);
    r.mask.assign(count, kOutside);
    const double read = static_cast<double>(r.sensor.read_dn), reading = read * read + 1.0 / 12;
    const ClippedNoise dark = clipped_noise(reading, static_cast<double>(r.sensor.clip_dn));
    const double least_dn =
        std::max(kNoise * std::sqrt(reading / 16 / parts), dark.mean + kNoise * std::sqrt(dark.variance / parts));
    std::vector<float> bins(stride);
    for (std::size_t k = 0; k < count; ++k) {
        if (2 * light_count_[k] < parts) continue;
        r.mask[k] = kDark;
        r.light[k] = static_cast<float>(std::max(0.0, light_[k] / light_count_[k] * light));
        if (2 * hord_count_[k] < parts) continue;
        std::copy_n(shares_.data() + k * stride, stride, bins.data());
        if (r.light[k] > 0)
            drop_noise(r, bins, hord_count_[k] * least_dn / static_cast<double>(r.light[k]) * kShareOne);
        double sum = 0, x = 0, y = 0;
        for (int b = 0; b < extents_.bins(); ++b) {
            const int i = b % extents_.i, j = b / extents_.i;
            const double share = std::max(0.0, static_cast<double>(bins[r.place(i, j)]));
            sum += share;
            x += share * (i - 0.5 * (extents_.i - 1));
            y += share * (j - 0.5 * (extents_.j - 1));
        }
        if (!(sum > 0)) continue;
        r.mask[k] = kValid;
        r.x[k] = static_cast<float>(x / sum);
        r.y[k] = static_cast<float>(y / sum);
        for (std::size_t b = 0; b < stride; ++b) {
            const long share = std::lround(std::max(0.0, static_cast<double>(bins[b])) / sum * kShareOne);
            r.shares[k * stride + b] = static_cast<std::uint16_t>(std::min(share, long{Reference::kMaxShare}));
        }
    }
}

}  // namespace hord::algo
