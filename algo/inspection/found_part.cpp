// RimFinder: what the frame checks ask of the part that was found (FoundPart).
#include <algorithm>
#include <array>
#include <cstdlib>

#include "algo/frame/lenslet_scan.h"
#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"
#include "common/statistics.h"

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
    found_.area =
        count_suiting(0, state_.size(), [state = state_.data()](std::size_t k) { return (state[k] & kPart) != 0; });
    for (const std::uint32_t k : ring_) found_.at_border += (state_[k] & kPart) != 0 ? 1 : 0;
    found_.parts = regions_ == 1 ? 1 : count_parts(deflections, mask);
    found_.islands = count_islands(sums, mask);
    found_.sharp_outline = sharp_share(deflections, sums, mask);
    if (form_ == PartForm::plate) compare_across_edges({deflections, sums, mask});
    found_.free_beside = least_free_beside();
    found_.symmetry = point_symmetry();
    find_cut();
    found_.convexity = convexity();
}

// An island has no lenslet of the part, nor of what that encloses: what lies there is judged. A quarter of its middle,
// the lenslets whose neighbours all belong to it, has most of the free light, which is bent or enclosed; of one that
// the field's border cuts all lenslets count, because its own free light is reached. The hull of a plate's edges may
// hold several plates: each is an outline of its own around free light.
int RimFinder::count_islands(Sums sums, std::span<const std::uint8_t> mask) {
    constexpr std::uint8_t kOfPart = kPart | kInside;
    for (std::uint8_t& state : state_) state &= static_cast<std::uint8_t>(~kCounted);
    const auto not_counted = [state = state_.data()](std::size_t k) {
        return (state[k] & (kUnreached | kCounted)) == kUnreached;
    };
    int islands = 0, outlines = 0;
    for_each_suiting(0, state_.size(), not_counted, [&](std::size_t k) {
        const std::size_t count =
            mark_connected(static_cast<std::uint32_t>(k), kUnreached, kCounted, Connected::at_corners_too);
        if (count * kDustOfPart < found_.area) return;
        std::size_t bright = 0, middle = 0, bright_middle = 0, free_middle = 0;
        bool of_part = false, at_border = false;
        for_each_connected([&](std::size_t at) {
            const int m = static_cast<int>(at) % extents_.m, n = static_cast<int>(at) / extents_.m;
            of_part = of_part || (state_[at] & kOfPart) != 0;
            at_border = at_border || m == 0 || n == 0 || m == extents_.m - 1 || n == extents_.n - 1;
            const bool is_bright = (mask[at] & kDark) == 0 && 4 * std::int64_t{sums[at]} >= 3 * free_light_;
            bright += is_bright ? 1 : 0;
            bool surrounded = true;
            extents_.for_each_around(m, n, 1, [&](int x, int y) {
                surrounded = surrounded && (state_[extents_.index(x, y)] & kUnreached) != 0;
            });
            if (!surrounded) return;
            ++middle;
            bright_middle += is_bright ? 1 : 0;
            free_middle += (state_[at] & kFree) != 0 ? 1 : 0;
        });
        const bool is_clear = (middle > 0 && 4 * bright_middle >= middle) || (at_border && 4 * bright >= count);
        islands += !of_part && is_clear ? 1 : 0;
        outlines += of_part && 2 * free_middle > middle ? 1 : 0;
    });
    return islands + (form_ == PartForm::plate ? std::max(outlines - 1, 0) : 0);
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

// Steps between a lenslet of the part and one outside it, along rows and columns. The straight edges of a tube are
// those of its outline to a lenslet, and its wall gathers light beside them: a jump one lenslet farther out or in
// counts, too.
double RimFinder::sharp_share(Deflections deflections, Sums sums, std::span<const std::uint8_t> mask) const {
    const std::uint8_t* const state = state_.data();
    const auto columns = static_cast<std::size_t>(extents_.m);
    std::size_t steps = 0, sharp = 0;
    const auto look_at = [&](std::size_t first, std::size_t last, std::size_t step) {
        const auto outline = [=](std::size_t k) {
            const std::uint8_t a = state[k], b = state[k + step];
            return (((a & kPart) != 0) & ((b & kInside) == 0)) | (((b & kPart) != 0) & ((a & kInside) == 0));
        };
        for_each_suiting(first, last, outline, [&](std::size_t k) {
            ++steps;
            bool any = jumps({deflections, sums, mask}, k, k + step);
            if (tube_ && k >= first + step) any = any || jumps({deflections, sums, mask}, k - step, k);
            if (tube_ && k + step < last) any = any || jumps({deflections, sums, mask}, k + step, k + 2 * step);
            sharp += any ? 1 : 0;
        });
    };
    for (int n = 0; n < extents_.n; ++n) look_at(extents_.index(0, n), extents_.index(0, n) + columns - 1, 1);
    look_at(0, state_.size() - columns, columns);
    return steps == 0 ? 0 : static_cast<double>(sharp) / static_cast<double>(steps);
}

RimFinder::Centroid RimFinder::centroid() const {
    Centroid found;
    std::int64_t m_sum = 0, n_sum = 0;
    for (int n = 0; n < extents_.n; ++n) {
        const std::uint8_t* const row = state_.data() + extents_.index(0, n);
        std::int32_t in_row = 0, m_in_row = 0;
        for (int m = 0; m < extents_.m; ++m) {
            in_row += (row[m] & kInside) != 0 ? 1 : 0;
            m_in_row += (row[m] & kInside) != 0 ? m : 0;
        }
        found.area += in_row;
        m_sum += m_in_row;
        n_sum += std::int64_t{in_row} * n;
    }
    if (found.area == 0) return found;
    found.twice_m = static_cast<int>(divide_rounded(2 * m_sum, found.area));
    found.twice_n = static_cast<int>(divide_rounded(2 * n_sum, found.area));
    return found;
}

double RimFinder::point_symmetry() {
    const auto inside = [&](int n) { return state_.data() + extents_.index(0, n); };
    const auto [area, twice_m, twice_n] = centroid();
    if (area == 0) return 0;
    std::int64_t both = 0;
    std::uint8_t* const turned = seen_.data();
    // A lenslet and its image in row twice_n - n count both.
    const int first_m = std::max(0, twice_m - (extents_.m - 1)), last_m = std::min(extents_.m - 1, twice_m);
    for (int n = std::max(0, twice_n - (extents_.n - 1)); 2 * n <= twice_n; ++n) {
        const std::uint8_t *const row = inside(n), *const image = inside(twice_n - n) + twice_m;
        for (int m = first_m; m <= last_m; ++m) turned[m] = image[-m];
        const auto in_both = count_suiting(static_cast<std::size_t>(first_m), static_cast<std::size_t>(last_m) + 1,
                                           [=](std::size_t m) { return (row[m] & turned[m] & kInside) != 0; });
        both += static_cast<std::int64_t>(2 * n == twice_n ? in_both : 2 * in_both);
    }
    return static_cast<double>(both) / static_cast<double>(2 * area - both);
}

double RimFinder::convexity() {
    hull_.take(state_, kInside);
    const std::size_t inside =
        count_suiting(0, state_.size(), [state = state_.data()](std::size_t k) { return (state[k] & kInside) != 0; });
    return static_cast<double>(inside) / static_cast<double>(std::max<std::size_t>(hull_.close(), 1));
}

double RimFinder::deflecting_share(Deflections deflections, std::span<const std::uint8_t> mask) const {
    const auto inside = [mask](std::size_t k) { return (mask[k] & (kRim | kOutside)) == 0; };
    const NearFree near_free(free_);
    const auto free_inside = [=](std::size_t k) {
        return ((mask[k] & (kRim | kOutside | kDark)) == 0) & near_free.has(deflections[k]);
    };
    const std::size_t all = count_suiting(0, state_.size(), inside),
                      free = count_suiting(0, state_.size(), free_inside);
    return all == 0 ? 1 : 1 - static_cast<double>(free) / static_cast<double>(all);
}

// Of as many lenslets as the ring has, at most, evenly thinned.
Deflection RimFinder::median_inside(Deflections deflections, std::span<const std::uint8_t> mask) {
    const auto lit_inside = [mask](std::size_t k) { return (mask[k] & (kRim | kOutside | kNoHord)) == 0; };
    const std::size_t all = count_suiting(0, state_.size(), lit_inside),
                      step = std::max<std::size_t>((all + ring_values_.size() - 1) / ring_values_.size(), 1);
    if (all == 0) return {};
    const auto median = [&](DeflectionQ Deflection::*axis) {
        std::size_t nth = 0, count = 0;
        for_each_suiting(0, state_.size(), lit_inside, [&](std::size_t k) {
            if (nth++ % step == 0) ring_values_[count++] = (deflections[k].*axis).raw();
        });
        return DeflectionQ::from_raw(common::lower_median(std::span(ring_values_).first(count)));
    };
    return {median(&Deflection::x), median(&Deflection::y)};
}

double RimFinder::least_free_beside() {
    double least = 1;
    const auto take = [&](int beside, int free) {
        if (free == 0) least = 0;
        else if (beside >= kMinBeside) least = std::min(least, static_cast<double>(free) / beside);
    };
    constexpr std::uint8_t kFreeField = FoundPart::kFreeField;
    std::ranges::fill(in_column_, std::int16_t{0});
    std::ranges::fill(free_in_column_, std::int16_t{0});
    std::int16_t *const beside_in_column = in_column_.data(), *const free_in_column = free_in_column_.data();
    for (int n = 0; n < extents_.n; ++n) {
        const std::uint8_t* const row = state_.data() + extents_.index(0, n);
        int beside = 0, free = 0;
        for (std::size_t m = 0; m < in_column_.size(); ++m) {
            const int is_beside = (row[m] & kInside) == 0 ? 1 : 0,
                      is_free = is_beside & (row[m] & kFreeField) / kFreeField;
            beside += is_beside;
            free += is_free;
            beside_in_column[m] = static_cast<std::int16_t>(beside_in_column[m] + is_beside);
            free_in_column[m] = static_cast<std::int16_t>(free_in_column[m] + is_free);
        }
        take(beside, free);
    }
    for (std::size_t m = 0; m < in_column_.size(); ++m) take(beside_in_column[m], free_in_column[m]);
    return least;
}

}  // namespace hord::algo
