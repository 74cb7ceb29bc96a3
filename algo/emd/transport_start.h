// The initial plan of the transportation simplex. For transport_simplex.cpp only.
//
// Repeatedly serves the open cell with the least c_ij - R_i - K_j until its row or column is used up, which closes it.
// R_i and K_j are kMeanWeight times the mass-weighted mean costs of a row and a column: floats, summed in a fixed
// order, rounded to the bits above the tags.
//
// Every step waits for the one before. So a step has no branch, and the steps of two problems are made in turns.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/emd/transport_cells.h"
#include "algo/emd/transport_simplex.h"
#include "algo/frame/occupied_bins.h"
#include "algo/simd/aligned.h"

namespace hord::algo {

// Memory for one problem. Arrays of constant size: one register holds the address of them all.
struct TransportStartSpace {
    static constexpr int kMaxVectors = 6;  // of columns that are held in registers
    static constexpr int kRowsAtOnce = 4;  // rows are padded to a multiple of it
    static constexpr int kSide = TransportCosts::padded(kMaxBinCount) + kMaxVectors * TransportCosts::kLanes;

    // `side`: the most rows and columns, padding included.
    explicit TransportStartSpace(std::size_t side)
        : cell((side + kRowsAtOnce) * (side + std::size_t{kMaxVectors * TransportCosts::kLanes})) {}

    AlignedVector<std::int32_t> cell;                              // c_ij - R_i + kOffset, rows x stride
    alignas(kAlignment) std::array<std::int32_t, kSide> mean_col;  // kOffset - K_j
    alignas(kAlignment) std::array<std::int32_t, kSide> least_of_col;
    alignas(kAlignment) std::array<float, kSide> share_col;
    std::array<double, kSide> left_row, left_col;  // masses; a row's is negative if it is closed
    std::array<TransportStep, std::size_t{2} * kSide> steps;
};

// The least open cell of each column, in registers for low latency.
template <int Vectors, int Bytes>
struct LeastOfColumns {
    using Ints = typename TransportCells<Bytes>::Ints;
    Ints of[Vectors];

    HORD_ALWAYS_INLINE LeastOfColumns(std::int32_t*, int) {}
    HORD_ALWAYS_INLINE std::int32_t least_cell() const {
        Ints least = of[0];
        for (int k = 1; k < Vectors; ++k) least = min(least, of[k]);
        return least.reduce_min();
    }
    HORD_ALWAYS_INLINE void set(int vector, const Ints& value) { of[vector] = value; }
    // The new values of a vector are not below those that it has.
    HORD_ALWAYS_INLINE void raise(int vector, const Ints& to) {
        const Ints it = Ints::broadcast(vector);
        for (int k = 0; k < Vectors; ++k) of[k] = max(of[k], Ints::broadcast(k).equal_to(it) & to);
    }
};

// The same in memory, for more columns than registers hold.
template <int Bytes>
struct LeastOfColumns<0, Bytes> {
    using Ints = typename TransportCells<Bytes>::Ints;
    static constexpr int kLanes = TransportCosts::kLanes;
    std::int32_t* of;
    int vectors;

    HORD_ALWAYS_INLINE LeastOfColumns(std::int32_t* memory, int count) : of(memory), vectors(count) {}
    HORD_ALWAYS_INLINE std::int32_t least_cell() const {
        Ints least = Ints::load(of);
        for (int k = 1; k < vectors; ++k) least = min(least, Ints::load(of + k * kLanes));
        return least.reduce_min();
    }
    HORD_ALWAYS_INLINE void set(int vector, const Ints& value) { value.store(of + vector * kLanes); }
    HORD_ALWAYS_INLINE void raise(int vector, const Ints& to) { set(vector, to); }
};

// The plan of one problem while it is found. Vectors: of columns, at least as many as the problem has; 0: as many as it
// has, in memory.
template <int Vectors, int Bytes>
class TransportStart {
  public:
    using Cells = TransportCells<Bytes>;

    // Masses are positive integers < 2^53; both sides have the same sum.
    HORD_ALWAYS_INLINE TransportStart(const Cells& of, TransportStartSpace& space, const double* supply,
                                      const double* demand)
        : cells(of), row_groups((cells.rows + kRowsAtOnce - 1) / kRowsAtOnce), cell(space.cell.data()), own(space),
          least(space.least_of_col.data(), stride() / kLanes) {
        for (int i = 0; i < cells.rows; ++i) own.left_row.data()[i] = supply[i];
        for (int j = 0; j < cells.cols; ++j) own.left_col.data()[j] = demand[j];
        find_means();
        for (int k = 0; k < stride() / kLanes; ++k)
            least.set(k, least_of_rows(k * kLanes) + Ints::load(own.mean_col.data() + k * kLanes));
    }

    // The plan has rows + cols - 1 steps; the last one uses up the last row.
    [[nodiscard]] HORD_ALWAYS_INLINE bool is_found() const { return step == cells.rows + cells.cols - 1; }

    // Serves the least cell of all columns, unless its row is closed. In both cases the vector of its column gets new
    // least cells.
    HORD_ALWAYS_INLINE void serve() {
        const std::int32_t best = least.least_cell();
        const int i = cells.row_of(best), j = cells.col_of(best), lane = j & (kLanes - 1), first = j - lane;
        // The least cells of all rows but this one, while it is not known yet whether the row stays open.
        std::int32_t* const of_row = cell + i * stride();
        const Ints here = Ints::load(of_row + first);
        Ints::broadcast(kPadding).store(of_row + first);
        const Ints others = least_of_rows(first);

        double &left_in_row = own.left_row.data()[i], &left_in_col = own.left_col.data()[j];
        const double in_row = left_in_row, in_col = left_in_col;
        const double flow = min(max(in_row, 0.0), in_col);  // the last column takes the rest of all rows
        const int open = flag(in_row >= 0);
        const int row_used_up = flag((in_row < in_col) | (open_cols == 1)) & open, col_used_up = open - row_used_up;
        own.steps.data()[step] = {flow, static_cast<std::int16_t>(i), static_cast<std::int16_t>(j), row_used_up != 0};
        step += open;
        open_cols -= col_used_up;
        left_in_row = in_row - flow - kUsedUp[row_used_up];
        left_in_col = in_col - flow;

        const Ints row_closes = Ints::broadcast(-row_used_up & kPadding);
        const Ints left_here = max(here, row_closes);
        const Ints it = Ints::iota().equal_to(Ints::broadcast(lane));
        std::int32_t* const mean_col = own.mean_col.data() + first;
        const Ints mean = max(Ints::load(mean_col), it & Ints::broadcast(-col_used_up & kClosed));
        mean.store(mean_col);
        least.raise(static_cast<int>(static_cast<unsigned>(j) / kLanes), min(others, left_here) + mean);
        left_here.store(of_row + first);
        for (int k = 0; k < stride(); k += kLanes) max(Ints::load(of_row + k), row_closes).store(of_row + k);
    }

  private:
    using Ints = typename Cells::Ints;
    using Floats = Vec<float, Cells::kLanes, Bytes>;
    static constexpr int kLanes = Cells::kLanes;
    static constexpr int kRowsAtOnce = TransportStartSpace::kRowsAtOnce;
    static constexpr int kMaxVectors = Vectors > 0 ? Vectors : Cells::padded(kMaxBinCount) / kLanes;
    // Rows and columns far from all others are served early. 1.2 leaves the fewest pivots (docs/notes/emd.md).
    static constexpr float kMeanWeight = 1.2F;
    // Added to -R_i and -K_j, so that no sum is negative: these are at most kMeanWeight times 2^27 + a tag.
    static constexpr std::int32_t kOffset = 1 << 28;
    // c_ij - R_i in closed rows and padding, and -K_j of closed columns: above all open cells (below 2^29 + 2^28), and
    // their sum is below 2^31.
    static constexpr std::int32_t kPadding = Cells::kPadding, kClosed = 3 << 28;
    static constexpr double kUsedUp[] = {0, 1};  // makes what is left of a used up row negative

    const Cells cells;
    const int row_groups;
    std::int32_t* const cell;
    TransportStartSpace& own;
    LeastOfColumns<Vectors, Bytes> least;  // of open rows; or less, of a row that was closed since
    int open_cols = cells.cols;
    int step = 0;

    // 1 if true, of which the compiler knows nothing: it would make branches, and half of them would be mispredicted.
    HORD_ALWAYS_INLINE static int flag(bool set) {
        int value = set ? 1 : 0;
        asm("" : "+r"(value));
        return value;
    }

    // Of a row of `cell`.
    HORD_ALWAYS_INLINE int stride() const { return Vectors > 0 ? Vectors * kLanes : cells.stride; }

    // The least of c_ij - R_i over all rows, of one vector of columns.
    HORD_ALWAYS_INLINE Ints least_of_rows(int first) const {
        const std::int32_t* from = cell + first;
        Ints a = Ints::broadcast(kPadding), b = a;
        for (int group = 0; group < row_groups; ++group, from += kRowsAtOnce * stride()) {
            a = min(min(a, Ints::load(from)), Ints::load(from + stride()));
            b = min(min(b, Ints::load(from + 2 * stride())), Ints::load(from + 3 * stride()));
        }
        return min(a, b);
    }

    HORD_ALWAYS_INLINE void find_means() {
        const double *const left_row = own.left_row.data(), *const left_col = own.left_col.data();
        float* const share_col = own.share_col.data();
        std::int32_t* const mean_col = own.mean_col.data();
        double total = 0;
        for (int i = 0; i < cells.rows; ++i) total += left_row[i];
        const double share = 1 / total;
        for (int j = 0; j < cells.cols; ++j) share_col[j] = static_cast<float>(left_col[j] * share) * kMeanWeight;
        for (int j = cells.cols; j < stride(); ++j) share_col[j] = 0;
        Floats mean[kMaxVectors];
        for (int k = 0; k < stride() / kLanes; ++k) mean[k] = Floats::broadcast(0);
        std::int32_t* to = cell;
        for (int i = 0; i < cells.rows; ++i, to += stride()) {
            const std::int32_t* const from = cells.row(i);
            const Floats weight = Floats::broadcast(static_cast<float>(left_row[i] * share) * kMeanWeight);
            Floats sum = Floats::broadcast(0);
            for (int k = 0; k < stride() / kLanes; ++k) {
                const Floats c = Ints::load(from + k * kLanes).template convert<float>();
                sum = sum + c * Floats::load(share_col + k * kLanes);
                mean[k] = mean[k] + c * weight;
            }
            const Ints of_row = Ints::broadcast(kOffset - (static_cast<std::int32_t>(sum.reduce_sum()) & ~cells.tags));
            for (int j = 0; j < cells.stride; j += kLanes) (Ints::load(from + j) + of_row).store(to + j);
            for (int j = cells.stride; j < stride(); j += kLanes) Ints::broadcast(kPadding).store(to + j);
        }
        for (; to < cell + row_groups * kRowsAtOnce * stride(); to += kLanes) Ints::broadcast(kPadding).store(to);
        for (int k = 0; k < stride() / kLanes; ++k) {
            (Ints::broadcast(kOffset) - (mean[k].template convert<std::int32_t>() & Ints::broadcast(~cells.tags)))
                .store(mean_col + k * kLanes);
        }
        for (int j = cells.cols; j < stride(); ++j) mean_col[j] = 0;
    }
};

}  // namespace hord::algo
