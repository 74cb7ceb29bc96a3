#include "algo/inspection/rim.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "algo/frame/lenslet_scan.h"
#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "common/statistics.h"

namespace hord::algo {

using namespace outline;

namespace {

// Of the limit of the slope: the bins' ripple (1.27) and noise (0.04 of 0.4) can take a smooth slope above the limit
// from there on. (0.4 - 0.04) / 1.27 / 0.4, docs/notes/inspection.md.
constexpr float kSmoothShare = 0.7F;
constexpr std::size_t kGapSteps = 4;  // at a gap, the light jumps in 1/kGapSteps of the steps to the part
constexpr int kShortestPiece = 4;     // a piece of the outline is at least 1/kShortestPiece as long as the longest one

static_assert(kReached == FoundPart::kFreeField);

// The slope of the mean deflection, bin pitches a lenslet, from which a part with the recipe's limits may be rejected.
float steepest_slope(const Recipe& recipe) {
    float limit = std::numeric_limits<float>::max();
    if (recipe.slopes) limit = recipe.frobenius_limit_bins;
    if (gradient_is_in_bins(recipe)) limit = std::min(limit, limit_of_gradient(recipe) / 2);
    return limit < std::numeric_limits<float>::max() ? kSmoothShare * limit : 0;
}

// The step from the first lenslet to the second is no edge: the mean deflection changes alike two steps further, by at
// least half as much. (At an edge one lenslet may be covered in part, so that the change takes two steps.)
bool slope_goes_on(const FieldLight& light, const std::array<std::size_t, 4>& at) {
    if (jumps_by_light(light, at[0], at[1])) return false;
    const auto alike = [&](DeflectionQ Deflection::*axis) {
        const auto change = [&](std::size_t from) {
            return std::int64_t{(light.deflections[at[from + 1]].*axis).raw()} -
                (light.deflections[at[from]].*axis).raw();
        };
        const std::int64_t first = change(0), later = change(2);
        return std::abs(first) <= NearFree::kTolerance ||
            ((first > 0) == (later > 0) && 2 * std::abs(later) >= std::abs(first));
    };
    return (light.mask[at[2]] & kDark) == 0 && (light.mask[at[3]] & kDark) == 0 && alike(&Deflection::x) &&
        alike(&Deflection::y);
}

}  // namespace

int default_rim_margin(const Extents& extents) {
    return static_cast<int>(std::lround(1.5 + std::max(extents.m, extents.n) / 222.0));
}

RimFinder RimFinder::of(const Recipe& recipe, const Extents& extents) {
    // A web has no rim of its own: the field's border is judged unless the recipe says otherwise.
    const int usual = recipe.form == PartForm::web ? 0 : default_rim_margin(extents);
    return {extents, recipe.rim_margin < 0 ? usual : recipe.rim_margin, recipe.form, steepest_slope(recipe)};
}

RimFinder::RimFinder(const Extents& extents, int margin, PartForm form, float steepest_bins)
    : extents_(extents), margin_(margin), form_(form), hull_(extents), circle_(extents), state_(extents.lenslets()),
      region_(extents.lenslets()), runs_(max_flood_runs(extents)), free_along_(extents.lenslets()), of_rows_(extents.n),
      of_columns_(extents.m), in_column_(of_columns_.first.size()), free_in_column_(in_column_.size()),
      in_rim_(in_column_.size()), seen_(in_column_.size()) {
    for (int n = 0; n < extents.n; ++n) {
        const bool whole_row = n == 0 || n == extents.n - 1;
        for (int m = 0; m < extents.m; m += whole_row ? 1 : extents.m - 1)
            ring_.push_back(static_cast<std::uint32_t>(extents.index(m, n)));
    }
    for (int n = 0; n < extents.n; ++n) {
        for (const int m : {0, extents.m - 1})
            beside_columns_.push_back(static_cast<std::uint32_t>(extents.index(m, n)));
    }
    for (const int n : {0, extents.n - 1}) {
        for (int m = 0; m < extents.m; ++m) beside_rows_.push_back(static_cast<std::uint32_t>(extents.index(m, n)));
    }
    ring_values_.resize(ring_.size());
    const auto most_lines = static_cast<std::size_t>(std::max(extents.m, extents.n));
    for (auto* const of_all_sides : {&open_lines_, &glass_lines_, &deviations_}) of_all_sides->reserve(4 * most_lines);
    first_of_line_.reserve(most_lines + 4);
    if (form == PartForm::tube) tube_.emplace(extents, margin, steepest_bins);
    if (form == PartForm::plate) plate_.emplace(extents);
}

void RimFinder::mark(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
                     std::span<std::uint8_t> mask) {
    std::ranges::fill(state_, std::uint8_t{0});
    found_ = {.state = state_};
    regions_ = 0;
    rectangle_.reset();
    if (form_ != PartForm::web) {
        found_.free_light = find_free_light({deflections, sums, mask});
        if (found_.free_light) reach_free_field();
    }
    find_part({deflections, sums, mask});
    if (regions_ > 0) describe(deflections, sums, mask);
    mark_rim(mask);
    if (regions_ == 0) return;
    if (!found_.free_light) free_ = median_inside(deflections, mask);
    found_.deflecting = deflecting_share(deflections, mask);
    found_.free = free_;
}

// Step 3. Sets kPart and kInside.
void RimFinder::find_part(const FieldLight& light) {
    if (form_ == PartForm::round && found_.free_light) keep_large_parts();
    if (tube_ || plate_) {
        if (found_.free_light) keep_long_regions();
        else std::ranges::fill(state_, std::uint8_t{kPart});  // the part fills the field
        const bool found = tube_ ? tube_->find(light, state_) : found_.free_light && plate_->find(state_);
        if (found) {
            // The light at the two ends of a tube is not free light.
            const Sides ends = tube_ && tube_->along_columns() ? Sides::beside_rows : Sides::beside_columns;
            if (tube_ && free_sides_ == ends) found_.free_light = false;
            // A tube shows by its flanks: what is cut off by the field, or has none, is no whole tube.
            // Without free light beside it only dark flanks tell it from light that is bent all over the field.
            found_.lacks_flanks = tube_ && !(tube_->has_flanks() && (found_.free_light || tube_->has_dark_flanks()));
            regions_ = found_.lacks_flanks ? 0 : 1;
            return;
        }
        for (std::uint8_t& state : state_) state &= static_cast<std::uint8_t>(~kPart);
    }
    enclose();
    if (form_ == PartForm::round && regions_ > 0) open_gaps(light);
}

// Step 1 (docs/notes/inspection.md). Sets kFree; false if the outermost lenslets show no free light. A tube that leaves
// the field at both ends may cover most of them: then the two sides of the field that agree better count.
bool RimFinder::find_free_light(const FieldLight& light) {
    free_sides_ = Sides::all;
    if (2 * agreeing(light, ring_) >= ring_.size()) return true;
    if (form_ != PartForm::tube) return false;
    const std::size_t columns = agreeing(light, beside_columns_), rows = agreeing(light, beside_rows_);
    const bool by_columns = columns * beside_rows_.size() >= rows * beside_columns_.size();
    free_sides_ = by_columns ? Sides::beside_columns : Sides::beside_rows;
    const std::vector<std::uint32_t>& sides = by_columns ? beside_columns_ : beside_rows_;
    return 2 * agreeing(light, sides) >= sides.size();
}

// How many lenslets of `ring` show the median light of `ring`; 0 if most are dark. Sets kFree where the field shows it.
std::size_t RimFinder::agreeing(const FieldLight& light, std::span<const std::uint32_t> ring) {
    const auto median_of_ring = [&](auto&& value_of) -> std::int64_t {
        std::size_t count = 0;
        for (const std::uint32_t k : ring) {
            if ((light.mask[k] & kDark) == 0) ring_values_[count++] = value_of(k);
        }
        return 2 * count < ring.size() ? -1 : common::lower_median(std::span(ring_values_).first(count));
    };
    const std::int64_t sum = median_of_ring([&](std::uint32_t k) { return std::int64_t{light.sums[k]}; });
    if (sum < 0) return 0;
    const auto x = DeflectionQ::from_raw(
        median_of_ring([&](std::uint32_t k) { return std::int64_t{light.deflections[k].x.raw()}; }));
    const auto y = DeflectionQ::from_raw(
        median_of_ring([&](std::uint32_t k) { return std::int64_t{light.deflections[k].y.raw()}; }));

    free_ = {x, y};
    free_light_ = sum;
    const NearFree near_free(free_);
    const auto half = static_cast<std::uint32_t>((sum + 1) / 2);
    // Local copies: a store to a byte may change anything else.
    const auto [deflections, sums, mask] = light;
    std::uint8_t* const state = state_.data();
    for (std::size_t k = 0, lenslets = state_.size(); k < lenslets; ++k) {
        const bool free = near_free.has(deflections[k]) & (sums[k] >= half);
        state[k] = free ? kFree : 0;
    }
    for (std::size_t k = 0, lenslets = state_.size(); k < lenslets; ++k)
        state[k] = (mask[k] & kDark) != 0 ? 0 : state[k];
    return static_cast<std::size_t>(std::ranges::count_if(ring, [&](std::uint32_t k) { return state_[k] == kFree; }));
}

// Sets kWide: the lenslet and its neighbours inside the field are kFree. Along the rows first, then across them.
void RimFinder::mark_wide() {
    const auto columns = static_cast<std::size_t>(extents_.m), rows = static_cast<std::size_t>(extents_.n);
    for (std::size_t n = 0; n < rows; ++n) {
        const std::uint8_t* const from = state_.data() + n * columns;
        std::uint8_t* const to = free_along_.data() + n * columns;
        to[0] = from[0] & from[1];
        for (std::size_t m = 1; m + 1 < columns; ++m) to[m] = from[m - 1] & from[m] & from[m + 1];
        to[columns - 1] = from[columns - 2] & from[columns - 1];
    }
    for (std::size_t n = 0; n < rows; ++n) {
        const std::uint8_t *const here = free_along_.data() + n * columns, *const above = n > 0 ? here - columns : here,
                                  *const below = n + 1 < rows ? here + columns : here;
        std::uint8_t* const to = state_.data() + n * columns;
        for (std::size_t m = 0; m < columns; ++m)
            to[m] |= static_cast<std::uint8_t>((above[m] & here[m] & below[m] & kFree) * (kWide / kFree));
    }
}

// Step 2. Sets kReached or kUnreached everywhere.
void RimFinder::reach_free_field() {
    mark_wide();
    for (const std::uint32_t at : ring_) {
        if ((state_[at] & kFree) != 0) state_[at] |= kWide;  // outside the field light is free
    }
    for (const std::uint32_t at : ring_) {
        if ((state_[at] & (kWide | kReached)) == kWide) mark_connected(at, kWide, kReached, Connected::at_sides);
    }
    const auto beside_wide = [state = state_.data()](std::size_t k) {
        return (state[k] & (kFree | kReached)) == kFree;
    };
    for_each_suiting(0, state_.size(), beside_wide, [&](std::size_t k) {
        const int m = static_cast<int>(k) % extents_.m, n = static_cast<int>(k) / extents_.m;
        extents_.for_each_around(m, n, 1, [&](int x, int y) {
            const std::uint8_t state = state_[extents_.index(x, y)];
            if ((state & (kWide | kReached)) == (kWide | kReached)) state_[k] |= kReached;
        });
    });
    for (std::uint8_t& state : state_) state |= (state & kReached) == 0 ? kUnreached : 0;
}

// Step 3 of a round part, first half. Sets kPart.
void RimFinder::keep_large_parts() {
    const auto not_counted = [state = state_.data()](std::size_t k) {
        return (state[k] & (kUnreached | kCounted)) == kUnreached;
    };
    for_each_suiting(0, state_.size(), not_counted, [&](std::size_t k) {
        const std::size_t count =
            mark_connected(static_cast<std::uint32_t>(k), kUnreached, kCounted, Connected::at_corners_too);
        if (count * kSmallestPart < state_.size()) return;
        ++regions_;
        for_each_connected([state = state_.data()](std::size_t at) { state[at] |= kPart; });
        for_each_connected([region = region_.data(), number = static_cast<std::uint8_t>(regions_)](std::size_t at) {
            region[at] = number;
        });
    });
}

// The same for outlines that need not be closed: regions that are long enough to be a piece of it. Dust is shorter.
void RimFinder::keep_long_regions() {
    const auto longer_side = [&] {
        int left = extents_.m, right = 0, top = extents_.n, bottom = 0;
        for (const FloodRun& run : std::span(runs_).first(connected_runs_)) {
            const int n = static_cast<int>(run.row) / extents_.m;
            left = std::min(left, static_cast<int>(run.first - run.row));
            right = std::max(right, static_cast<int>(run.last - run.row));
            top = std::min(top, n), bottom = std::max(bottom, n);
        }
        return std::max(right - left, bottom - top) + 1;
    };
    int longest = 0;
    for (std::uint32_t k = 0; k < state_.size(); ++k) {
        if ((state_[k] & (kUnreached | kCounted)) != kUnreached) continue;
        mark_connected(k, kUnreached, kCounted, Connected::at_corners_too);
        longest = std::max(longest, longer_side());
    }
    for (std::uint32_t k = 0; k < state_.size(); ++k) {
        if ((state_[k] & (kCounted | kPart)) != kCounted) continue;
        mark_connected(k, kCounted, kPart, Connected::at_corners_too);
        if (longer_side() * kShortestPiece >= longest) continue;
        for_each_connected([&](std::size_t at) { state_[at] &= static_cast<std::uint8_t>(~(kPart | kCounted)); });
    }
}

// Marks every lenslet that is connected to `seed` through lenslets with the bit `through`. Returns their number;
// for_each_connected() visits them.
std::size_t RimFinder::mark_connected(std::uint32_t seed, std::uint8_t through, std::uint8_t mark,
                                      Connected connected) {
    std::uint8_t* const state = state_.data();
    const Flooded flooded = flood_by_runs(
        extents_, seed, connected, runs_, [=](std::size_t k) { return (state[k] & (through | mark)) == through; },
        [=](std::size_t k) { state[k] |= mark; });
    connected_runs_ = flooded.runs;
    return flooded.lenslets;
}

// Step 3 of a round part, second half. Sets kInside between lenslets of the part in a row or a column; everywhere if
// there is no part.
void RimFinder::enclose() {
    const auto columns = static_cast<std::size_t>(extents_.m);
    const auto none = static_cast<std::int16_t>(extents_.n);
    std::int16_t *const first_row = of_columns_.first.data(), *const last_row = of_columns_.last.data();
    std::ranges::fill(of_columns_.first, none);
    std::ranges::fill(of_columns_.last, std::int16_t{-1});
    bool any = false;
    for (int n = 0; n < extents_.n; ++n) {
        std::uint8_t* const row = state_.data() + extents_.index(0, n);
        std::size_t first = 0, last = columns;
        while (first < columns && (row[first] & kPart) == 0) ++first;
        while (last > first && (row[last - 1] & kPart) == 0) --last;
        of_rows_.first[static_cast<std::size_t>(n)] = static_cast<std::int16_t>(first);
        of_rows_.last[static_cast<std::size_t>(n)] = static_cast<std::int16_t>(static_cast<int>(last) - 1);
        any = any || first < columns;
        const auto here = static_cast<std::int16_t>(n);
        for (std::size_t m = first; m < last; ++m) {
            const bool part = (row[m] & kPart) != 0;
            first_row[m] = std::min(first_row[m], part ? here : none);
            last_row[m] = part ? here : last_row[m];
        }
        for (std::size_t m = first; m < last; ++m) row[m] |= kInside;
    }
    if (!any) {
        for (std::uint8_t& state : state_) state |= kInside | kPart;
        return;
    }
    for (int n = 0; n < extents_.n; ++n) {
        std::uint8_t* const row = state_.data() + extents_.index(0, n);
        const auto here = static_cast<std::int16_t>(n);
        for (std::size_t m = 0; m < columns; ++m)
            row[m] |= (here >= first_row[m]) & (here <= last_row[m]) ? kInside : 0;
    }
    if (form_ == PartForm::round) enclose_hull();
}

// A part that stands askew encloses lenslets that have it on both sides in neither their row nor their column: the ends
// of the free middle of a cylinder lens. open_gaps() takes back what is no inside of the part.
void RimFinder::enclose_hull() {
    hull_.take(state_, kPart);
    hull_.close();
    std::size_t k = 0;
    for (std::size_t n = 0; n < static_cast<std::size_t>(extents_.n); ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            if (hull_.contains(n, m)) state_[k] |= kInside;
        }
    }
}

// Step 3, the end: free light between lenslets of the part that lies across a jump of the light from them is a gap,
// such as a notch, and no inside of the part. (The flat middle of a cylinder lens: there the light changes slowly.)
// What is between lenslets of a row, and what is between those of a column, is looked at for itself. What only the hull
// encloses is inside where the rest of its region is. Clears kInside.
void RimFinder::open_gaps(const FieldLight& light) {
    constexpr std::uint8_t kFreeInside = kInside | kReached;
    struct Ends {
        std::size_t all = 0, sharp = 0;
        [[nodiscard]] bool smooth() const { return sharp * kGapSteps < all; }
    };
    // Four lenslets in a line: the free one, and three of the part as far as they go.
    const auto step = [&](Ends& ends, int m, int n, int dm, int dn) {
        std::array<std::size_t, 4> at{};
        std::size_t length = 0;
        for (; length < at.size() && m >= 0 && n >= 0 && m < extents_.m && n < extents_.n; m += dm, n += dn) {
            const std::size_t here = extents_.index(m, n);
            if (length > 0 && (state_[here] & kPart) == 0) break;
            at[length++] = here;
        }
        if (length < 2) return;
        ++ends.all;
        ends.sharp += jumps(light, at[0], at[1]) && !(length == at.size() && slope_goes_on(light, at)) ? 1 : 0;
    };
    const auto place_of = [&](std::size_t k) { return std::div(static_cast<int>(k), extents_.m); };
    const auto not_counted = [state = state_.data()](std::size_t k) {
        return (state[k] & (kFreeInside | kCounted)) == kFreeInside;
    };
    for_each_suiting(0, state_.size(), not_counted, [&](std::size_t k) {
        mark_connected(static_cast<std::uint32_t>(k), kFreeInside, kCounted, Connected::at_sides);
        Ends in_rows, in_columns, in_hull;  // in_hull: of lenslets that only the hull encloses
        for_each_connected([&](std::size_t at) {
            const auto [n, m] = place_of(at);
            const bool in_row = closed_in_row(m, n), in_column = closed_in_column(m, n),
                       in_neither = !in_row && !in_column;
            Ends &of_row = in_row ? in_rows : in_hull, &of_column = in_column ? in_columns : in_hull;
            if (in_row || in_neither) step(of_row, m, n, -1, 0), step(of_row, m, n, 1, 0);
            if (in_column || in_neither) step(of_column, m, n, 0, -1), step(of_column, m, n, 0, 1);
        });
        for_each_connected([&](std::size_t at) {
            const auto [n, m] = place_of(at);
            const bool in_row = closed_in_row(m, n), in_column = closed_in_column(m, n);
            const bool inside = (in_row && in_rows.smooth()) || (in_column && in_columns.smooth()) ||
                (!in_row && !in_column && (in_hull.smooth() || in_rows.smooth() || in_columns.smooth()));
            if (!inside) state_[at] &= static_cast<std::uint8_t>(~kInside);
        });
    });
    close_islands();
}

// An island, dark for example, that only the hull encloses is inside where the free light around it is.
void RimFinder::close_islands() {
    const auto is_island = [state = state_.data()](std::size_t k) {
        return (state[k] & (kInside | kUnreached | kPart | kFlank)) == (kInside | kUnreached);
    };
    const auto is_closed = [&](std::size_t k) {
        const auto [n, m] = std::div(static_cast<int>(k), extents_.m);
        return closed_in_row(m, n) || closed_in_column(m, n);
    };
    for_each_suiting(0, state_.size(), is_island, [&](std::size_t k) {
        if (is_closed(k)) return;
        mark_connected(static_cast<std::uint32_t>(k), kInside | kUnreached, kFlank, Connected::at_corners_too);
        bool inside = false;
        for_each_connected([&](std::size_t at) {
            const auto [n, m] = std::div(static_cast<int>(at), extents_.m);
            extents_.for_each_around(m, n, 1, [&](int x, int y) {
                inside = inside || (state_[extents_.index(x, y)] & (kInside | kReached)) == (kInside | kReached);
            });
        });
        if (inside) return;
        for_each_connected([&](std::size_t at) {
            if (!is_closed(at)) state_[at] &= static_cast<std::uint8_t>(~kInside);
        });
    });
    for (std::uint8_t& state : state_) state &= static_cast<std::uint8_t>(~kFlank);
}

// Step 4. Flanks are rim. Any other lenslet is rim if the square window of `margin_` lenslets around it holds part and
// other lenslets, or leaves the field.
void RimFinder::mark_rim(std::span<std::uint8_t> mask) {
    const auto columns = in_column_.size();
    std::int16_t* const in_column = in_column_.data();
    const std::uint8_t* const in_rim = in_rim_.data();
    const auto count = [&](int n, int sign) {
        const std::uint8_t* const row = state_.data() + extents_.index(0, n);
        const auto one = static_cast<std::int16_t>(sign);
        for (std::size_t m = 0; m < columns; ++m)
            in_column[m] = static_cast<std::int16_t>(in_column[m] + ((row[m] & kInside) != 0 ? one : 0));
    };
    std::ranges::fill(in_column_, std::int16_t{0});
    for (int n = 0; n < std::min(margin_, extents_.n); ++n) count(n, 1);
    for (int n = 0; n < extents_.n; ++n) {
        if (n + margin_ < extents_.n) count(n + margin_, 1);
        if (n - margin_ - 1 >= 0) count(n - margin_ - 1, -1);
        if (n < margin_ || n >= extents_.n - margin_) std::ranges::fill(in_rim_, std::uint8_t{1});
        else find_across_outline();
        const std::uint8_t* const row = state_.data() + extents_.index(0, n);
        std::uint8_t* const out = mask.data() + extents_.index(0, n);
        for (std::size_t m = 0; m < columns; ++m) {
            const bool rim = (in_rim[m] | (row[m] & kFlank)) != 0;
            out[m] |= static_cast<std::uint8_t>((row[m] & kInside) == 0 ? kOutside : rim ? kRim : 0);
        }
    }
}

// Sets in_rim_ for a row whose windows hold in_column_ lenslets of the part in each column.
void RimFinder::find_across_outline() {
    constexpr std::uint8_t kHasPart = 1, kHasOther = 2;
    const int columns = extents_.m, margin = margin_, side = 2 * margin + 1;
    std::ranges::fill(in_rim_, std::uint8_t{1});
    const std::int16_t* const part = in_column_.data();
    std::uint8_t *const seen = seen_.data(), *const in_rim = in_rim_.data();
    for (int m = 0; m < columns; ++m)
        seen[m] = static_cast<std::uint8_t>((part[m] != 0 ? kHasPart : 0) | (part[m] != side ? kHasOther : 0));
    // What is seen in `width` columns, from each column on.
    for (int width = 1; width < side;) {
        const int more = std::min(width, side - width);
        for (int m = 0; m + more < columns; ++m) seen[m] |= seen[m + more];
        width += more;
    }
    for (int m = margin; m < columns - margin; ++m) in_rim[m] = seen[m - margin] == (kHasPart | kHasOther) ? 1 : 0;
}

}  // namespace hord::algo
