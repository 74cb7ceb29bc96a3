#include "algo/emd/transport_lanes.h"

#include <bit>
#include <limits>

#include "algo/emd/transport_cells.h"
#include "algo/simd/vec.h"

namespace hord::algo {
namespace {

constexpr int kMaxPivotsPerNode = 8;  // the simplex has more patience
constexpr int kNodes = 2 * kMaxBatchSide;
static_assert(kMaxBatchSteps <= 31);  // a set of arcs is one positive number

using Lane = std::int32_t[kBatchLanes];

// One batch while it is solved. Always inlined: compiled for the instruction set of the caller.
template <int Bytes, class Mass>
struct Lanes {
    using Ints = Vec<std::int32_t, kBatchLanes, Bytes>;  // also sets of arcs, as bits
    using Longs = Vec<std::int64_t, kBatchLanes, Bytes>;
    using Doubles = Vec<double, kBatchLanes, Bytes>;
    using Masses = Vec<Mass, kBatchLanes, Bytes>;
    static constexpr bool kSmallMasses = sizeof(Mass) == sizeof(std::int32_t);

    const TransportAnswer<Mass>& from;
    const int rows, cols, arcs;
    const int col_bits;                        // of a tag (algo/emd/transport_cells.h)
    const std::int32_t tags;                   // mask of a tag
    Lane cell[kMaxBatchSide * kMaxBatchSide];  // costs with tags, row by row
    Lane path[kNodes];                         // arcs on the way to the root. Nodes: rows from 0, columns after them
    Lane dual[kNodes];                         // a tree arc costs minus the sum of its two duals
    double exact_dual[kNodes][kBatchLanes];
    Lane arc[kMaxBatchSteps];  // its cell, as in transport_batch.h
    Mass flow[kMaxBatchSteps][kBatchLanes];
    Ints row_is_below;  // arcs whose child is the row; else the column

    HORD_ALWAYS_INLINE Lanes(const TransportAnswer<Mass>& answer, int row_count, int col_count,
                             const TransportCells<16>& cells)
        : from(answer), rows(row_count), cols(col_count), arcs(rows + cols - 1), col_bits(cells.col_bits),
          tags(cells.tags) {}

    [[nodiscard]] HORD_ALWAYS_INLINE int column(int j) const { return rows + j; }
    HORD_ALWAYS_INLINE static Ints all() { return Ints::broadcast(-1); }
    HORD_ALWAYS_INLINE static Ints none() { return Ints::broadcast(0); }
    HORD_ALWAYS_INLINE static Ints negated(const Ints& mask) { return mask ^ all(); }
    HORD_ALWAYS_INLINE static Ints lacks(const Ints& set, int a) {
        return (set & Ints::broadcast(1 << a)).equal_to(none());
    }
    HORD_ALWAYS_INLINE static Ints has(const Ints& set, int a) { return negated(lacks(set, a)); }
    // Offsets of elements from lane 0 of the first one.
    HORD_ALWAYS_INLINE static void place(const Ints& of, std::uint32_t* offset) {
        static_assert(kBatchLanes == 1 << 4);
        ((of << 4) + Ints::iota()).template bit_cast<std::uint32_t>().store(offset);
    }

    HORD_ALWAYS_INLINE void find_costs(double scale) {
        const Ints half = Ints::broadcast(tags / 2 + 1), no_tag = Ints::broadcast(~tags);
        for (int i = 0; i < rows; ++i) {
            for (int j = 0; j < cols; ++j) {
                double exact[kBatchLanes];
                Lane rough;
                (Doubles::load(from.cell_cost[i * kFirstColumnNode + j]) * scale).store(exact);
                for (int l = 0; l < kBatchLanes; ++l) rough[l] = static_cast<std::int32_t>(exact[l]);
                (((Ints::load(rough) + half) & no_tag) + Ints::broadcast((i << col_bits) + j))
                    .store(cell[i * cols + j]);
            }
        }
    }

    // The tree of the plan, from its root.
    HORD_ALWAYS_INLINE void build_tree() {
        const auto node = [&](const std::int32_t* of) __attribute__((always_inline)) {
            const Ints n = Ints::load(of), is_column = n.greater_than(Ints::broadcast(kFirstColumnNode - 1));
            return n - (is_column & Ints::broadcast(kFirstColumnNode - rows));
        };
        for (int i = 0; i < rows; ++i) Doubles::load(from.dual[i]).store(exact_dual[i]);
        for (int j = 0; j < cols; ++j) Doubles::load(from.dual[kFirstColumnNode + j]).store(exact_dual[column(j)]);
        std::int32_t *const paths = path[0], *const duals = dual[0];
        const std::int32_t* const costs = cell[0];
        row_is_below = none();
        for (int a = arcs - 1; a >= 0; --a) {
            const Ints child = node(from.child[a]), parent = node(from.parent[a]);
            const Ints row = min(child, parent), col = max(child, parent) - Ints::broadcast(rows);
            (row * kFirstColumnNode + col).store(arc[a]);
            row_is_below = row_is_below | (Ints::broadcast(rows).greater_than(child) & Ints::broadcast(1 << a));
            std::uint32_t to[kBatchLanes], by[kBatchLanes], at[kBatchLanes];
            place(child, to);
            place(parent, by);
            place(row * cols + col, at);
            if (a == arcs - 1) {
                for (int l = 0; l < kBatchLanes; ++l) paths[by[l]] = duals[by[l]] = 0;
            }
            // No sum overflows: of at most 23 arcs a path has 12 of either sign, a cost is at most 2^27 + half a tag.
            for (int l = 0; l < kBatchLanes; ++l) {
                paths[to[l]] = paths[by[l]] | 1 << a;
                duals[to[l]] = -((costs[at[l]] & ~tags) + duals[by[l]]);
            }
            Masses::load(from.flow[a]).store(flow[a]);
        }
    }

    [[nodiscard]] HORD_ALWAYS_INLINE Ints largest_dual() const {
        Ints largest = none();
        for (int x = 0; x < rows + cols; ++x) {
            const Ints d = Ints::load(dual[x]);
            largest = max(largest, max(d, none() - d));
        }
        return largest;
    }

    // The least integer reduced cost, with the tag of its cell.
    [[nodiscard]] HORD_ALWAYS_INLINE Ints price() const {
        Ints least = Ints::broadcast(TransportCosts::kNoCell);
        for (int i = 0; i < rows; ++i) {
            const Ints of_row = Ints::load(dual[i]);
            for (int j = 0; j < cols; ++j)
                least = min(least, Ints::load(cell[i * cols + j]) + of_row + Ints::load(dual[column(j)]));
        }
        return least;
    }

    // Masks for masses.
    HORD_ALWAYS_INLINE static Longs widened(const Ints& mask) {
        Lane each;
        mask.store(each);
        return Longs::load_converted(each);
    }
    HORD_ALWAYS_INLINE static Masses where(const Ints& mask, const Masses& value) {  // else 0
        if constexpr (kSmallMasses) {
            return mask & value;
        } else {
            return (widened(mask) & value.template bit_cast<std::int64_t>()).template bit_cast<double>();
        }
    }
    HORD_ALWAYS_INLINE static Masses choose(const Ints& mask, const Masses& yes, const Masses& no) {
        if constexpr (kSmallMasses) {
            return select(mask, yes, no);
        } else {
            return select(widened(mask), yes.template bit_cast<std::int64_t>(), no.template bit_cast<std::int64_t>())
                .template bit_cast<double>();
        }
    }
    HORD_ALWAYS_INLINE static Ints equal(const Masses& a, const Masses& b) {
        if constexpr (kSmallMasses) {
            return a.equal_to(b);
        } else {
            double of_a[kBatchLanes], of_b[kBatchLanes];
            Lane same;
            a.store(of_a);
            b.store(of_b);
            for (int l = 0; l < kBatchLanes; ++l) same[l] = of_a[l] == of_b[l] ? -1 : 0;
            return Ints::load(same);
        }
    }

    // The rule of TransportTree::last_blocking() for several blocking arcs: on the side of the column the one nearest
    // to the apex, which all paths with any of them have; else on the side of the row the one farthest from it, which
    // only paths with all of them have.
    [[nodiscard]] HORD_ALWAYS_INLINE Ints last_blocking(const Ints& on_row_side, const Ints& on_column_side) const {
        Ints nearest = on_column_side, farthest = on_row_side;
        for (int x = 0; x < rows + cols; ++x) {
            const Ints its_path = Ints::load(path[x]);
            const Ints has_none = (its_path & on_column_side).equal_to(none()),
                       has_all = (its_path & on_row_side).equal_to(on_row_side);
            nearest = nearest & (its_path | has_none);
            farthest = farthest & (negated(its_path) | has_all);
        }
        return select(on_column_side.equal_to(none()), farthest, nearest);
    }

    // One pivot in each active lane (TransportTree::pivot()). `best`: of price().
    HORD_ALWAYS_INLINE void pivot(const Ints& best, const Ints& active) {
        const Ints entering = best & Ints::broadcast(tags) & active, reduced = best & Ints::broadcast(~tags) & active;
        const Ints row = entering >> col_bits, col = entering & Ints::broadcast((1 << col_bits) - 1);
        const Ints enters = row * kFirstColumnNode + col;
        Lane from_row, from_col;
        double exact[kBatchLanes];  // reduced cost
        {
            std::uint32_t of_row[kBatchLanes], of_col[kBatchLanes], of_cell[kBatchLanes];
            place(row, of_row);
            place(col + Ints::broadcast(rows), of_col);
            place(enters, of_cell);
            const std::int32_t* const paths = path[0];
            const double *const duals = exact_dual[0], *const costs = from.cell_cost[0];
            for (int l = 0; l < kBatchLanes; ++l) from_row[l] = paths[of_row[l]];
            for (int l = 0; l < kBatchLanes; ++l) from_col[l] = paths[of_col[l]];
            for (int l = 0; l < kBatchLanes; ++l) exact[l] = costs[of_cell[l]] - duals[of_row[l]] - duals[of_col[l]];
        }
        const Ints cycle = (Ints::load(from_row) ^ Ints::load(from_col)) & active;
        const Ints row_part = Ints::load(from_row) & cycle, column_part = Ints::load(from_col) & cycle;
        const Ints decreasing = (row_part & row_is_below) | (column_part & negated(row_is_below));
        const Ints increasing = cycle & negated(decreasing);

        const Masses most = Masses::broadcast(std::numeric_limits<Mass>::max());
        Masses least = most;
        for (int a = 0; a < arcs; ++a) least = min(least, choose(lacks(decreasing, a), most, Masses::load(flow[a])));
        Ints leaves = none();
        for (int a = 0; a < arcs; ++a) {
            const Ints blocks = equal(Masses::load(flow[a]), least) & has(decreasing, a);
            leaves = leaves | (blocks & Ints::broadcast(1 << a));
        }
        const Ints tied = negated((leaves & (leaves - Ints::broadcast(1))).equal_to(none()));
        if (tied.reduce_or() != 0) [[unlikely]]
            leaves = select(tied, last_blocking(leaves & row_part, leaves & column_part), leaves);
        least = where(active, least);
        for (int a = 0; a < arcs; ++a) {
            const Ints left = has(leaves, a);
            const Masses changed =
                Masses::load(flow[a]) + where(has(increasing, a), least) - where(has(decreasing, a), least);
            choose(left, least, changed).store(flow[a]);
            select(left, enters, Ints::load(arc[a])).store(arc[a]);
        }

        // The nodes below the leaving arc: their paths change by the cycle, their duals by the reduced cost. `top`: the
        // path of the highest of them, which all others contain.
        const Ints with_column = (leaves & row_part).equal_to(none());
        const Ints of_rows = select(with_column, reduced, none() - reduced), of_cols = none() - of_rows;
        const Longs sign = Longs::broadcast(std::numeric_limits<std::int64_t>::min());
        const Longs exact_cols =
                        Doubles::load(exact).template bit_cast<std::int64_t>() ^ (sign & widened(negated(with_column))),
                    exact_rows = exact_cols ^ sign;
        const Ints change = cycle & negated(leaves);
        Ints top = all();
        const auto move = [&](int x, const Ints& step, const Longs& exact_step) __attribute__((always_inline)) {
            const Ints its_path = Ints::load(path[x]), stays = (its_path & leaves).equal_to(none()),
                       moves = negated(stays);
            top = top & (its_path | stays);
            (its_path ^ (moves & change)).store(path[x]);
            (Ints::load(dual[x]) + (moves & step)).store(dual[x]);
            (Doubles::load(exact_dual[x]) + (widened(moves) & exact_step).template bit_cast<double>())
                .store(exact_dual[x]);
        };
        for (int i = 0; i < rows; ++i) move(i, of_rows, exact_rows);
        for (int j = 0; j < cols; ++j) move(column(j), of_cols, exact_cols);
        // Arcs between the entering and the leaving one change direction.
        const Ints turned = select(with_column, column_part, row_part) & negated(top);
        row_is_below = ((row_is_below ^ turned) & negated(leaves)) | (negated(with_column) & leaves);
    }

    HORD_ALWAYS_INLINE void solve(std::uint32_t lanes, double scale, double tolerance, LaneOutcome& outcome) {
        find_costs(scale);
        build_tree();
        Lane mask;
        for (int l = 0; l < kBatchLanes; ++l) mask[l] = -static_cast<std::int32_t>(lanes >> l & 1U);
        Ints in_use = Ints::load(mask), bound = largest_dual(), pivots = none();
        const Ints largest = Ints::broadcast(TransportCosts::kMaxDual),
                   most = Ints::broadcast(kMaxPivotsPerNode * (rows + cols));
        for (;;) {
            if ((bound.greater_than(largest) & in_use).reduce_or() != 0) [[unlikely]] {
                bound = largest_dual();
                in_use = in_use & negated(bound.greater_than(largest));
            }
            const Ints best = price(), active = none().greater_than(best) & in_use;
            if (active.reduce_or() == 0) break;
            pivot(best, active);
            bound = bound - (best & Ints::broadcast(~tags) & active);
            pivots = pivots - active;
            in_use = in_use & most.greater_than(pivots);
        }
        pivots.store(outcome.pivots);
        in_use.store(mask);
        double least[kBatchLanes], sum[kBatchLanes] = {};
        least_exact().store(least);
        outcome.solved = 0;
        for (int l = 0; l < kBatchLanes; ++l)
            outcome.solved |= (mask[l] != 0 && least[l] >= -tolerance / 2 ? 1U : 0U) << l;
        for (int a = 0; a < arcs; ++a) {
            std::uint32_t at[kBatchLanes];
            place(Ints::load(arc[a]), at);
            const double* const costs = from.cell_cost[0];
            for (int l = 0; l < kBatchLanes; ++l) sum[l] += static_cast<double>(flow[a][l]) * costs[at[l]];
        }
        for (int l = 0; l < kBatchLanes; ++l) outcome.cost[l] = sum[l];
    }

    // The least reduced cost in double precision.
    [[nodiscard]] HORD_ALWAYS_INLINE Doubles least_exact() const {
        Doubles least = Doubles::broadcast(0);
        for (int i = 0; i < rows; ++i) {
            const Doubles of_row = Doubles::load(exact_dual[i]);
            for (int j = 0; j < cols; ++j) {
                least = min(least,
                            Doubles::load(from.cell_cost[i * kFirstColumnNode + j]) - of_row -
                                Doubles::load(exact_dual[column(j)]));
            }
        }
        return least;
    }
};

template <int Bytes, class Mass>
HORD_ALWAYS_INLINE void solve(const TransportAnswer<Mass>& answer, int rows, int cols, std::uint32_t lanes,
                              double scale, double tolerance, LaneOutcome& outcome) {
    Lanes<Bytes, Mass>(answer, rows, cols, TransportCells<16>(rows, cols, nullptr))
        .solve(lanes, scale, tolerance, outcome);
}
HORD_FOR_EACH_ISA(int32_kernel, solve, std::int32_t)
HORD_FOR_EACH_ISA(double_kernel, solve, double)

}  // namespace

template <>
PivotLanes<std::int32_t> lanes_kernel(Isa isa) {
    return int32_kernel(isa);
}
template <>
PivotLanes<double> lanes_kernel(Isa isa) {
    return double_kernel(isa);
}

}  // namespace hord::algo
