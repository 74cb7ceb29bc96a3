#include "firmware/diagnostics/frame_quality.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "algo/light/dark_bins.h"
#include "common/statistics.h"

namespace hord::firmware {
namespace {

constexpr double kDimmest = 0.2, kBrightest = 0.98;  // of the typical lenslet's brightest sample
constexpr double kLit = 0.5;                         // of all lenslets: an aperture may shade the corners
constexpr double kFocused = 0.5;                     // of evenly filled bins
constexpr double kStrayLight = 0.05;                 // of the lit frame

double median_or_nan(std::vector<double>& values) {
    return values.empty() ? std::numeric_limits<double>::quiet_NaN() : common::upper_median(std::span(values));
}

constexpr const char* kLessLight = "less light: shorten timing.strobe_us or lower the sensor's gain";

Judgement judged(bool good, std::string found, const char* cure) { return {good, std::move(found), good ? "" : cure}; }

}  // namespace

Result<FrameQuality> quality_of(const FrameView& frame, const algo::Extents& extents, const algo::Recipe& recipe) {
    if (auto checked = algo::check_frame(frame, extents, frame.bits); !checked) return tl::unexpected(checked.error());
    const algo::LightLevels given = algo::light_levels(recipe, frame.bits);
    const algo::DarkBins dark = algo::DarkBinMeter(extents, frame.bits).measure(frame);
    const algo::LightLevels levels = algo::levels_above_dark_bins(given, dark, algo::max_dark_rise(recipe, frame.bits),
                                                                  algo::kind_of_dark_level(recipe))
                                         .levels;
    FrameQuality quality;
    double total = 0, lit = 0, saturated = 0;
    std::vector<double> peaks, spots;
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m) {
            double sum = 0, x = 0, y = 0, xx = 0, yy = 0;
            std::uint32_t peak = 0;
            for (int j = 0; j < extents.j; ++j) {
                for (int i = 0; i < extents.i; ++i) {
                    const std::uint32_t sample = frame.sample(m * extents.i + i, n * extents.j + j);
                    peak = std::max(peak, sample);
                    const double mass = sample > levels.dark ? sample - levels.dark : 0;
                    sum += mass;
                    total += sample > given.dark ? sample - given.dark : 0;
                    x += mass * i;
                    y += mass * j;
                    xx += mass * i * i;
                    yy += mass * j * j;
                }
            }
            peaks.push_back(static_cast<double>(peak) / frame.full_scale());
            saturated += peak >= levels.saturated ? 1 : 0;
            if (sum < levels.min_sum) continue;
            lit += 1;
            spots.push_back(std::sqrt(std::max(0.0, (xx + yy - (x * x + y * y) / sum) / sum / 2)));
        }
    }
    const auto lenslets = static_cast<double>(extents.lenslets());
    quality.mean = total / (lenslets * extents.bins()) / frame.full_scale();
    quality.bright = median_or_nan(peaks);
    quality.lit = lit / lenslets;
    quality.saturated = saturated / lenslets;
    quality.spot_bins = median_or_nan(spots);
    const auto spread = [](int bins) { return (bins * bins - 1) / 12.0; };
    quality.unfocused_bins = std::sqrt((spread(extents.i) + spread(extents.j)) / 2);
    return quality;
}

Judgement judge_exposure(const FrameQuality& q) {
    const bool bright = q.bright >= kDimmest && q.lit >= kLit;
    return judged(bright && q.bright <= kBrightest,
                  fmt::format("brightest bins at {:.0f} % of full scale, {:.1f} % of the lenslets lit", 100 * q.bright,
                              100 * q.lit),
                  bright
                      ? kLessLight
                      : "more light: lengthen timing.strobe_us (within the LED's limits) or raise the sensor's gain; "
                        "check that a collimator points at the sensor and nothing covers it");
}

Judgement judge_saturation(const FrameQuality& q, const algo::Recipe& recipe) {
    return judged(
        q.saturated <= recipe.max_saturated_share,
        fmt::format("{:.2f} % of the lenslets (at most {:.2f} %)", 100 * q.saturated, 100 * recipe.max_saturated_share),
        kLessLight);
}

Judgement judge_focus(const FrameQuality& q) {
    if (std::isnan(q.spot_bins)) return {false, "no lenslet is lit", "see to the exposure first"};
    return judged(q.spot_bins <= kFocused * q.unfocused_bins,
                  fmt::format("spots of {:.2f} bins RMS (at most {:.2f}; without any focus {:.2f})", q.spot_bins,
                              kFocused * q.unfocused_bins, q.unfocused_bins),
                  "focus the collimator and the lenslet array's distance to the sensor; clear the field of parts; "
                  "where frames are raw, calibrate (hordctl calibrate)");
}

Judgement judge_dark(const FrameQuality& dark, const FrameQuality& lit) {
    const double share = lit.mean > 0 ? dark.mean / lit.mean : 1;
    return judged(share <= kStrayLight, fmt::format("{:.1f} % of the lit frame's light", 100 * share),
                  "keep room light off the sensor, and check that the strobe is off between parts; or the sensor's "
                  "black level is above the recipe's dark_dn: lower it");
}

}  // namespace hord::firmware
