// The size of a light field: numbers of lenslets, and of angular bins in each.
//
// (m, n) counts lenslets, (i, j) the bins inside a lenslet, both to the right and downwards. The centre of the bins,
// ((I-1)/2, (J-1)/2), is zero deflection; it lies between two bins if their number is even. Paper: Meyer et al.,
// section 2.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>

#include "common/result.h"

namespace hord::algo {

struct Extents {
    int m = 0;  // lenslet columns, 3..2048
    int n = 0;  // lenslet rows, 3..2048
    int i = 0;  // bin columns, 3..15
    int j = 0;  // bin rows, 3..15

    friend bool operator==(const Extents&, const Extents&) = default;

    [[nodiscard]] constexpr std::size_t lenslets() const {
        return static_cast<std::size_t>(m) * static_cast<std::size_t>(n);
    }
    [[nodiscard]] constexpr int bins() const { return i * j; }

    // Of lenslet (m, n) in an array with one value a lenslet, row by row.
    [[nodiscard]] constexpr std::size_t index(int column, int row) const {
        return static_cast<std::size_t>(row) * static_cast<std::size_t>(m) + static_cast<std::size_t>(column);
    }
    // Calls visit(m, n) for every lenslet of the field at most `reach` columns and rows away, row by row.
    template <class Visit>
    void for_each_around(int column, int row, int reach, Visit&& visit) const {
        for (int y = std::max(0, row - reach); y <= std::min(n - 1, row + reach); ++y) {
            for (int x = std::max(0, column - reach); x <= std::min(m - 1, column + reach); ++x) visit(x, y);
        }
    }

    // Image size of the macro-pixel frame of this light field: sample (m,n,i,j) is at column m*I+i, row n*J+j.
    [[nodiscard]] constexpr int width_px() const { return m * i; }
    [[nodiscard]] constexpr int height_px() const { return n * j; }
};

constexpr int kMinLenslets = 3;
constexpr int kMaxLenslets = 2048;
constexpr int kMinBins = 3;
constexpr int kMaxBins = 15;

// The extents of a macro-pixel frame of width x height pixels with i x j bins a lenslet.
// Fails with invalid_argument if the bins do not divide the frame or a limit is exceeded.
Result<Extents> extents_of_frame(int width_px, int height_px, int bins_i, int bins_j);

// Reads "9x9", bin columns x bin rows, within the limits above. None: it is something else.
std::optional<std::pair<int, int>> parse_bins(std::string_view text);

// Checks the limits above. Fails with invalid_argument.
Result<void> check(const Extents& extents);

}  // namespace hord::algo
