#include "algo/inspection/plate_outline.h"

#include <algorithm>
#include <cstdint>

#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"

namespace hord::algo {

using namespace outline;

namespace {
constexpr std::size_t kNarrowest = 8;  // a plate is at least about 1/kNarrowest as wide as it is long
}

PlateOutline::PlateOutline(const Extents& extents)
    : extents_(extents), left_(static_cast<std::size_t>(extents.n)), right_(static_cast<std::size_t>(extents.n)) {
    chain_.reserve(static_cast<std::size_t>(extents.n));
}

bool PlateOutline::find(std::span<std::uint8_t> state) {
    for (int n = 0; n < extents_.n; ++n) {
        const std::uint8_t* row = state.data() + static_cast<std::ptrdiff_t>(n) * extents_.m;
        int first = 0, last = extents_.m - 1;
        while (first < extents_.m && (row[first] & kPart) == 0) ++first;
        while (last > first && (row[last] & kPart) == 0) --last;
        left_[static_cast<std::size_t>(n)] = first;
        right_[static_cast<std::size_t>(n)] = first < extents_.m ? extents_.m - 1 - last : extents_.m;
    }
    if (!is_plate(close_hull())) return false;
    add_corners();
    close_hull();
    std::size_t k = 0;
    for (std::size_t n = 0; n < left_.size(); ++n) {
        const int last = extents_.m - 1 - right_[n];
        for (int m = 0; m < extents_.m; ++m, ++k) {
            const bool inside = left_[n] < extents_.m && m >= left_[n] && m <= last;
            state[k] = static_cast<std::uint8_t>((state[k] & ~kPart) | (inside ? kPart | kInside : 0));
        }
    }
    return true;
}

// Large enough, and not so narrow that it may be a single edge.
bool PlateOutline::is_plate(std::size_t lenslets) const {
    if (lenslets * kSmallestPart < extents_.lenslets()) return false;
    int left = extents_.m, right = extents_.m, rows = 0;
    for (std::size_t n = 0; n < left_.size(); ++n) {
        if (left_[n] == extents_.m) continue;
        left = std::min(left, left_[n]), right = std::min(right, right_[n]);
        ++rows;
    }
    const auto squared = [](int v) { return static_cast<std::size_t>(v) * static_cast<std::size_t>(v); };
    return lenslets * kNarrowest >= squared(extents_.m - left - right) + squared(rows);
}

// Makes both borders of the plate convex. Returns the number of lenslets between them.
std::size_t PlateOutline::close_hull() {
    close(left_);
    close(right_);
    std::size_t count = 0;
    for (std::size_t n = 0; n < left_.size(); ++n) {
        if (left_[n] < extents_.m) count += static_cast<std::size_t>(extents_.m - left_[n] - right_[n]);
    }
    return count;
}

// Replaces a border by the largest convex function of the row that is nowhere above it. (Andrew's monotone chain.)
void PlateOutline::close(std::vector<int>& edge) {
    chain_.clear();
    const auto at = [&](int n) { return std::int64_t{edge[static_cast<std::size_t>(n)]}; };
    for (int n = 0; n < extents_.n; ++n) {
        if (at(n) == extents_.m) continue;
        while (chain_.size() >= 2) {
            const int a = chain_[chain_.size() - 2], b = chain_.back();
            if ((at(b) - at(a)) * (n - a) < (at(n) - at(a)) * (b - a)) break;  // b lies below the line from a to n
            chain_.pop_back();
        }
        chain_.push_back(n);
    }
    for (std::size_t corner = 1; corner < chain_.size(); ++corner) {
        const int from = chain_[corner - 1], to = chain_[corner];
        for (int n = from + 1; n < to; ++n) {
            // Rounded up: the centres of the plate's lenslets are inside. The sum is not negative.
            edge[static_cast<std::size_t>(n)] =
                static_cast<int>((at(from) * (to - n) + at(to) * (n - from) + (to - from - 1)) / (to - from));
        }
    }
}

// The corners of the field between two sides that the plate reaches.
void PlateOutline::add_corners() {
    const bool left = std::ranges::find(left_, 0) != left_.end(), right = std::ranges::find(right_, 0) != right_.end();
    const auto add = [&](std::size_t row) {
        if (left_[row] == extents_.m) return;  // does not reach this side
        if (left) left_[row] = 0;
        if (right) right_[row] = 0;
    };
    add(0);
    add(left_.size() - 1);
}

}  // namespace hord::algo
