#include "algo/inspection/flaw_size.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kBeside = 1, kRing = 3;     // lenslets from the region: to here the flaw; to here the light around it
constexpr std::size_t kMinRing = 8;       // lenslets
constexpr double kSure = 2;               // standard errors
constexpr double kMadToDeviation = 1.48;  // of a normal distribution
constexpr std::uint8_t kFar = 255;

}  // namespace

FlawSizer::FlawSizer(const Reference& reference)
    : reference_(reference), sampler_(reference, widest_isa()), bins_(reference.stride()),
      distance_(reference.extents.lenslets(), kFar) {
    constexpr std::size_t kMost = kMaxLenslets * (2 * kRing + 1) * (2 * kRing + 1);
    const std::size_t most = std::min(kMost, distance_.size());
    near_.reserve(most), ring_.reserve(most), shares_.reserve(most);
}

// Fills near_ and distance_.
void FlawSizer::gather(std::span<const std::uint32_t> region) {
    for (const std::uint32_t k : near_) distance_[k] = kFar;
    near_.clear();
    const Extents& e = reference_.extents;
    for (const std::uint32_t k : region) {
        const int m = static_cast<int>(k) % e.m, n = static_cast<int>(k) / e.m;
        e.for_each_around(m, n, kRing, [&](int x, int y) {
            const auto at = static_cast<std::uint32_t>(e.index(x, y));
            const auto distance = static_cast<std::uint8_t>(std::max(std::abs(x - m), std::abs(y - n)));
            if (distance_[at] == kFar) near_.push_back(at);
            distance_[at] = std::min(distance_[at], distance);
        });
    }
}

// Empty if the reference has no HORD there.
std::optional<double> FlawSizer::displaced_share(const ComparedLight& seen, const PoseMap& pose, std::uint32_t k) {
    const Extents& e = reference_.extents;
    const int m = static_cast<int>(k) % e.m, n = static_cast<int>(k) / e.m;
    const auto q = pose.to_reference(m, n);
    const ReferenceSampler::ReferenceHord expected = sampler_.read(q.m, q.n, seen.light, bins_.data());
    if (!expected.has_hord) return std::nullopt;
    double lacking = 0, all = 0;
    for (int j = expected.lit.bins.top; j <= expected.lit.bins.bottom; ++j) {
        for (int i = expected.lit.bins.left; i <= expected.lit.bins.right; ++i) {
            const auto place = static_cast<int>(reference_.place(i, j));
            if (place < expected.written.first || place >= expected.written.end()) continue;
            const double light = expected.light * static_cast<double>(bins_[static_cast<std::size_t>(place)]);
            const std::uint32_t sample = seen.frame.sample(m * e.i + i, n * e.j + j);
            const double here = sample > seen.dark ? sample - seen.dark : 0;
            all += light, lacking += std::max(0.0, light - here);
        }
    }
    if (!(all > 0)) return std::nullopt;
    return lacking / all;
}

std::optional<FlawSize> FlawSizer::measure_gathered(const ComparedLight& seen, const PoseMap& pose) {
    if (ring_.size() < kMinRing) return std::nullopt;
    shares_.clear();
    for (const std::uint32_t k : ring_) {
        if (const auto share = displaced_share(seen, pose, k)) shares_.push_back(*share);
    }
    if (shares_.size() < kMinRing) return std::nullopt;
    const double usual = common::lower_median(std::span(shares_));
    for (double& share : shares_) share = std::abs(share - usual);
    const double noise = kMadToDeviation * common::lower_median(std::span(shares_));

    // Moments of the displaced light.
    const int columns = reference_.extents.m;
    FlawSize size;
    double mm = 0, nn = 0, mn = 0;
    const auto each = [&](auto&& visit) {
        std::size_t at = 0;
        for (const std::uint32_t k : near_) {
            if (distance_[k] <= kBeside) visit(at++, static_cast<int>(k) % columns, static_cast<int>(k) / columns, k);
        }
    };
    shares_.clear();
    each([&](std::size_t, int m, int n, std::uint32_t k) {
        // A share of 1 stays 1: there is no light left that noise could move.
        const double share = (displaced_share(seen, pose, k).value_or(usual) - usual) / (1 - std::min(usual, 0.9));
        shares_.push_back(share);
        size.area += share, size.m += share * m, size.n += share * n;
    });
    if (!(size.area > 0)) return std::nullopt;
    size.m /= size.area, size.n /= size.area;
    each([&](std::size_t at, int m, int n, std::uint32_t) {
        const double share = shares_[at] / size.area, dm = m - size.m, dn = n - size.n;
        mm += share * dm * dm, nn += share * dn * dn, mn += share * dm * dn;
    });
    // A disc of radius R that takes all light: the area is pi R^2. The second moments say R, too, whatever share of the
    // light it takes: each is R^2 / 4, and 1/12 because a lenslet is a square. With noise the first is surer.
    const double by_area = size.area * std::numbers::inv_pi, by_moments = 2 * (mm + nn - 1.0 / 6);
    double error = 0;
    each([&](std::size_t, int m, int n, std::uint32_t) {
        const double dm = m - size.m, dn = n - size.n, lever = dm * dm + dn * dn - mm - nn;
        error += lever * lever;
    });
    error = 2 * noise * std::sqrt(error) / size.area;
    // A disc of that radius and light displaces nowhere a larger share than that.
    const bool weak = by_moments - kSure * error > by_area &&
        *std::ranges::max_element(shares_) <= by_area / by_moments + kSure * noise;
    size.radius = std::sqrt(weak ? by_moments : by_area);
    const double middle = (mm + nn) / 2, half = std::sqrt((mm - nn) * (mm - nn) / 4 + mn * mn);
    size.length = std::sqrt(std::max(0.0, 12 * (middle + half) - 1));
    return size;
}

}  // namespace hord::algo
