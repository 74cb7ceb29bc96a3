#include "algo/inspection/rim.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

// State of a lenslet; bits combine.
enum State : std::uint8_t {
    kFree = 1,       // shows free light
    kWide = 2,       // all its neighbours in the field are kFree, too: the flood fill passes through it
    kReached = 4,    // free field
    kUnreached = 8,  // all else
    kPart = 16,      // in a region large enough to be a part
    kInside = 32,    // part, or enclosed by part
    kCounted = 64,   // in a region whose size is known
};

constexpr std::int64_t kFreeTolerance =
    static_cast<std::int64_t>(kFreeToleranceBins * (1 << DeflectionQ::kFractionBits));

static_assert(kReached == FoundPart::kFreeField);

bool close(DeflectionQ a, DeflectionQ b) { return std::abs(std::int64_t{a.raw()} - b.raw()) <= kFreeTolerance; }

}  // namespace

int default_rim_margin(const Extents& extents) {
    return static_cast<int>(std::lround(1.5 + std::max(extents.m, extents.n) / 222.0));
}

RimFinder::RimFinder(const Extents& extents, int margin)
    : extents_(extents), margin_(margin), state_(extents.lenslets()), region_(extents.lenslets()),
      queue_(extents.lenslets()), first_(static_cast<std::size_t>(extents.m)),
      last_(static_cast<std::size_t>(extents.m)), part_in_column_(static_cast<std::size_t>(extents.m)) {
    for (int n = 0; n < extents.n; ++n) {
        const bool whole_row = n == 0 || n == extents.n - 1;
        for (int m = 0; m < extents.m; m += whole_row ? 1 : extents.m - 1)
            ring_.push_back(static_cast<std::uint32_t>(extents.index(m, n)));
    }
    ring_values_.resize(ring_.size());
}

void RimFinder::mark(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
                     std::span<std::uint8_t> mask) {
    std::ranges::fill(state_, std::uint8_t{0});
    found_ = {.free_light = find_free_light(deflections, sums, mask), .state = state_};
    regions_ = 0;
    if (found_.free_light) {
        reach_free_field();
        keep_large_parts();
    }
    enclose();
    if (regions_ > 0) describe(deflections, sums, mask);
    mark_rim(mask);
}

// Step 1 (docs/notes/inspection.md). Sets kFree; false if the outermost lenslets show no free light.
bool RimFinder::find_free_light(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
                                std::span<const std::uint8_t> mask) {
    const auto median_of_ring = [&](auto&& value_of) -> std::int64_t {
        std::size_t count = 0;
        for (const std::uint32_t k : ring_) {
            if ((mask[k] & kDark) == 0) ring_values_[count++] = value_of(k);
        }
        return 2 * count < ring_.size() ? -1 : common::lower_median(std::span(ring_values_).first(count));
    };
    const std::int64_t sum = median_of_ring([&](std::uint32_t k) { return std::int64_t{sums[k]}; });
    if (sum < 0) return false;
    const auto x =
        DeflectionQ::from_raw(median_of_ring([&](std::uint32_t k) { return std::int64_t{deflections[k].x.raw()}; }));
    const auto y =
        DeflectionQ::from_raw(median_of_ring([&](std::uint32_t k) { return std::int64_t{deflections[k].y.raw()}; }));

    free_ = {x, y};
    for (std::size_t k = 0; k < state_.size(); ++k) {
        const bool free = (mask[k] & kDark) == 0 && close(deflections[k].x, x) && close(deflections[k].y, y) &&
            2 * std::int64_t{sums[k]} >= sum;
        state_[k] = static_cast<std::uint8_t>(free ? kFree : 0);
    }
    const auto agreeing = std::ranges::count_if(ring_, [&](std::uint32_t k) { return state_[k] == kFree; });
    return 2 * static_cast<std::size_t>(agreeing) >= ring_.size();
}

// Step 2. Sets kReached or kUnreached everywhere.
void RimFinder::reach_free_field() {
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            if ((state_[k] & kFree) == 0) continue;
            unsigned common = kFree;
            extents_.for_each_around(m, n, 1, [&](int x, int y) { common &= state_[extents_.index(x, y)]; });
            if (common != 0) state_[k] |= kWide;
        }
    }
    for (const std::uint32_t at : ring_) {
        if ((state_[at] & kFree) != 0) state_[at] |= kWide;  // outside the field light is free
    }
    for (const std::uint32_t at : ring_) {
        if ((state_[at] & (kWide | kReached)) == kWide) mark_connected(at, kWide, kReached, Connected::at_sides);
    }
    k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            if ((state_[k] & (kFree | kReached)) == kFree) {
                extents_.for_each_around(m, n, 1, [&](int x, int y) {
                    const std::uint8_t state = state_[extents_.index(x, y)];
                    if ((state & (kWide | kReached)) == (kWide | kReached)) state_[k] |= kReached;
                });
            }
            if ((state_[k] & kReached) == 0) state_[k] |= kUnreached;
        }
    }
}

// Step 3, first half. Sets kPart.
void RimFinder::keep_large_parts() {
    for (std::uint32_t k = 0; k < state_.size(); ++k) {
        if ((state_[k] & (kUnreached | kCounted)) != kUnreached) continue;
        const std::size_t count = mark_connected(k, kUnreached, kCounted, Connected::at_corners_too);
        if (count * kSmallestPart < state_.size()) continue;
        ++regions_;
        for (std::size_t q = 0; q < count; ++q) {
            state_[queue_[q]] |= kPart;
            region_[queue_[q]] = static_cast<std::uint8_t>(regions_);
        }
    }
}

// Marks every lenslet that is connected to `seed` through lenslets with the bit `through`. Returns their number; queue_
// holds them.
std::size_t RimFinder::mark_connected(std::uint32_t seed, std::uint8_t through, std::uint8_t mark,
                                      Connected connected) {
    return flood(extents_, seed, 1, connected, queue_, [&](std::size_t k) {
        if ((state_[k] & (through | mark)) != through) return false;
        state_[k] |= mark;
        return true;
    });
}

// Step 3, second half. Sets kInside between lenslets of the part in a row or a column; everywhere if there is no part.
void RimFinder::enclose() {
    const bool any = std::ranges::any_of(state_, [](std::uint8_t state) { return (state & kPart) != 0; });
    if (!any) {
        for (std::uint8_t& state : state_) state |= kInside | kPart;
        return;
    }
    std::ranges::fill(first_, extents_.n);
    std::ranges::fill(last_, -1);
    for (int n = 0; n < extents_.n; ++n) {
        std::uint8_t* row = state_.data() + static_cast<std::ptrdiff_t>(n) * extents_.m;
        int first = extents_.m, last = -1;
        for (int m = 0; m < extents_.m; ++m) {
            if ((row[m] & kPart) == 0) continue;
            const auto column = static_cast<std::size_t>(m);
            first = std::min(first, m);
            last = m;
            first_[column] = std::min(first_[column], n);
            last_[column] = n;
        }
        for (int m = first; m <= last; ++m) row[m] |= kInside;
    }
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (std::size_t m = 0; m < first_.size(); ++m, ++k) {
            if (n >= first_[m] && n <= last_[m]) state_[k] |= kInside;
        }
    }
}

// Step 4. A lenslet is rim if the square window of `margin_` lenslets around it holds part and other lenslets, or
// leaves the field. The window's count of part lenslets is updated from row to row and column to column.
void RimFinder::mark_rim(std::span<std::uint8_t> mask) {
    const int side = 2 * margin_ + 1;
    const auto part_at = [&](int m, int n) { return (state_[extents_.index(m, n)] & kPart) != 0 ? 1 : 0; };
    std::ranges::fill(part_in_column_, 0);
    for (int n = 0; n < std::min(margin_, extents_.n); ++n) {
        for (int m = 0; m < extents_.m; ++m) part_in_column_[static_cast<std::size_t>(m)] += part_at(m, n);
    }
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m) {
            int& column = part_in_column_[static_cast<std::size_t>(m)];
            if (n + margin_ < extents_.n) column += part_at(m, n + margin_);
            if (n - margin_ - 1 >= 0) column -= part_at(m, n - margin_ - 1);
        }
        int in_window = 0;
        for (int m = 0; m < std::min(margin_, extents_.m); ++m)
            in_window += part_in_column_[static_cast<std::size_t>(m)];
        for (int m = 0; m < extents_.m; ++m, ++k) {
            if (m + margin_ < extents_.m) in_window += part_in_column_[static_cast<std::size_t>(m + margin_)];
            if (m - margin_ - 1 >= 0) in_window -= part_in_column_[static_cast<std::size_t>(m - margin_ - 1)];
            const bool leaves_field =
                m < margin_ || n < margin_ || m >= extents_.m - margin_ || n >= extents_.n - margin_;
            const bool across_outline = in_window != 0 && in_window != side * side;
            if ((state_[k] & kInside) == 0) {
                mask[k] |= kOutside;
            } else if (leaves_field || across_outline) {
                mask[k] |= kRim;
            }
        }
    }
}

}  // namespace hord::algo
