// The convex hull of a set of lenslets, as the columns between which each row of it lies.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "algo/frame/extents.h"

namespace hord::algo {

class RowHull {
  public:
    explicit RowHull(const Extents& extents);  // allocates all memory

    // Takes the first and the last lenslet with one of `bits` in each row.
    void take(std::span<const std::uint8_t> state, std::uint8_t bits);

    // Makes both borders convex. Returns the number of lenslets between them: those whose centres lie in the hull.
    std::size_t close();

    // The columns of a row. Both borders are counted from their own side of the field: `left` lenslets before the first
    // one, `right` after the last one.
    [[nodiscard]] bool has(std::size_t row) const { return left_[row] < extents_.m; }
    [[nodiscard]] int left(std::size_t row) const { return left_[row]; }
    [[nodiscard]] int right(std::size_t row) const { return right_[row]; }
    [[nodiscard]] bool contains(std::size_t row, int m) const {
        return has(row) && m >= left_[row] && m < extents_.m - right_[row];
    }
    void reach_left(std::size_t row) { left_[row] = 0; }
    void reach_right(std::size_t row) { right_[row] = 0; }

  private:
    void close(std::vector<int>& edge);

    Extents extents_;
    std::vector<int> left_, right_;  // extents_.m: the row has none
    std::vector<int> chain_;         // rows of the hull's corners
};

}  // namespace hord::algo
