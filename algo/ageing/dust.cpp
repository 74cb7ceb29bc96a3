#include "algo/ageing/dust.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "algo/ageing/subsample.h"
#include "algo/frame/flood.h"

namespace hord::algo {
namespace {

constexpr int kTile = 16;     // lenslets a side, or a little more
constexpr int kReach = 4;     // lenslets
constexpr int kTogether = 2;  // lenslets at most this far apart belong to one speck
constexpr int kLargest = 64;  // a defect larger than 1/kLargest of the field is no speck
enum LensletState : std::uint8_t { kChecked = 1, kHasLight = 2, kResponds = 4 };
enum SpeckState : std::uint8_t { kSpeck = 1, kWaits = 2 };

double square(double v) { return v * v; }

}  // namespace

DustEstimator::DustEstimator(const Extents& extents, int window)
    : extents_(extents), window_(window), reach_(std::clamp(std::min(extents.m, extents.n) / 6, 1, kReach)),
      tiles_m_(std::max(extents.m / kTile, 1)), tiles_n_(std::max(extents.n / kTile, 1)), now_(extents.lenslets()),
      checked_(now_.size()), responded_(now_.size()), speck_(now_.size()),
      tile_checked_(static_cast<std::size_t>(tiles_m_ * tiles_n_)), tile_responded_(tile_checked_.size()),
      evidence_(std::log(static_cast<double>(now_.size()) / kFalseAlarms)) {
    queue_.resize(now_.size());
}

Result<DustEstimator> DustEstimator::create(const Extents& extents, int window) {
    if (auto fine = check_window(extents, window, kMinWindow, kMaxWindow); !fine) return tl::unexpected(fine.error());
    return DustEstimator(extents, window);
}

void DustEstimator::restart() {
    std::ranges::fill(checked_, std::uint16_t{0});
    std::ranges::fill(responded_, std::uint16_t{0});
    std::ranges::fill(speck_, std::uint8_t{0});
    in_window_ = posed_ = 0;
    x_ = y_ = xx_ = yy_ = 0;
    first_pose_.reset();
    parts_ = 0;
    latest_.reset();
}

// Marks lenslets with less light than their neighbours at both ends of a line, across or down.
void DustEstimator::mark_dips(const Inspection& inspection) {
    const auto row = static_cast<std::size_t>(extents_.m), far = static_cast<std::size_t>(reach_);
    const auto light = [&](std::size_t k) { return static_cast<float>(inspection.sums[k]); };
    const auto both = [&](std::size_t a, std::size_t b) { return (now_[a] & now_[b] & kHasLight) != 0; };
    for (int n = 0; n < extents_.n; ++n) {
        const bool down = n >= reach_ && n < extents_.n - reach_;
        for (int m = 0; m < extents_.m; ++m) {
            const std::size_t k = extents_.index(m, n);
            if ((now_[k] & kChecked) == 0) continue;
            const bool across = m >= reach_ && m < extents_.m - reach_ && both(k - far, k + far);
            float expected = across ? light(k - far) + light(k + far) : 0;  // twice
            if (down && both(k - far * row, k + far * row)) {
                const float of_column = light(k - far * row) + light(k + far * row);
                expected = across ? std::min(expected, of_column) : of_column;
            }
            if (2 * light(k) < kDip * expected) now_[k] |= kResponds;
        }
    }
}

void DustEstimator::mark_defects(const Inspection& inspection) {
    for (const Defect& defect : inspection.defects) {
        if (defect.area * std::size_t{kLargest} > extents_.lenslets() || !(std::abs(defect.m) < 1e6F) ||
            !(std::abs(defect.n) < 1e6F))
            continue;
        const float radius = std::sqrt(static_cast<float>(defect.area) / 3.14159265F);
        const auto from = [&](float centre) { return std::max(0, static_cast<int>(std::ceil(centre - radius))); };
        const auto to = [&](float centre, int count) {
            return std::min(count - 1, static_cast<int>(std::floor(centre + radius)));
        };
        for (int n = from(defect.n); n <= to(defect.n, extents_.n); ++n) {
            for (int m = from(defect.m); m <= to(defect.m, extents_.m); ++m) {
                const float right = static_cast<float>(m) - defect.m, below = static_cast<float>(n) - defect.n;
                if (right * right + below * below <= radius * radius) now_[extents_.index(m, n)] |= kResponds;
            }
        }
    }
}

bool DustEstimator::add(const Inspection& inspection) {
    if (inspection.verdict == Verdict::unfit || inspection.sums.size() != now_.size()) return false;
    const bool against_reference = inspection.z_score.size() == now_.size();
    for (std::size_t k = 0; k < now_.size(); ++k) {
        const std::uint8_t mask = inspection.mask[k];
        now_[k] = static_cast<std::uint8_t>(((mask & (kSaturated | kNotJudged)) == 0 ? kChecked : 0) |
                                            ((mask & (kNoHord | kNotJudged)) == 0 ? kHasLight : 0));
        if (against_reference && inspection.z_score[k] >= kNotable) now_[k] |= kResponds;
    }
    if (!against_reference) mark_dips(inspection);
    mark_defects(inspection);
    for (std::size_t k = 0; k < now_.size(); ++k) {
        const bool checked = (now_[k] & kChecked) != 0;
        checked_[k] = static_cast<std::uint16_t>(checked_[k] + (checked ? 1 : 0));
        responded_[k] = static_cast<std::uint16_t>(responded_[k] + (checked && (now_[k] & kResponds) != 0 ? 1 : 0));
    }
    if (inspection.registered.found()) {
        const Pose& pose = inspection.registered.pose;
        if (!first_pose_) first_pose_ = pose;
        const double x = pose.x - first_pose_->x, y = pose.y - first_pose_->y;
        x_ += x, y_ += y, xx_ += x * x, yy_ += y * y;
        ++posed_;
    }
    ++parts_;
    if (++in_window_ < window_) return false;
    close_window();
    return true;
}

void DustEstimator::count_tiles() {
    std::ranges::fill(tile_checked_, 0U);
    std::ranges::fill(tile_responded_, 0U);
    std::uint64_t checked = 0, responded = 0;
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            const auto tile = tile_of(m, n);
            tile_checked_[tile] += checked_[k];
            tile_responded_[tile] += responded_[k];
            checked += checked_[k];
            responded += responded_[k];
        }
    }
    rate_ = static_cast<double>(responded) / static_cast<double>(std::max<std::uint64_t>(checked, 1));
}

bool DustEstimator::is_speck(std::size_t k, std::size_t tile) const {
    const double parts = checked_[k];
    if (2 * checked_[k] < window_) return false;
    const double share = responded_[k] / parts;
    if (share < (speck_[k] != 0 ? kShareToStay : kShare)) return false;
    const double of_tile = static_cast<double>(tile_responded_[tile]) / std::max(1U, tile_checked_[tile]);
    const double rate = std::max(rate_, of_tile);
    if (!(share > rate) || rate <= 0) return false;
    const double divergence =
        share * std::log(share / rate) + (share < 1 ? (1 - share) * std::log((1 - share) / (1 - rate)) : 0);
    return parts * divergence >= evidence_;
}

// The speck of `seed`: all lenslets connected over kTogether lenslets.
Speck DustEstimator::grow_speck(std::uint32_t seed) {
    const std::size_t count = flood(extents_, seed, kTogether, Connected::at_corners_too, queue_, [&](std::size_t k) {
        if (speck_[k] != kWaits) return false;
        speck_[k] = kSpeck;
        return true;
    });
    Speck speck;
    double m_sum = 0, n_sum = 0, weights = 0, best = 0, parts = 1;
    for (const std::uint32_t k : std::span(queue_).first(count)) {
        const int m = static_cast<int>(k) % extents_.m, n = static_cast<int>(k) / extents_.m;
        const double share = static_cast<double>(responded_[k]) / checked_[k];
        ++speck.lenslets;
        if (share > best) {
            best = share;
            parts = checked_[k];
        }
        m_sum += share * m, n_sum += share * n, weights += share;
    }
    speck.m = static_cast<float>(m_sum / weights);
    speck.n = static_cast<float>(n_sum / weights);
    speck.share = static_cast<float>(best);
    const double at_least =
        std::clamp(std::min(best - 2 * std::sqrt(best * (1 - best) / parts), 1 - 3 / parts), 0.0, 1.0);
    const double of_flaw = std::max(0.0, -2 * std::log(1 - at_least) - 2 * std::log(2.0));
    speck.tells_apart = latest_->pose_spread &&
        std::sqrt(speck.lenslets / 3.14159265) + 0.5 < *latest_->pose_spread * std::sqrt(of_flaw);
    return speck;
}

void DustEstimator::list(const Speck& speck) {
    DustFound& found = *latest_;
    const std::size_t listed = std::min<std::size_t>(found.specks++, DustFound::kListed);
    std::size_t at = listed;
    while (at > 0 && found.largest[at - 1].lenslets < speck.lenslets) --at;
    if (at == DustFound::kListed) return;
    for (std::size_t k = std::min(listed, DustFound::kListed - 1); k > at; --k) found.largest[k] = found.largest[k - 1];
    found.largest[at] = speck;
}

void DustEstimator::close_window() {
    count_tiles();
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) speck_[k] = is_speck(k, tile_of(m, n)) ? kWaits : 0;
    }
    latest_.emplace();
    latest_->parts = parts_;
    if (2 * posed_ >= window_) {
        const double count = posed_;
        latest_->pose_spread =
            std::sqrt(std::max(0.0, std::min(xx_ / count - square(x_ / count), yy_ / count - square(y_ / count))));
    }
    for (std::uint32_t seed = 0; seed < speck_.size(); ++seed) {
        if (speck_[seed] == kWaits) list(grow_speck(seed));
    }
    std::ranges::fill(checked_, std::uint16_t{0});
    std::ranges::fill(responded_, std::uint16_t{0});
    in_window_ = posed_ = 0;
    x_ = y_ = xx_ = yy_ = 0;
}

}  // namespace hord::algo
