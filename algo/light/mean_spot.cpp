#include "algo/light/mean_spot.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/light/copied_spot.h"
#include "algo/light/dark_bins.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr auto kMaxOfBins = static_cast<std::size_t>(kMaxBins) * kMaxBins;
constexpr double kFaint = 0.01;     // of the brightest bin
constexpr double kNoiseSigmas = 3;  // of the dark bins of the mean: what exceeds it is light
constexpr int kCoreSteps = 8;       // mean shifts; the middle then moves by less than a hundredth of a bin
using Bins = std::array<double, kMaxOfBins>;

struct Summed {
    std::array<std::uint64_t, kMaxOfBins> samples{};  // DN, row by row
    std::array<std::uint32_t, kMaxOfBins> count{};    // samples of this bin
    std::uint64_t lit = 0, all = 0;                   // samples above the dark level; all
};

int whole_bins(DeflectionQ deflection) { return static_cast<int>(std::lround(deflection.to_double_rounded())); }

template <class Sample>
Summed sum_of(const FrameView& frame, const Extents& e, std::uint32_t dark_dn, std::span<const std::uint32_t> lenslets,
              std::span<const Deflection> centres) {
    Summed summed;
    const auto samples_of = [&](std::uint32_t k, int j) {
        const int m = static_cast<int>(k) % e.m, n = static_cast<int>(k) / e.m;
        return reinterpret_cast<const Sample*>(frame.data + (n * e.j + j) * frame.stride_bytes) + m * e.i;
    };
    constexpr std::size_t kAhead = 6;  // lenslets lie far apart in memory: their samples are asked for in advance
    for (std::size_t at = 0; at < lenslets.size(); ++at) {
        const std::uint32_t k = lenslets[at];
        if (at + kAhead < lenslets.size()) {
            for (int j = 0; j < e.j; ++j) __builtin_prefetch(samples_of(lenslets[at + kAhead], j));
        }
        const int right = centres.empty() ? 0 : whole_bins(centres[k].x),
                  down = centres.empty() ? 0 : whole_bins(centres[k].y);
        for (int j = std::max(0, down); j < std::min(e.j, e.j + down); ++j) {
            const Sample* const samples = samples_of(k, j);
            for (int i = std::max(0, right); i < std::min(e.i, e.i + right); ++i) {
                const auto bin = static_cast<std::size_t>((j - down) * e.i + i - right);
                summed.samples[bin] += samples[i];
                ++summed.count[bin];
                ++summed.all;
                summed.lit += samples[i] > dark_dn ? 1 : 0;
            }
        }
    }
    return summed;
}

// Mean light of each bin above the darkest ones, DN.
struct MeanLight {
    Bins bright{};      // 0: less than kFaint of the brightest; noise in many far bins would widen the spot
    Bins with_faint{};  // with the bins that count as dark: noise is alike on all sides of the spot
    Bins certain{};     // 0: no more than noise explains; none if the dark bins are not known
    double floor = 0;   // DN of the dark bins
};

MeanLight light_of(const Summed& summed, const Extents& e) {
    MeanLight mean;
    Bins& light = mean.bright;
    const auto count = static_cast<std::size_t>(e.bins());
    for (std::size_t b = 0; b < count; ++b) {
        if (summed.count[b] > 0) light[b] = static_cast<double>(summed.samples[b]) / summed.count[b];
    }
    mean.with_faint = light;
    const double dark_share = share_of_dark_bins(e);
    if (dark_share < kMinDarkShare) return mean;
    Bins sorted = light;
    const auto nth_dark = [&](double share) {
        return common::nth_smallest(std::span(sorted).first(count),
                                    static_cast<std::size_t>(share * dark_share * static_cast<double>(count)));
    };
    mean.floor = nth_dark(0.5);
    constexpr double kOneSigmaBelow = 0.1587;  // of a normal distribution
    const double noise = kNoiseSigmas * (mean.floor - nth_dark(kOneSigmaBelow));
    const double faint = kFaint * (*std::max_element(light.begin(), light.begin() + e.bins()) - mean.floor);
    for (std::size_t b = 0; b < count; ++b) {
        const double above = light[b] - mean.floor;
        mean.with_faint[b] = above;
        light[b] = above > faint ? above : 0;
        mean.certain[b] = above > noise ? above : 0;
    }
    return mean;
}

// Light in bins that cannot be reached from the brightest one without climbing.
double light_beside(const Bins& light, const Extents& e, std::size_t brightest) {
    const double climb = kClimb * light[brightest];
    std::array<bool, kMaxOfBins> reached{};
    std::array<std::uint8_t, kMaxOfBins> queue{};
    std::size_t queued = 0;
    reached[brightest] = true;
    queue[queued++] = static_cast<std::uint8_t>(brightest);
    for (std::size_t q = 0; q < queued; ++q) {
        const int i = queue[q] % e.i, j = queue[q] / e.i;
        for (int y = std::max(0, j - 1); y <= std::min(e.j - 1, j + 1); ++y) {
            for (int x = std::max(0, i - 1); x <= std::min(e.i - 1, i + 1); ++x) {
                const auto at = static_cast<std::size_t>(y * e.i + x);
                if (reached[at] || light[at] > light[queue[q]] + climb) continue;
                reached[at] = true;
                queue[queued++] = static_cast<std::uint8_t>(at);
            }
        }
    }
    double beside = 0;
    for (std::size_t b = 0; b < static_cast<std::size_t>(e.bins()); ++b) {
        if (!reached[b] && light[b] > climb) beside += light[b];
    }
    return beside;
}

struct Middle {
    double x = 0, y = 0;
};

// The middle of the core, bins from the first: the mean of the light within kCoreBins along both axes, moved there
// until it stays. A bin that is partly within counts in part, at the middle of that part.
Middle core_of(const Bins& light, const Extents& e, Middle middle) {
    const auto within = [](double centre, int k) {  // begin and end of what is within
        return std::pair(std::max(centre - kCoreBins, k - 0.5), std::min(centre + kCoreBins, k + 0.5));
    };
    for (int step = 0; step < kCoreSteps; ++step) {
        double sum = 0, x = 0, y = 0;
        for (int j = 0; j < e.j; ++j) {
            const auto [top, bottom] = within(middle.y, j);
            for (int i = 0; i < e.i && bottom > top; ++i) {
                const auto [left, right] = within(middle.x, i);
                if (right <= left) continue;
                const double mass = light[static_cast<std::size_t>(j * e.i + i)] * (right - left) * (bottom - top);
                sum += mass;
                x += mass * (left + right) / 2;
                y += mass * (top + bottom) / 2;
            }
        }
        if (!(sum > 0)) return middle;
        middle = {x / sum, y / sum};
    }
    return middle;
}

// Light of the axis beyond the core on one side, less that on the opposite one. `axis`: light of the columns, or of the
// rows. The light of a bin that is partly beyond changes evenly, as its neighbours' does.
double light_on_one_side(std::span<const double> axis, double core) {
    const auto at = [&](std::size_t k) { return k < axis.size() ? axis[k] : 0.0; };
    double difference = 0;
    for (std::size_t k = 0; k < axis.size(); ++k) {
        const double slope = (at(k + 1) - at(k - 1)) / 2;  // at(-1) is no bin
        for (const double side : {1.0, -1.0}) {
            const double beyond = std::clamp(side * (static_cast<double>(k) - core) + 0.5 - kCoreBins, 0.0, 1.0);
            difference += side * (axis[k] * beyond + side * slope * beyond * (1 - beyond) / 2);
        }
    }
    return std::abs(difference);
}

}  // namespace

MeanSpot mean_spot(const FrameView& frame, const Extents& e, std::uint32_t dark_dn,
                   std::span<const std::uint32_t> lenslets, std::span<const Deflection> centres) {
    const Summed summed = frame.bits > 8 ? sum_of<std::uint16_t>(frame, e, dark_dn, lenslets, centres)
                                         : sum_of<std::uint8_t>(frame, e, dark_dn, lenslets, centres);
    const MeanLight mean = light_of(summed, e);
    const Bins& light = mean.bright;
    std::array<double, kMaxBins> columns{}, rows{}, certain_columns{}, certain_rows{};
    double sum = 0, x = 0, y = 0, xx = 0, yy = 0;
    std::size_t b = 0, brightest = 0;
    for (int j = 0; j < e.j; ++j) {
        for (int i = 0; i < e.i; ++i, ++b) {
            if (light[b] > light[brightest]) brightest = b;
            const auto column = static_cast<std::size_t>(i), row = static_cast<std::size_t>(j);
            columns[column] += mean.with_faint[b];
            rows[row] += mean.with_faint[b];
            certain_columns[column] += mean.certain[b];
            certain_rows[row] += mean.certain[b];
            sum += light[b];
            x += light[b] * i;
            y += light[b] * j;
            xx += light[b] * i * i;
            yy += light[b] * j * j;
        }
    }
    if (!(sum > 0)) return {};
    x /= sum;
    y /= sum;
    const auto at = static_cast<int>(brightest);
    const Middle core = core_of(light, e, {static_cast<double>(at % e.i), static_cast<double>(at / e.i)});
    const double lopsided = std::max(std::abs(x - core.x), std::abs(y - core.y));
    MeanSpot spot{.measured = true, .x = x - 0.5 * (e.i - 1), .y = y - 0.5 * (e.j - 1)};
    spot.rms_x = std::sqrt(std::max(0.0, xx / sum - x * x));
    spot.rms_y = std::sqrt(std::max(0.0, yy / sum - y * y));
    const double on_one_side =
        std::max(light_on_one_side(std::span(columns).first(static_cast<std::size_t>(e.i)), core.x),
                 light_on_one_side(std::span(rows).first(static_cast<std::size_t>(e.j)), core.y));
    spot.second_share =
        std::max({light_beside(light, e, brightest) / sum, on_one_side / sum, lopsided / kSecondSpotBins});
    // Without a part before it, all lenslets show the same.
    if (centres.empty()) {
        spot.second_share =
            std::max({spot.second_share,
                      copied_share(std::span(certain_columns).first(static_cast<std::size_t>(e.i)), core.x, kCoreBins),
                      copied_share(std::span(certain_rows).first(static_cast<std::size_t>(e.j)), core.y, kCoreBins)});
    }
    spot.light_dn = sum;
    spot.floor_dn = mean.floor;
    spot.lit_share = static_cast<double>(summed.lit) / static_cast<double>(summed.all);
    return spot;
}

double rms_of_even_light(int bins) { return std::sqrt((bins * bins - 1) / 12.0); }

}  // namespace hord::algo
