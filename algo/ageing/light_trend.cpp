#include "algo/ageing/light_trend.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "algo/ageing/subsample.h"

namespace hord::algo {
namespace {

constexpr int kDarkSide = 16, kLightSide = 32, kTileSide = 8, kMinTile = 3;  // lenslets, lenslets, tiles, lenslets
constexpr double kSmoothing = 0.25;                                          // weight of a new window
constexpr float kBrightest = 2;  // times the part's typical light; brighter lenslets are clipped to it

}  // namespace

LightTrend::LightTrend(const Extents& extents, int window)
    : extents_(extents), window_(window), tiles_m_(std::clamp(extents.m / kMinTile, 1, kTileSide)),
      tiles_n_(std::clamp(extents.n / kMinTile, 1, kTileSide)), dark_columns_(spread(extents.m, kDarkSide)),
      dark_rows_(spread(extents.n, kDarkSide)), light_columns_(spread(extents.m, kLightSide)),
      light_rows_(spread(extents.n, kLightSide)), typical_(light_columns_.size() * light_rows_.size()),
      dark_samples_(dark_columns_.size() * dark_rows_.size() * static_cast<std::size_t>(extents.bins())),
      light_(static_cast<std::size_t>(window)), dark_(light_.size()),
      tiles_(static_cast<std::size_t>(tiles_m_ * tiles_n_) * light_.size()),
      tile_values_(static_cast<std::size_t>(tiles_m_ * tiles_n_)), tile_sums_(tile_values_.size()),
      tile_counts_(tile_values_.size()), tile_base_(tile_values_.size()), tile_age_(tile_values_.size()) {
    ratios_.reserve(tile_values_.size());
}

Result<LightTrend> LightTrend::create(const Extents& extents, int window) {
    if (auto fine = check_window(extents, window, kMinWindow, kMaxWindow); !fine) return tl::unexpected(fine.error());
    return LightTrend(extents, window);
}

void LightTrend::restart() {
    std::ranges::fill(tile_values_, 0);
    std::ranges::fill(tile_base_, 0.0F);
    std::ranges::fill(tile_age_, 0.0F);
    in_window_ = 0;
    base_light_.reset();
    base_dark_.reset();
    parts_ = 0;
    latest_.reset();
}

// The mean of the darkest quarter of the sampled lenslets' samples.
double LightTrend::dark_level(const FrameView& frame) {
    std::size_t count = 0;
    for (const int n : dark_rows_) {
        for (const int m : dark_columns_) {
            for (int j = 0; j < extents_.j; ++j) {
                for (int i = 0; i < extents_.i; ++i)
                    dark_samples_[count++] =
                        static_cast<std::uint16_t>(frame.sample(m * extents_.i + i, n * extents_.j + j));
            }
        }
    }
    const std::size_t quarter = std::max<std::size_t>(count / 4, 1);
    std::nth_element(dark_samples_.begin(), dark_samples_.begin() + static_cast<std::ptrdiff_t>(quarter - 1),
                     dark_samples_.end());
    std::uint64_t sum = 0;
    for (std::size_t k = 0; k < quarter; ++k) sum += dark_samples_[k];
    return static_cast<double>(sum) / static_cast<double>(quarter);
}

// The median of the sampled lenslets that are judged and have light; 0 if there are none.
float LightTrend::typical_light(const Inspection& inspection) {
    int count = 0;
    for (const int n : light_rows_) {
        for (const int m : light_columns_) {
            const std::size_t k = extents_.index(m, n);
            if ((inspection.mask[k] & (kNoHord | kNotJudged)) == 0)
                typical_[static_cast<std::size_t>(count++)] = static_cast<float>(inspection.sums[k]);
        }
    }
    return count == 0 ? 0 : median(typical_.data(), count);
}

void LightTrend::add_tiles(const Inspection& inspection, float typical) {
    std::ranges::fill(tile_sums_, 0.0);
    std::ranges::fill(tile_counts_, 0);
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        const auto row = static_cast<std::size_t>(n * tiles_n_ / extents_.n * tiles_m_);
        for (int m = 0; m < extents_.m; ++m, ++k) {
            if ((inspection.mask[k] & (kNoHord | kNotJudged)) != 0) continue;
            const std::size_t tile = row + static_cast<std::size_t>(m * tiles_m_ / extents_.m);
            tile_sums_[tile] +=
                static_cast<double>(std::min(static_cast<float>(inspection.sums[k]) / typical, kBrightest));
            ++tile_counts_[tile];
        }
    }
    for (std::size_t tile = 0; tile < tile_values_.size(); ++tile) {
        // A tile that the part covers in a corner only depends on the part's position.
        const auto lenslets = extents_.lenslets() / tile_values_.size();
        if (4 * static_cast<std::size_t>(tile_counts_[tile]) < lenslets || tile_counts_[tile] == 0) continue;
        tiles_[tile * light_.size() + static_cast<std::size_t>(tile_values_[tile]++)] =
            static_cast<float>(tile_sums_[tile] / tile_counts_[tile]);
    }
}

bool LightTrend::add(const FrameView& frame, const Inspection& inspection) {
    if (inspection.verdict == Verdict::unfit || inspection.sums.size() != extents_.lenslets()) return false;
    const float typical = typical_light(inspection);
    if (!(typical > 0)) return false;
    const bool with_reference = inspection.registered.found();
    if (parts_ == 0) with_reference_ = with_reference;
    if (with_reference != with_reference_) return false;  // the inspection used the previous recipe
    const auto part = static_cast<std::size_t>(in_window_);
    light_[part] = with_reference ? static_cast<float>(inspection.registered.light) : typical;
    dark_[part] = static_cast<float>(dark_level(frame));
    add_tiles(inspection, typical);
    ++parts_;
    if (++in_window_ < window_) return false;
    close_window();
    return true;
}

void LightTrend::close_window() {
    const double light = static_cast<double>(median(light_.data(), window_)),
                 dark = static_cast<double>(median(dark_.data(), window_));
    if (!base_light_) base_light_ = with_reference_ ? 1.0 : light;
    if (!base_dark_) base_dark_ = dark;
    LightAge age;
    const double ratio = light / *base_light_;
    age.light = latest_ ? latest_->light + kSmoothing * (ratio - latest_->light) : ratio;
    age.since_reference = with_reference_;
    age.dark_dn = dark;
    age.dark_drift_dn = dark - *base_dark_;
    age.parts = parts_;
    find_uneven(age);
    latest_ = age;
    in_window_ = 0;
}

void LightTrend::find_uneven(LightAge& age) {
    ratios_.clear();
    for (std::size_t tile = 0; tile < tile_values_.size(); ++tile) {
        const int values = std::exchange(tile_values_[tile], 0);
        if (2 * values < window_) continue;
        const float now = median(tiles_.data() + tile * light_.size(), values);
        if (tile_base_[tile] == 0) {
            tile_base_[tile] = std::max(now, 1e-3F);
            tile_age_[tile] = 1;
        }
        tile_age_[tile] += static_cast<float>(kSmoothing) * (now / tile_base_[tile] - tile_age_[tile]);
        ratios_.push_back(tile_age_[tile]);
    }
    if (ratios_.empty()) return;
    // Relative to the median tile: the typical light itself may come from lenslets that changed.
    const float typical = std::max(median(ratios_.data(), static_cast<int>(ratios_.size())), 1e-3F);
    for (int tn = 0; tn < tiles_n_; ++tn) {
        for (int tm = 0; tm < tiles_m_; ++tm) {
            const float aged = tile_age_[static_cast<std::size_t>(tn * tiles_m_ + tm)];
            if (aged == 0) continue;
            const double change = static_cast<double>(aged / typical) - 1;
            if (std::abs(change) <= std::abs(age.uneven)) continue;
            age.uneven = change;
            age.uneven_m =
                (static_cast<float>(tm) + 0.5F) * static_cast<float>(extents_.m) / static_cast<float>(tiles_m_) - 0.5F;
            age.uneven_n =
                (static_cast<float>(tn) + 0.5F) * static_cast<float>(extents_.n) / static_cast<float>(tiles_n_) - 0.5F;
        }
    }
}

}  // namespace hord::algo
