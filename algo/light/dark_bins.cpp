#include "algo/light/dark_bins.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/spread.h"

namespace hord::algo {
namespace {

constexpr double kOneSigma = 0.158655;  // share of a normal distribution below -1 sigma
constexpr double kRoundingVariance = 1.0 / 12;
constexpr double kShapeFactor = 1.5;   // between the zeros that clipped noise has and those that are counted
constexpr std::size_t kHalfSteps = 4;  // of the histogram, until the counts have fallen to half

double below_normal(double sigmas) { return 0.5 * std::erfc(-sigmas / std::sqrt(2.0)); }

}  // namespace

double share_of_dark_bins(const Extents& e) {
    return 1 - static_cast<double>(std::min(e.i, kSpotBins) * std::min(e.j, kSpotBins)) / e.bins();
}

FrameLevels levels_above_dark_bins(const LightLevels& given, const DarkBins& dark, std::uint32_t max_rise_dn,
                                   DarkLevel kind) {
    FrameLevels result{given};
    if (!dark.measured || dark.at_zero) return result;
    const double highest = static_cast<double>(given.dark) + 2.0 * max_rise_dn;
    const double level = std::ceil(dark.pedestal_dn + kDarkNoiseFactor * dark.noise_dn);
    result.wanted_dn = level;
    // A sample of v DN stands for v +- 0.5 DN, so that rounding is no noise above the level.
    const double noise = std::sqrt(std::max(dark.noise_dn * dark.noise_dn - kRoundingVariance, 0.0)),
                 upper = kind == DarkLevel::by_default ? dark.pedestal_dn + kDarkNoiseFactor * noise : dark.upper_dn;
    if (static_cast<double>(given.dark) + 0.5 >= upper) return result;
    result.pedestal_allowed = dark.pedestal_dn <= static_cast<double>(given.dark) + max_rise_dn + 0.5;
    result.noise_allowed = level <= highest;
    result.levels.dark = std::max(given.dark, static_cast<std::uint32_t>(std::min(level, highest)));
    return result;
}

DarkBinMeter::DarkBinMeter(const Extents& extents, int bits)
    : extents_(extents), dark_share_(share_of_dark_bins(extents)), columns_(spread(extents.m, kSampled)),
      rows_(spread(extents.n, kSampled)), counts_(std::size_t{1} << bits) {}

template <class Sample>
void DarkBinMeter::count(const FrameView& frame) {
    const auto largest = static_cast<std::uint32_t>(counts_.size() - 1);
    for (const int n : rows_) {
        for (int j = 0; j < extents_.j; ++j) {
            const auto* line = reinterpret_cast<const Sample*>(frame.data + (n * extents_.j + j) * frame.stride_bytes);
            for (const int m : columns_) {
                for (int i = 0; i < extents_.i; ++i)
                    ++counts_[std::min<std::uint32_t>(line[m * extents_.i + i], largest)];
            }
        }
    }
}

// The value below which this share of the samples lies, 0 < share < 1.
double DarkBinMeter::quantile(double share) const {
    const double wanted = share * static_cast<double>(columns_.size() * rows_.size()) * extents_.bins();
    double below = 0;
    for (std::size_t v = 0; v < counts_.size(); ++v) {
        const double here = counts_[v];
        if (here > 0 && below + here >= wanted) return static_cast<double>(v) - 0.5 + (wanted - below) / here;
        below += here;
    }
    return static_cast<double>(counts_.size() - 1);
}

// The standard deviation of noise about 0 of which the sensor shows the upper half, DN; 0 if the samples are not that.
// Their counts fall with exp(-v^2 / 2 sigma^2), whatever number of bins is dark: from the first step to the first with
// at most half as many. Steps are as wide as kHalfSteps of them allow, so that noise of the counts does little, and at
// most the full scale's 256th part. The zeros must then be as many as that noise clips.
double DarkBinMeter::noise_clipped_at_zero() const {
    std::size_t step = counts_.size() / 256, half = 1;
    const auto middle = [&](std::size_t k) {
        return static_cast<double>(k * step) + 0.5 * (1 + static_cast<double>(step));
    };
    const auto samples_of = [&](std::size_t k) {
        double sum = 0;
        for (std::size_t v = k * step + 1; v <= (k + 1) * step; ++v) sum += counts_[v];  // k is at most 128
        return sum;
    };
    double first = 0;
    for (;; step /= 2) {
        first = samples_of(0), half = 1;
        while (half < 128 && 2 * samples_of(half) > first) ++half;
        if (half >= kHalfSteps || step == 1) break;
    }
    if (first == 0) return 0;
    const double fallen = first / std::max(samples_of(half), 0.5);
    if (fallen < 2) return 0;
    const double sigma = std::sqrt((middle(half) * middle(half) - middle(0) * middle(0)) / (2 * std::log(fallen)));
    const double zeros_of_first = below_normal(0.5 / sigma) /
        (below_normal((static_cast<double>(step) + 0.5) / sigma) - below_normal(0.5 / sigma));
    const double ratio = counts_[0] / (first * zeros_of_first);
    return ratio > 1 / kShapeFactor && ratio < kShapeFactor ? sigma : 0;
}

DarkBins DarkBinMeter::measure(const FrameView& frame) {
    if (dark_share_ < kMinDarkShare) return {};
    std::ranges::fill(counts_, 0U);
    if (frame.bits > 8) count<std::uint16_t>(frame);
    else count<std::uint8_t>(frame);
    DarkBins dark{.measured = true};
    const double median = quantile(dark_share_ / 2);
    dark.at_zero = median <= 0.5;
    dark.pedestal_dn = std::max(median, 0.0);
    dark.upper_dn = quantile(dark_share_ * kKeptShare);
    const double below = quantile(dark_share_ * kOneSigma);
    const bool clipped = !dark.at_zero && below <= 0.5;
    dark.noise_dn = clipped ? quantile(dark_share_ * (1 - kOneSigma)) - median : median - below;
    if (!dark.at_zero) return dark;
    if (const double noise = noise_clipped_at_zero(); noise > 0) {
        dark.at_zero = false;
        dark.noise_dn = noise;
    }
    return dark;
}

}  // namespace hord::algo
