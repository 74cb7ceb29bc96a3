#include "algo/light/dark_bins.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/spread.h"

namespace hord::algo {
namespace {

constexpr double kOneSigma = 0.158655;  // share of a normal distribution below -1 sigma

}  // namespace

double share_of_dark_bins(const Extents& e) {
    return 1 - static_cast<double>(std::min(e.i, kSpotBins) * std::min(e.j, kSpotBins)) / e.bins();
}

FrameLevels levels_above_dark_bins(const LightLevels& given, const DarkBins& dark, std::uint32_t max_rise_dn) {
    FrameLevels result{given};
    if (!dark.measured || dark.at_zero) return result;
    const double highest = static_cast<double>(given.dark) + 2.0 * max_rise_dn;
    if (static_cast<double>(given.dark) + 0.5 >= dark.upper_dn) return result;
    const double level = std::ceil(dark.pedestal_dn + kDarkNoiseFactor * dark.noise_dn);
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
    return dark;
}

}  // namespace hord::algo
