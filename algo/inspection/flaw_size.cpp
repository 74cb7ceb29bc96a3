#include "algo/inspection/flaw_size.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kRing = 3;                  // lenslets from the region: from kBeside to here is the light around it
constexpr std::size_t kMinRing = 8;       // lenslets
constexpr double kSure = 2;               // standard errors
constexpr double kMadToDeviation = 1.48;  // of a normal distribution
constexpr std::uint8_t kFar = 255;
constexpr double kLargestOf = 3;     // standard errors, of the largest of some dozens of values
constexpr double kStep = 1.02;       // from one radius that is tried to the next
constexpr int kPlaces = 4;           // places of the opaque disc that are tried beside the centroid, each way
constexpr double kPlaceStep = 0.07;  // lenslets
constexpr double kMinOpacity = 0.02;
constexpr double kHalfDiagonal = 0.7072;  // of a lenslet

// The share of a lenslet within a disc whose middle is (dm, dn) lenslets from the lenslet's, by 8x8 points.
double covered(double dm, double dn, double radius) {
    const double distance = std::sqrt(dm * dm + dn * dn);
    if (distance + kHalfDiagonal <= radius) return 1;
    if (distance - kHalfDiagonal >= radius) return 0;
    constexpr int kPoints = 8;
    int inside = 0;
    for (int y = 0; y < kPoints; ++y) {
        for (int x = 0; x < kPoints; ++x) {
            const double h = dm + (x + 0.5) / kPoints - 0.5, v = dn + (y + 0.5) / kPoints - 0.5;
            inside += h * h + v * v < radius * radius ? 1 : 0;
        }
    }
    return static_cast<double>(inside) / (kPoints * kPoints);
}

}  // namespace

FlawSizer::FlawSizer(const Reference& reference)
    : reference_(reference), sampler_(reference, widest_isa()), bins_(reference.stride()),
      distance_(reference.extents.lenslets(), kFar) {
    constexpr std::size_t kMaxPlaces = kMaxLenslets * (2 * kRing + 1) * (2 * kRing + 1);
    const std::size_t most = std::min(kMaxPlaces, distance_.size());
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

// Of the disc that fits the shares of near_ best. Radius R and opacity a are bound by the light: a pi R^2 = area. A
// disc of opacity 1 holds unless another fits better than the shares' errors allow (noise, and up to the usual share,
// because noise hides that much of a weak share), no lenslet displaces a larger share, and it may cover a whole
// lenslet.
double FlawSizer::disc_radius(const FlawSize& size, double usual, double noise) const {
    const int columns = reference_.extents.m;
    const auto misfit = [&](double at_m, double at_n, double radius, double opacity) {
        double sum = 0;
        for (std::size_t at = 0; at < near_.size(); ++at) {
            const int m = static_cast<int>(near_[at]) % columns, n = static_cast<int>(near_[at]) / columns;
            const double left = shares_[at] - opacity * covered(m - at_m, n - at_n, radius);
            sum += left * left;
        }
        return sum;
    };
    const double opaque = std::sqrt(size.area * std::numbers::inv_pi);
    double best = misfit(size.m, size.n, opaque, 1);
    for (int dn = -kPlaces; dn <= kPlaces; ++dn) {
        for (int dm = -kPlaces; dm <= kPlaces; ++dm)
            best = std::min(best, misfit(size.m + dm * kPlaceStep, size.n + dn * kPlaceStep, opaque, 1));
    }
    best -= kSure * kSure * (noise * noise + usual * usual);
    double radius = opaque;
    const double largest = *std::ranges::max_element(shares_);
    for (double r = opaque * kStep;; r *= kStep) {
        const double opacity = opaque * opaque / (r * r);
        if (opacity < kMinOpacity || opacity + kLargestOf * noise < largest) return radius;
        const double now = misfit(size.m, size.n, r, opacity);
        if (now < best && r >= kHalfDiagonal) best = now, radius = r;
    }
}

std::optional<FlawSize> FlawSizer::measure_gathered(const ComparedLight& seen, const PoseMap& pose) {
    if (ring_.size() < kMinRing) return std::nullopt;
    lenslets_read_ += near_.size();
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
    std::erase_if(near_, [&](std::uint32_t k) {
        const bool far = distance_[k] > FlawSizer::kBeside;
        if (far) distance_[k] = kFar;
        return far;
    });
    shares_.clear();
    for (const std::uint32_t k : near_) {
        const int m = static_cast<int>(k) % columns, n = static_cast<int>(k) / columns;
        // A share of 1 stays 1: there is no light left that noise could move. Beside the region noise does not count.
        double share = (displaced_share(seen, pose, k).value_or(usual) - usual) / (1 - std::min(usual, 0.9));
        if (distance_[k] > 0 && share < kLargestOf * noise) share = 0;
        shares_.push_back(share);
        size.area += share, size.m += share * m, size.n += share * n;
    }
    if (!(size.area > 0)) return std::nullopt;
    size.m /= size.area, size.n /= size.area;
    for (std::size_t at = 0; at < near_.size(); ++at) {
        const int m = static_cast<int>(near_[at]) % columns, n = static_cast<int>(near_[at]) / columns;
        const double share = shares_[at] / size.area, dm = m - size.m, dn = n - size.n;
        mm += share * dm * dm, nn += share * dn * dn, mn += share * dm * dn;
    }
    size.radius = disc_radius(size, usual, noise);
    const double middle = (mm + nn) / 2, half = std::sqrt((mm - nn) * (mm - nn) / 4 + mn * mn);
    size.length = std::sqrt(std::max(0.0, 12 * (middle + half) - 1));
    return size;
}

}  // namespace hord::algo
