#include "algo/inspection/row_hull.h"

namespace hord::algo {

RowHull::RowHull(const Extents& extents)
    : extents_(extents), left_(static_cast<std::size_t>(extents.n)), right_(static_cast<std::size_t>(extents.n)) {
    chain_.reserve(static_cast<std::size_t>(extents.n));
}

void RowHull::take(std::span<const std::uint8_t> state, std::uint8_t bits) {
    for (int n = 0; n < extents_.n; ++n) {
        const std::uint8_t* row = state.data() + static_cast<std::ptrdiff_t>(n) * extents_.m;
        int first = 0, last = extents_.m - 1;
        while (first < extents_.m && (row[first] & bits) == 0) ++first;
        while (last > first && (row[last] & bits) == 0) --last;
        left_[static_cast<std::size_t>(n)] = first;
        right_[static_cast<std::size_t>(n)] = first < extents_.m ? extents_.m - 1 - last : extents_.m;
    }
}

std::size_t RowHull::close() {
    close(left_);
    close(right_);
    std::size_t count = 0;
    for (std::size_t n = 0; n < left_.size(); ++n) {
        if (has(n)) count += static_cast<std::size_t>(extents_.m - left_[n] - right_[n]);
    }
    return count;
}

// Replaces a border by the largest convex function of the row that is nowhere above it. (Andrew's monotone chain.)
void RowHull::close(std::vector<int>& edge) {
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
            // Rounded up: the centres of the lenslets are inside. The sum is not negative.
            edge[static_cast<std::size_t>(n)] =
                static_cast<int>((at(from) * (to - n) + at(to) * (n - from) + (to - from - 1)) / (to - from));
        }
    }
}

}  // namespace hord::algo
