#include "algo/light/macro_period.h"

#include <algorithm>
#include <array>

#include "algo/frame/spread.h"

namespace hord::algo {
namespace {

constexpr double kClear = 0.5;      // share of the variance that a period must explain to be one
constexpr double kNearly = 0.9;     // of the best: explains as much
constexpr double kUnlikely = 0.3;   // of the best: the expected period does not explain the image
constexpr int kPeriodsAWindow = 4;  // at least

struct Sums {
    double between = 0, all = 0;  // sums of squares: of the fold's means, of the samples
};

// Adds one window's sums of squares about its mean.
void add_fold(std::span<const std::uint32_t> window, int period, Sums& sums) {
    std::array<double, kMaxBins> of{};
    std::array<int, kMaxBins> count{};
    double total = 0, squares = 0;
    for (std::size_t k = 0, phase = 0; k < window.size(); ++k) {
        const double v = window[k];
        of[phase] += v;
        ++count[phase];
        total += v;
        squares += v * v;
        if (++phase == static_cast<std::size_t>(period)) phase = 0;
    }
    const double of_mean = total * total / static_cast<double>(window.size());
    for (std::size_t phase = 0; phase < static_cast<std::size_t>(period); ++phase)
        sums.between += of[phase] * of[phase] / count[phase];
    sums.between -= of_mean;
    sums.all += squares - of_mean;
}

// Evenly spaced starts of bands of `length` samples in 0..count-1.
std::vector<int> bands(int count, int length, int most) {
    std::vector<int> firsts;
    for (const int middle : spread(count, std::min(most, std::max(1, count / length))))
        firsts.push_back(std::clamp(middle - length / 2, 0, count - length));
    return firsts;
}

}  // namespace

int period_of(std::span<const std::uint32_t> profile, int expected) {
    const std::size_t width = std::min<std::size_t>(profile.size(), MacroPeriodFinder::kWindow);
    const int longest = std::min(kMaxBins, static_cast<int>(width) / kPeriodsAWindow);
    if (expected > longest) return 0;
    std::array<double, kMaxBins + 1> explained{};
    double best = 0;
    for (int period = 2; period <= longest; ++period) {
        Sums sums;
        for (std::size_t first = 0; first + width <= profile.size(); first += width)
            add_fold(profile.subspan(first, width), period, sums);
        if (!(sums.all > 0)) return 0;
        const double samples = static_cast<double>(width);
        const double rest = (sums.all - sums.between) / (samples - period), variance = sums.all / (samples - 1);
        explained[static_cast<std::size_t>(period)] = 1 - rest / variance;
        best = std::max(best, explained[static_cast<std::size_t>(period)]);
    }
    if (best < kClear) return 0;
    const auto of = [&](int period) { return explained[static_cast<std::size_t>(period)]; };
    int found = 2;
    while (of(found) < kNearly * best) ++found;
    const bool divides = found < expected && expected % found == 0;
    return found == expected || (!divides && of(expected) >= kUnlikely * best) ? expected : found;
}

MacroPeriodFinder::MacroPeriodFinder(const Extents& extents)
    : extents_(extents), band_columns_(std::min(kBandRows, extents.width_px())),
      band_rows_(std::min(kBandRows, extents.height_px())), columns_(static_cast<std::size_t>(extents.width_px())),
      rows_(static_cast<std::size_t>(extents.height_px())) {
    first_columns_ = bands(extents.width_px(), band_columns_, kBands);
    first_rows_ = bands(extents.height_px(), band_rows_, kBands);
}

template <class Sample>
void MacroPeriodFinder::sum(const FrameView& frame) {
    const auto line = [&](int y) { return reinterpret_cast<const Sample*>(frame.data + y * frame.stride_bytes); };
    std::ranges::fill(columns_, 0U);
    for (const int first : first_rows_) {
        for (int y = first; y < first + band_rows_; ++y) {
            const Sample* const samples = line(y);
            for (std::size_t x = 0; x < columns_.size(); ++x) columns_[x] += samples[x];
        }
    }
    for (std::size_t y = 0; y < rows_.size(); ++y) {
        const Sample* const samples = line(static_cast<int>(y));
        std::uint32_t sum = 0;
        for (const int first : first_columns_) {
            for (int x = first; x < first + band_columns_; ++x) sum += samples[x];
        }
        rows_[y] = sum;
    }
}

MacroPeriod MacroPeriodFinder::find(const FrameView& frame) {
    if (frame.bits > 8) sum<std::uint16_t>(frame);
    else sum<std::uint8_t>(frame);
    MacroPeriod found{period_of(columns_, extents_.i), period_of(rows_, extents_.j)};
    found.expected = (found.x == 0 || found.x == extents_.i) && (found.y == 0 || found.y == extents_.j);
    return found;
}

}  // namespace hord::algo
