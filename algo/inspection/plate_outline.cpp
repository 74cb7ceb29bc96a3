#include "algo/inspection/plate_outline.h"

#include <algorithm>

#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"

namespace hord::algo {

using namespace outline;

namespace {
constexpr std::size_t kNarrowest = 8;  // a plate is at least about 1/kNarrowest as wide as it is long
}

bool PlateOutline::find(std::span<std::uint8_t> state) {
    hull_.take(state, kPart);
    if (!is_plate(hull_.close())) return false;
    add_corners();
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

// The corners of the field between two sides that the plate reaches.
void PlateOutline::add_corners() {
    bool left = false, right = false;
    const auto last = static_cast<std::size_t>(extents_.n - 1);
    for (std::size_t n = 0; n <= last; ++n) {
        left = left || hull_.left(n) == 0;
        right = right || hull_.right(n) == 0;
    }
    for (const std::size_t row : {std::size_t{0}, last}) {
        if (!hull_.has(row)) continue;  // does not reach this side
        if (left) hull_.reach_left(row);
        if (right) hull_.reach_right(row);
    }
}

}  // namespace hord::algo
