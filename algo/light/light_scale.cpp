#include "algo/light/light_scale.h"

#include <algorithm>
#include <cmath>

#include "algo/light/dark_bins.h"

namespace hord::algo {

LightScale::LightScale() {
    for (int k = 0; k <= kSteps; ++k) left_[static_cast<std::size_t>(k)] = static_cast<double>(k) / kSteps;
}

LightScale::LightScale(const FrameView& frame, const Extents& extents, std::span<const std::uint32_t> free_light,
                       double pedestal_dn, double dark_dn)
    : LightScale() {
    std::array<double, static_cast<std::size_t>(kMaxBins) * kMaxBins> spot{};  // DN above the pedestal
    for (const std::uint32_t k : free_light) {
        const int x = static_cast<int>(k) % extents.m * extents.i, y = static_cast<int>(k) / extents.m * extents.j;
        std::size_t b = 0;
        for (int j = 0; j < extents.j; ++j) {
            for (int i = 0; i < extents.i; ++i, ++b) spot[b] += frame.sample(x + i, y + j);
        }
    }
    const auto bins = std::span(spot).first(static_cast<std::size_t>(extents.bins()));
    for (double& light : bins)
        light = light / static_cast<double>(std::max<std::size_t>(free_light.size(), 1)) - pedestal_dn;
    std::array<double, kSteps + 1> sums{};
    std::array<Shift, kSteps + 1> means{};
    for (int k = kSteps; k >= 0; --k) {
        const auto at = static_cast<std::size_t>(k);
        double x = 0, y = 0;
        int b = 0;
        for (const double light : bins) {
            const double left = std::max(0.0, light * k / kSteps - (dark_dn - pedestal_dn));
            sums[at] += left;
            x += left * (b % extents.i), y += left * (b / extents.i);
            ++b;
        }
        means[at] = sums[at] > 0 ? Shift{x / sums[at], y / sums[at]} : means[std::min<std::size_t>(at + 1, kSteps)];
    }
    if (!(sums.back() > 0)) return;
    for (std::size_t k = 0; k < sums.size(); ++k) {
        left_[k] = sums[k] / sums.back();
        shift_[k] = {means[k].x - means.back().x, means[k].y - means.back().y};
    }
}

double LightScale::left(double share) const {
    const int k = std::clamp(static_cast<int>(share * kSteps), 0, kSteps - 1);
    const double below = left_[static_cast<std::size_t>(k)], above = left_[static_cast<std::size_t>(k) + 1];
    return std::max(0.0, below + (above - below) * (share * kSteps - k));
}

double LightScale::share(double left) const {
    // The last step that leaves no more, so that what leaves nothing is the largest such share.
    const auto above = std::upper_bound(left_.begin(), left_.end() - 1, left);
    const auto k = std::max<std::ptrdiff_t>(above - left_.begin(), 1) - 1;
    const double low = left_[static_cast<std::size_t>(k)], high = left_[static_cast<std::size_t>(k) + 1];
    return (static_cast<double>(k) + (left - low) / (high - low)) / kSteps;
}

LightScale::Shift LightScale::shift(double share) const {
    return shift_[static_cast<std::size_t>(std::clamp(std::lround(share * kSteps), 0L, static_cast<long>(kSteps)))];
}

}  // namespace hord::algo
