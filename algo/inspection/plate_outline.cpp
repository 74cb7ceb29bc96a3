#include "algo/inspection/plate_outline.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"

namespace hord::algo {

using namespace outline;

namespace {

constexpr std::size_t kNarrowest = 8;  // a plate is at least about 1/kNarrowest as wide as it is long

// Whether lenslets of edges lie along most of the way from one lenslet to the other, a lenslet aside at the most.
bool edge_runs(std::span<const std::uint8_t> state, const Extents& e, int m0, int n0, int m1, int n1) {
    const int steps = std::max({std::abs(m1 - m0), std::abs(n1 - n0), 1});
    int seen = 0;
    for (int k = 0; k <= steps; ++k) {
        const int m = m0 + static_cast<int>(std::lround(static_cast<double>(m1 - m0) * k / steps));
        const int n = n0 + static_cast<int>(std::lround(static_cast<double>(n1 - n0) * k / steps));
        bool near = false;
        for (int y = std::max(0, n - 1); y <= std::min(e.n - 1, n + 1); ++y) {
            for (int x = std::max(0, m - 1); x <= std::min(e.m - 1, m + 1); ++x)
                near = near ||
                    (state[static_cast<std::size_t>(y) * static_cast<std::size_t>(e.m) + static_cast<std::size_t>(x)] &
                     kPart) != 0;
        }
        seen += near ? 1 : 0;
    }
    return 2 * seen > steps + 1;
}

}  // namespace

bool PlateOutline::find(std::span<std::uint8_t> state) {
    hull_.take(state, kPart);
    if (!is_plate(hull_.close())) return false;
    add_corners(state);
    hull_.close();
    std::size_t k = 0;
    for (std::size_t n = 0; n < static_cast<std::size_t>(extents_.n); ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k)
            state[k] = static_cast<std::uint8_t>((state[k] & ~kPart) | (hull_.contains(n, m) ? kPart | kInside : 0));
    }
    return true;
}

// Large enough, and not so narrow that it may be a single edge.
bool PlateOutline::is_plate(std::size_t lenslets) const {
    if (lenslets * kSmallestPart < extents_.lenslets()) return false;
    int left = extents_.m, right = extents_.m, rows = 0;
    for (std::size_t n = 0; n < static_cast<std::size_t>(extents_.n); ++n) {
        if (!hull_.has(n)) continue;
        left = std::min(left, hull_.left(n)), right = std::min(right, hull_.right(n));
        ++rows;
    }
    const auto squared = [](int v) { return static_cast<std::size_t>(v) * static_cast<std::size_t>(v); };
    return lenslets * kNarrowest >= squared(extents_.m - left - right) + squared(rows);
}

// The corners of the field between two sides that the plate reaches, where no edge cuts them off.
void PlateOutline::add_corners(std::span<const std::uint8_t> state) {
    const int last = extents_.n - 1;
    const auto at = [](int n) { return static_cast<std::size_t>(n); };
    std::array<std::array<bool, 2>, 2> belongs{};  // first and last row; left and right
    for (const int row : {0, last}) {
        if (!hull_.has(at(row))) continue;  // does not reach this side
        for (const bool left : {true, false}) {
            // The row nearest to the corner in which the plate reaches the other side.
            int beside = row;
            const auto reaches = [&](int n) { return (left ? hull_.left(at(n)) : hull_.right(at(n))) == 0; };
            while (beside >= 0 && beside <= last && !reaches(beside)) beside += row == 0 ? 1 : -1;
            if (beside < 0 || beside > last) continue;
            const int m = left ? hull_.left(at(row)) : extents_.m - 1 - hull_.right(at(row));
            belongs[row == 0 ? 0 : 1][left ? 0 : 1] =
                !edge_runs(state, extents_, m, row, left ? 0 : extents_.m - 1, beside);
        }
    }
    for (const int row : {0, last}) {
        if (belongs[row == 0 ? 0 : 1][0]) hull_.reach_left(at(row));
        if (belongs[row == 0 ? 0 : 1][1]) hull_.reach_right(at(row));
    }
}

}  // namespace hord::algo
