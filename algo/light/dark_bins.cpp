#include "algo/light/dark_bins.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>

#include "algo/frame/spread.h"

namespace hord::algo {
namespace {

constexpr double kOneSigma = 0.158655;  // share of a normal distribution below -1 sigma
constexpr double kFirstStep = 1000;     // samples in the first step, for 3 %; the widest step has what it has
constexpr double kShapeFactor = 1.5;    // between the zeros that clipped noise has and those that are counted

double below_normal(double sigmas) { return 0.5 * std::erfc(-sigmas / std::sqrt(2.0)); }

}  // namespace

double share_of_dark_bins(const Extents& e) {
    return 1 - static_cast<double>(std::min(e.i, kSpotBins) * std::min(e.j, kSpotBins)) / e.bins();
}

FrameLevels levels_above_dark_bins(const LightLevels& given, const DarkBins& dark, std::uint32_t max_rise_dn) {
    FrameLevels result{given};
    if (!dark.measured) return result;
    const double highest = static_cast<double>(given.dark) + 2.0 * max_rise_dn;
    const double level = std::ceil(dark.rare_dn.value_or(dark.pedestal_dn + kDarkNoiseFactor * dark.noise_dn));
    const bool few_above = dark.at_zero || static_cast<double>(given.dark) + 0.5 >= dark.upper_dn;
    if (!few_above || dark.rare_dn)
        result.levels.dark = std::max(given.dark, static_cast<std::uint32_t>(std::clamp(level, 0.0, highest)));
    if (few_above) return result;
    result.pedestal_allowed = dark.pedestal_dn <= static_cast<double>(given.dark) + max_rise_dn + 0.5;
    result.noise_allowed = level <= highest;
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

template <class Sample>
void DarkBinMeter::count_far(const FrameView& frame) {
    const auto largest = static_cast<std::uint32_t>(counts_.size() - 1);
    const std::ptrdiff_t stride = frame.stride_bytes / static_cast<std::ptrdiff_t>(sizeof(Sample));
    for_each_sampled([&](int m, int n) {
        const auto* first = reinterpret_cast<const Sample*>(frame.data) + n * extents_.j * stride + m * extents_.i;
        int at_i = 0, at_j = 0;
        for (int j = 0; j < extents_.j; ++j) {
            for (int i = 0; i < extents_.i; ++i) {
                if (first[j * stride + i] > first[at_j * stride + at_i]) at_i = i, at_j = j;
            }
        }
        for (int j = 0; j < extents_.j; ++j) {
            for (int i = 0; i < extents_.i; ++i) {
                if (std::max(std::abs(i - at_i), std::abs(j - at_j)) >= kBinsFromSpot)
                    ++counts_[std::min<std::uint32_t>(first[j * stride + i], largest)];
            }
        }
    });
}

// The value below which so many of the samples lie.
double DarkBinMeter::quantile(double wanted) const {
    double below = 0;
    for (std::size_t v = 0; v < counts_.size(); ++v) {
        const double here = counts_[v];
        if (here > 0 && below + here >= wanted) return static_cast<double>(v) - 0.5 + (wanted - below) / here;
        below += here;
    }
    return static_cast<double>(counts_.size() - 1);
}

// The standard deviation of noise about 0 of which the sensor shows the upper half, DN; 0 if the samples are not that.
// Counts of steps of `step` DN fall with exp(-v^2 / 2 sigma^2), whatever number of bins is dark: from the first step to
// the first with at most half as many. The zeros must then be as many as that noise clips.
double DarkBinMeter::noise_clipped_at_zero(std::size_t step) const {
    const auto middle = [&](std::size_t k) {
        return static_cast<double>(k * step) + 0.5 * (1 + static_cast<double>(step));
    };
    const auto samples_of = [&](std::size_t k) {
        double sum = 0;
        for (std::size_t v = k * step + 1; v <= std::min((k + 1) * step, counts_.size() - 1); ++v) sum += counts_[v];
        return sum;
    };
    const double first = samples_of(0);
    if (first == 0 || (first < kFirstStep && 256 * step < counts_.size())) return 0;
    std::size_t half = 1;
    while (half < 128 && 2 * samples_of(half) > first) ++half;
    const double fallen = first / std::max(samples_of(half), 0.5);
    if (fallen < 2) return 0;
    const double sigma = std::sqrt((middle(half) * middle(half) - middle(0) * middle(0)) / (2 * std::log(fallen)));
    const double zeros_of_first = below_normal(0.5 / sigma) /
        (below_normal((static_cast<double>(step) + 0.5) / sigma) - below_normal(0.5 / sigma));
    const double ratio = counts_[0] / (first * zeros_of_first);
    return ratio > 1 / kShapeFactor && ratio < kShapeFactor ? sigma : 0;
}

// DarkBins::rare_dn, by the counts of the far bins.
double DarkBinMeter::rare() const {
    const double all = std::accumulate(counts_.begin(), counts_.end(), 0.0), median = quantile(all / 2);
    if (all == 0) return 0;
    if (median > 0.5) {
        const double below = quantile(all * kOneSigma);
        const double noise = below > 0.5 ? median - below : quantile(all * (1 - kOneSigma)) - median;
        return median + kDarkNoiseFactor * noise - 0.5;
    }
    for (std::size_t step = 1; 256 * step <= counts_.size(); step *= 2) {
        if (const double noise = noise_clipped_at_zero(step); noise > 0) return kDarkNoiseFactor * noise - 0.5;
    }
    return quantile(all * (1 - kRareShare)) - 0.5;
}

DarkBins DarkBinMeter::measure(const FrameView& frame, bool rare_wanted) {
    if (dark_share_ < kMinDarkShare) return {};
    std::ranges::fill(counts_, 0U);
    if (frame.bits > 8) count<std::uint16_t>(frame);
    else count<std::uint8_t>(frame);
    DarkBins dark{.measured = true};
    const double of_dark = dark_share_ * static_cast<double>(columns_.size() * rows_.size()) * extents_.bins();
    const double median = quantile(of_dark / 2);
    dark.at_zero = median <= 0.5;
    dark.pedestal_dn = std::max(median, 0.0);
    dark.upper_dn = quantile(of_dark * kKeptShare);
    const double below = quantile(of_dark * kOneSigma);
    const bool clipped = !dark.at_zero && below <= 0.5;
    dark.noise_dn = clipped ? quantile(of_dark * (1 - kOneSigma)) - median : median - below;
    if (const double noise = dark.at_zero ? noise_clipped_at_zero(counts_.size() / 256) : 0; noise > 0) {
        dark.at_zero = false;
        dark.noise_dn = noise;
    }
    if (!rare_wanted) return dark;
    std::ranges::fill(counts_, 0U);
    if (frame.bits > 8) count_far<std::uint16_t>(frame);
    else count_far<std::uint8_t>(frame);
    dark.rare_dn = rare();
    return dark;
}

}  // namespace hord::algo
