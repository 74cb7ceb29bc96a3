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

bool close(DeflectionQ a, DeflectionQ b) { return std::abs(std::int64_t{a.raw()} - b.raw()) <= kFreeTolerance; }

}  // namespace

int default_rim_margin(const Extents& extents) {
    return static_cast<int>(std::lround(1.5 + std::max(extents.m, extents.n) / 222.0));
}

RimFinder::RimFinder(const Extents& extents, int margin)
    : extents_(extents), margin_(margin), state_(extents.lenslets()), queue_(extents.lenslets()),
      first_(static_cast<std::size_t>(extents.m)), last_(static_cast<std::size_t>(extents.m)),
      part_in_column_(static_cast<std::size_t>(extents.m)) {
    for (int n = 0; n < extents.n; ++n) {
        const bool whole_row = n == 0 || n == extents.n - 1;
        for (int m = 0; m < extents.m; m += whole_row ? 1 : extents.m - 1)
            ring_.push_back(static_cast<std::uint32_t>(n * extents.m + m));
    }
    ring_values_.resize(ring_.size());
}

void RimFinder::mark(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
                     std::span<std::uint8_t> mask) {
    std::ranges::fill(state_, std::uint8_t{0});
    if (find_free_light(deflections, sums, mask)) {
        reach_free_field();
        keep_large_parts();
    }
    enclose();
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
    const auto around = [&](int m, int n, auto&& holds) {  // for every lenslet of the field in the 3x3 around (m, n)
        for (int y = std::max(n - 1, 0); y <= std::min(n + 1, extents_.n - 1); ++y) {
            for (int x = std::max(m - 1, 0); x <= std::min(m + 1, extents_.m - 1); ++x) {
                if (!holds(state_[static_cast<std::size_t>(y * extents_.m + x)])) return false;
            }
        }
        return true;
    };
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            if (around(m, n, [](std::uint8_t state) { return (state & kFree) != 0; })) state_[k] |= kWide;
        }
    }
    for (const std::uint32_t at : ring_) {
        if ((state_[at] & kFree) != 0) state_[at] |= kWide;  // outside the field light is free
    }
    for (const std::uint32_t at : ring_) {
        if ((state_[at] & (kWide | kReached)) == kWide) flood(at, kWide, kReached, false);
    }
    k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            const bool next_to_reached =
                !around(m, n, [](std::uint8_t state) { return (state & (kWide | kReached)) != (kWide | kReached); });
            if ((state_[k] & kFree) != 0 && next_to_reached) state_[k] |= kReached;
            if ((state_[k] & kReached) == 0) state_[k] |= kUnreached;
        }
    }
}

// Step 3, first half. Sets kPart.
void RimFinder::keep_large_parts() {
    for (std::uint32_t k = 0; k < state_.size(); ++k) {
        if ((state_[k] & (kUnreached | kCounted)) != kUnreached) continue;
        const std::size_t count = flood(k, kUnreached, kCounted, true);
        if (count * kSmallestPart < state_.size()) continue;
        for (std::size_t q = 0; q < count; ++q) state_[queue_[q]] |= kPart;
    }
}

// Marks every lenslet that is connected to `seed` through lenslets with the bit `through`. Returns their number; queue_
// holds them.
std::size_t RimFinder::flood(std::uint32_t seed, std::uint8_t through, std::uint8_t mark, bool diagonally) {
    std::size_t count = 0;
    const auto visit = [&](int m, int n) {
        if (m < 0 || n < 0 || m >= extents_.m || n >= extents_.n) return;
        const auto k = static_cast<std::uint32_t>(n * extents_.m + m);
        if ((state_[k] & (through | mark)) != through) return;
        state_[k] |= mark;
        queue_[count++] = k;
    };
    visit(static_cast<int>(seed) % extents_.m, static_cast<int>(seed) / extents_.m);
    for (std::size_t q = 0; q < count; ++q) {
        const int m = static_cast<int>(queue_[q]) % extents_.m, n = static_cast<int>(queue_[q]) / extents_.m;
        for (int y = -1; y <= 1; ++y) {
            for (int x = -1; x <= 1; ++x) {
                if (diagonally || x == 0 || y == 0) visit(m + x, n + y);
            }
        }
    }
    return count;
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
    const auto part_at = [&](int m, int n) {
        return (state_[static_cast<std::size_t>(n * extents_.m + m)] & kPart) != 0 ? 1 : 0;
    };
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
