// The cost matrix (cells) of a transport problem. For transport_simplex.cpp and its parts only.
//
// Costs are integers up to kMaxCost. Their low bits are a tag: row and column of the cell (10 bits for 19 x 22 cells,
// at most 16). So no two cells are equal, and the least value identifies its cell.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "algo/simd/vec.h"

namespace hord::algo {

struct TransportCosts {
    static constexpr int kLanes = 8;
    static constexpr std::int32_t kMaxCost = 1 << 27;
    static constexpr std::int32_t kPadding = 1 << 30;                                  // cost of padding columns
    static constexpr std::int32_t kNoCell = std::numeric_limits<std::int32_t>::max();  // above all cells
    static constexpr std::int32_t kMaxDual = 1 << 29;  // keeps reduced costs < 2^31, and those of padding > 0

    static constexpr int padded(int count) { return (count + kLanes - 1) / kLanes * kLanes; }
};

template <int Bytes>
struct TransportCells : TransportCosts {
    using Ints = Vec<std::int32_t, kLanes, Bytes>;

    int rows, cols;
    int stride;          // columns, padded to whole vectors
    int col_bits;        // column bits of a tag
    std::int32_t tags;   // mask of a tag
    std::int32_t* cell;  // row by row

    HORD_ALWAYS_INLINE TransportCells(int row_count, int col_count, std::int32_t* at)
        : rows(row_count), cols(col_count), stride(padded(cols)), col_bits(bits_for(stride)),
          tags((1 << (col_bits + bits_for(rows))) - 1), cell(at) {}

    HORD_ALWAYS_INLINE std::int32_t* row(int i) const { return cell + i * stride; }
    HORD_ALWAYS_INLINE int row_of(std::int32_t tagged) const { return (tagged & tags) >> col_bits; }
    HORD_ALWAYS_INLINE int col_of(std::int32_t tagged) const { return tagged & ((1 << col_bits) - 1); }

    // best[j] = min over rows i of (cell(i, j) + of_rows[i]). at(i): the cells of the i-th row.
    template <int Vectors, class At>
    HORD_ALWAYS_INLINE static void least_of_columns(int row_count, At at, const std::int32_t* of_rows,
                                                    Ints (&best)[Vectors]) {
        for (Ints& b : best) b = Ints::broadcast(kPadding);
        for (int i = 0; i < row_count; ++i) {
            const std::int32_t* const cells = at(i);
            const Ints of_row = Ints::broadcast_first(of_rows + i);
            for (int k = 0; k < Vectors; ++k) best[k] = min(best[k], Ints::load(cells + k * kLanes) + of_row);
        }
    }

    // Calls do_it(first column, number of vectors) until all columns are covered, with as many vectors as fit
    // registers.
    template <class Do>
    HORD_ALWAYS_INLINE void for_columns(Do do_it) const {
        if constexpr (Bytes >= 32) {
            if (stride == 4 * kLanes) return do_it(0, std::integral_constant<int, 4>{});  // instead of three and one
        }
        int j = 0;
        for (; j + 3 * kLanes <= stride; j += 3 * kLanes) do_it(j, std::integral_constant<int, 3>{});
        if (j + 2 * kLanes <= stride) {
            do_it(j, std::integral_constant<int, 2>{});
        } else if (j + kLanes <= stride) {
            do_it(j, std::integral_constant<int, 1>{});
        }
    }

  private:
    static int bits_for(int count) { return std::bit_width(static_cast<unsigned>(count - 1)); }
};

}  // namespace hord::algo
