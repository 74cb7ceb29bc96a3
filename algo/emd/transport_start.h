// The initial plan of the transportation simplex. For transport_simplex.cpp only.
//
// Repeatedly serves the open cell with the least c_ij - R_i - K_j until its row or column is used up, which closes it.
// R_i and K_j are the mass-weighted mean costs of a row and a column: floats, summed in a fixed order, rounded to the
// bits above the tags.
#pragma once

#include <cstddef>
#include <cstdint>

#include "algo/emd/transport_cells.h"
#include "algo/emd/transport_simplex.h"
#include "algo/simd/aligned.h"

namespace hord::algo {

// Memory for problems of at most `side` rows and columns, padding included.
struct TransportStartSpace {
    explicit TransportStartSpace(std::size_t side) {
        for (auto* values : {&mean_row, &mean_col, &best_of_col, &open_rows, &place_of_row})
            values->resize(side + TransportCosts::kLanes);
        for (auto* values : {&share_col, &rough_mean_col}) values->resize(side);
        for (auto* values : {&left_row, &left_col}) values->resize(side);
        steps.resize(2 * side);
    }
    AlignedVector<TransportStep> steps;
    AlignedVector<std::int32_t> mean_row, mean_col;  // negated, without tags
    AlignedVector<std::int32_t> best_of_col;
    AlignedVector<std::int32_t> open_rows;     // offsets of their cells, in any order; their means in mean_row
    AlignedVector<std::int32_t> place_of_row;  // index in open_rows; -1: the row is closed
    AlignedVector<float> share_col, rough_mean_col;
    AlignedVector<double> left_row, left_col;  // masses
};

// The best cell of each column, in registers for low latency: every step depends on the one before.
template <int Vectors, int Bytes>
struct BestOfColumns {
    using Cells = TransportCells<Bytes>;
    using Ints = typename Cells::Ints;
    Ints of[Vectors];

    HORD_ALWAYS_INLINE BestOfColumns(std::int32_t*, int) {}
    HORD_ALWAYS_INLINE std::int32_t least_cell() const {
        Ints least = of[0];
        for (int k = 1; k < Vectors; ++k) least = min(least, of[k]);
        return least.reduce_min();
    }
    HORD_ALWAYS_INLINE void close(int column) {
        const Ints it = Ints::broadcast(column);
        for (int k = 0; k < Vectors; ++k)
            of[k] = select((Ints::iota() + Ints::broadcast(k * Cells::kLanes)).equal_to(it),
                           Ints::broadcast(Cells::kNoCell), of[k]);
    }
    HORD_ALWAYS_INLINE void put(int vector, const Ints& now) {
        const Ints it = Ints::broadcast(vector);
        for (int k = 0; k < Vectors; ++k) of[k] = select(Ints::broadcast(k).equal_to(it), now, of[k]);
    }
};

// The same in memory, for more columns than registers hold.
template <int Bytes>
struct BestOfColumns<0, Bytes> {
    using Cells = TransportCells<Bytes>;
    using Ints = typename Cells::Ints;
    std::int32_t* of;
    int stride;

    HORD_ALWAYS_INLINE BestOfColumns(std::int32_t* best, int columns) : of(best), stride(columns) {}
    HORD_ALWAYS_INLINE std::int32_t least_cell() const {
        Ints least = Ints::load(of);
        for (int j = Cells::kLanes; j < stride; j += Cells::kLanes) least = min(least, Ints::load(of + j));
        return least.reduce_min();
    }
    HORD_ALWAYS_INLINE void close(int column) {
        // A vector store, because the value is loaded as a vector next (store forwarding).
        const int vector = column / Cells::kLanes;
        const Ints it = Ints::iota().equal_to(Ints::broadcast(column % Cells::kLanes));
        put(vector, select(it, Ints::broadcast(Cells::kNoCell), Ints::load(of + vector * Cells::kLanes)));
    }
    HORD_ALWAYS_INLINE void put(int vector, const Ints& now) { now.store(of + vector * Cells::kLanes); }
};

template <int Bytes>
struct TransportStart {
    using Cells = TransportCells<Bytes>;
    using Ints = typename Cells::Ints;
    using Floats = Vec<float, Cells::kLanes, Bytes>;
    static constexpr int kLanes = Cells::kLanes;

    const Cells cells;
    TransportStartSpace& space;
    int open_rows = cells.rows;
    int open_cols = cells.cols;

    HORD_ALWAYS_INLINE void find_means(const double* supply, const double* demand) {
        double total = 0;
        for (int i = 0; i < cells.rows; ++i) total += supply[i];
        const double share = 1 / total;
        float* const share_col = space.share_col.data();
        float* const mean_col = space.rough_mean_col.data();
        for (int j = 0; j < cells.cols; ++j) share_col[j] = static_cast<float>(demand[j] * share);
        for (int j = cells.cols; j < cells.stride; ++j) share_col[j] = 0;
        for (int j = 0; j < cells.stride; j += kLanes) Floats::broadcast(0).store(mean_col + j);
        for (int i = 0; i < cells.rows; ++i) {
            const Floats weight = Floats::broadcast(static_cast<float>(supply[i] * share));
            const std::int32_t* of_row = cells.row(i);
            Floats sum = Floats::broadcast(0);
            for (int j = 0; j < cells.stride; j += kLanes) {
                const Floats c = Ints::load(of_row + j).template convert<float>();
                sum = sum + c * Floats::load(share_col + j);
                (Floats::load(mean_col + j) + c * weight).store(mean_col + j);
            }
            space.mean_row.data()[i] = -(static_cast<std::int32_t>(sum.reduce_sum()) & ~cells.tags);
        }
        std::int32_t* const negative = space.mean_col.data();
        for (int j = 0; j < cells.stride; j += kLanes) {
            (Ints::broadcast(0) -
             (Floats::load(mean_col + j).template convert<std::int32_t>() & Ints::broadcast(~cells.tags)))
                .store(negative + j);
        }
        for (int j = cells.cols; j < cells.stride; ++j) negative[j] = 0;
    }

    // The best cells of some columns among the open rows.
    template <int Vectors>
    HORD_ALWAYS_INLINE void best_of_columns(int first, Ints (&best)[Vectors]) const {
        const std::int32_t* const row = space.open_rows.data();
        Cells::template least_of_columns<Vectors>(
            open_rows, [&](int k) __attribute__((always_inline)) { return cells.cell + row[k] + first; },
            space.mean_row.data(), best);
        for (int k = 0; k < Vectors; ++k) best[k] = best[k] + Ints::load(space.mean_col.data() + first + k * kLanes);
    }
    template <class Best>
    HORD_ALWAYS_INLINE void renew(Best& best, int column) const {
        Ints now[1];
        best_of_columns<1>(column / kLanes * kLanes, now);
        best.put(column / kLanes, now[0]);
    }

    // Removes a row from open_rows; the last one takes its place.
    HORD_ALWAYS_INLINE void close_row(int row, int place) {
        std::int32_t* const at = space.open_rows.data();
        std::int32_t* const mean = space.mean_row.data();
        --open_rows;
        space.place_of_row[static_cast<std::size_t>(cells.row_of(cells.cell[at[open_rows]]))] = place;
        at[place] = at[open_rows];
        mean[place] = mean[open_rows];
        space.place_of_row[static_cast<std::size_t>(row)] = -1;
    }

    template <int Vectors>
    HORD_ALWAYS_INLINE void serve() {
        double* const left_row = space.left_row.data();
        double* const left_col = space.left_col.data();
        TransportStep* const steps = space.steps.data();
        BestOfColumns<Vectors, Bytes> best(space.best_of_col.data(), cells.stride);
        if constexpr (Vectors > 0) {
            best_of_columns<Vectors>(0, best.of);
        } else {
            cells.for_columns([&](int first, auto vectors) __attribute__((always_inline)) {
                Ints now[vectors];
                best_of_columns<vectors>(first, now);
                for (int k = 0; k < vectors; ++k) best.put(first / kLanes + k, now[k]);
            });
        }
        const int last = cells.rows + cells.cols - 2;
        for (int step = 0;;) {
            const std::int32_t least = best.least_cell();
            const int i = cells.row_of(least), j = cells.col_of(least);
            const int place = space.place_of_row.data()[i];
            if (place < 0) {  // its row is closed: the current best of the column is not lower
                renew(best, j);
                continue;
            }
            const double in_row = left_row[i], in_col = left_col[j];
            const double flow = min(in_row, in_col);  // the last column takes the rest of all rows
            left_row[i] = in_row - flow;
            left_col[j] = in_col - flow;
            const bool row_used_up = in_row < in_col || open_cols == 1;
            steps[step] = {flow, static_cast<std::int16_t>(i), static_cast<std::int16_t>(j), row_used_up};
            if (step++ == last) return;
            if (row_used_up) {
                close_row(i, place);
                renew(best, j);
            } else {
                --open_cols;
                space.mean_col.data()[j] = Cells::kPadding / 2;
                best.close(j);
            }
        }
    }

    // Returns rows + cols - 1 steps; the last one uses up the last row. Masses are positive integers < 2^53; both sides
    // have the same sum.
    HORD_ALWAYS_INLINE const TransportStep* find(const double* supply, const double* demand) {
        find_means(supply, demand);
        for (int i = 0; i < cells.rows; ++i) space.open_rows.data()[i] = i * cells.stride;
        for (int i = 0; i < cells.rows; ++i) space.place_of_row.data()[i] = i;
        for (int i = 0; i < cells.rows; ++i) space.left_row.data()[i] = supply[i];
        for (int j = 0; j < cells.cols; ++j) space.left_col.data()[j] = demand[j];
        // No case for one vector: problems of up to eight columns come with a plan (algo/emd/transport_batch.h).
        switch (cells.stride / kLanes) {
            case 2: serve<2>(); break;
            case 3: serve<3>(); break;
            case 4: serve<4>(); break;
            case 5: serve<5>(); break;
            case 6: serve<6>(); break;
            default: serve<0>();
        }
        return space.steps.data();
    }
};

}  // namespace hord::algo
