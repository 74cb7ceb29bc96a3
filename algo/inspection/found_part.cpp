// RimFinder: what the frame checks ask of the part that was found (FoundPart).
#include <algorithm>
#include <array>
#include <cstdlib>

#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"

namespace hord::algo {

using namespace outline;

namespace {

std::int64_t bins_q(double bins) { return static_cast<std::int64_t>(bins * (1 << DeflectionQ::kFractionBits)); }

bool within(const Deflection& a, const Deflection& b, std::int64_t tolerance) {
    return std::abs(std::int64_t{a.x.raw()} - b.x.raw()) <= tolerance &&
        std::abs(std::int64_t{a.y.raw()} - b.y.raw()) <= tolerance;
}

}  // namespace

bool jumps_by_light(const FieldLight& light, std::size_t a, std::size_t b) {
    const auto [less, more] = std::minmax(light.sums[a], light.sums[b]);
    return ((light.mask[a] | light.mask[b]) & kDark) != 0 ||
        static_cast<double>(more) > kJumpLight * static_cast<double>(less);
}

bool jumps(const FieldLight& light, std::size_t a, std::size_t b) {
    return jumps_by_light(light, a, b) || !within(light.deflections[a], light.deflections[b], bins_q(kJumpBins));
}

void RimFinder::describe(Deflections deflections, Sums sums, std::span<const std::uint8_t> mask) {
    for (const std::uint8_t state : state_) found_.area += (state & kPart) != 0 ? 1 : 0;
    for (const std::uint32_t k : ring_) found_.at_border += (state_[k] & kPart) != 0 ? 1 : 0;
    found_.parts = regions_ == 1 ? 1 : count_parts(deflections, mask);
    found_.sharp_outline = sharp_share(deflections, sums, mask);
    found_.free_beside = least_free_beside();
    found_.symmetry = point_symmetry();
    found_.convexity = convexity();
}

// Joins regions that face each other across free light if most lenslets along the gap deflect light little more than
// free light. Each row and column that crosses the gap counts with its two ends.
int RimFinder::count_parts(Deflections deflections, std::span<const std::uint8_t> mask) {
    std::array<std::array<int, kSmallestPart + 1>, kSmallestPart + 1> smooth{};  // less the number of rough ones
    const std::int64_t tolerance = bins_q(2 * kFreeToleranceBins);
    const auto cross = [&](int count, auto&& index_of) {
        std::size_t last = 0;
        bool any = false;
        for (int k = 0; k < count; ++k) {
            const std::size_t at = index_of(k);
            if ((state_[at] & kPart) == 0) continue;
            if (any && region_[at] != region_[last]) {
                const auto [a, b] = std::minmax(region_[at], region_[last]);
                for (const std::size_t end : {at, last}) {
                    const bool little = (mask[end] & kDark) == 0 && within(deflections[end], free_, tolerance);
                    smooth[a][b] += little ? 1 : -1;
                }
            }
            last = at;
            any = true;
        }
    };
    for (int n = 0; n < extents_.n; ++n) cross(extents_.m, [&](int m) { return extents_.index(m, n); });
    for (int m = 0; m < extents_.m; ++m) cross(extents_.n, [&](int n) { return extents_.index(m, n); });

    std::array<std::size_t, kSmallestPart + 1> joined{};
    for (std::size_t r = 0; r < joined.size(); ++r) joined[r] = r;
    const auto root = [&](std::size_t r) {
        while (joined[r] != r) r = joined[r];
        return r;
    };
    int parts = regions_;
    for (std::size_t a = 1; a < joined.size(); ++a) {
        for (std::size_t b = a + 1; b < joined.size(); ++b) {
            if (smooth[a][b] <= 0 || root(a) == root(b)) continue;
            joined[root(b)] = root(a);
            --parts;
        }
    }
    return parts;
}

// Steps between a lenslet of the part and one outside it, along rows and columns.
double RimFinder::sharp_share(Deflections deflections, Sums sums, std::span<const std::uint8_t> mask) const {
    std::size_t steps = 0, sharp = 0;
    const auto step = [&](std::size_t a, std::size_t b) {
        const bool outline = ((state_[a] & kPart) != 0 && (state_[b] & kInside) == 0) ||
            ((state_[b] & kPart) != 0 && (state_[a] & kInside) == 0);
        if (!outline) return;
        ++steps;
        sharp += jumps({deflections, sums, mask}, a, b) ? 1 : 0;
    };
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            if (m + 1 < extents_.m) step(k, k + 1);
            if (n + 1 < extents_.n) step(k, k + static_cast<std::size_t>(extents_.m));
        }
    }
    return steps == 0 ? 0 : static_cast<double>(sharp) / static_cast<double>(steps);
}

double RimFinder::point_symmetry() const {
    std::int64_t area = 0, m_sum = 0, n_sum = 0, both = 0;
    const auto inside = [&](std::int64_t m, std::int64_t n) {
        return m >= 0 && n >= 0 && m < extents_.m && n < extents_.n &&
            (state_[extents_.index(static_cast<int>(m), static_cast<int>(n))] & kInside) != 0;
    };
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m) {
            if (!inside(m, n)) continue;
            ++area;
            m_sum += m;
            n_sum += n;
        }
    }
    if (area == 0) return 0;
    const std::int64_t twice_m = divide_rounded(2 * m_sum, area), twice_n = divide_rounded(2 * n_sum, area);
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m) both += inside(m, n) && inside(twice_m - m, twice_n - n) ? 1 : 0;
    }
    return static_cast<double>(both) / static_cast<double>(2 * area - both);
}

double RimFinder::convexity() {
    hull_.take(state_, kInside);
    const auto inside = std::ranges::count_if(state_, [](std::uint8_t state) { return (state & kInside) != 0; });
    return static_cast<double>(inside) / static_cast<double>(std::max<std::size_t>(hull_.close(), 1));
}

double RimFinder::deflecting_share(Deflections deflections, std::span<const std::uint8_t> mask) const {
    std::size_t inside = 0, free = 0;
    for (std::size_t k = 0; k < state_.size(); ++k) {
        if ((mask[k] & (kRim | kOutside)) != 0) continue;
        ++inside;
        free += (mask[k] & kDark) == 0 && within(deflections[k], free_, bins_q(kFreeToleranceBins)) ? 1 : 0;
    }
    return inside == 0 ? 1 : 1 - static_cast<double>(free) / static_cast<double>(inside);
}

double RimFinder::least_free_beside() const {
    double least = 1;
    const auto along = [&](int count, auto&& index_of) {
        int beside = 0, free = 0;
        for (int k = 0; k < count; ++k) {
            const std::uint8_t state = state_[index_of(k)];
            if ((state & kInside) != 0) continue;
            ++beside;
            free += (state & FoundPart::kFreeField) != 0 ? 1 : 0;
        }
        if (free == 0) least = 0;
        else if (beside >= kMinBeside) least = std::min(least, static_cast<double>(free) / beside);
    };
    for (int n = 0; n < extents_.n; ++n) along(extents_.m, [&](int m) { return extents_.index(m, n); });
    for (int m = 0; m < extents_.m; ++m) along(extents_.n, [&](int n) { return extents_.index(m, n); });
    return least;
}

}  // namespace hord::algo
