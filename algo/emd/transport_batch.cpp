#include "algo/emd/transport_batch.h"

#include <bit>
#include <limits>

#include "algo/simd/vec.h"

namespace hord::algo {
namespace {

constexpr int kCells = kMaxBatchCells;
constexpr std::int32_t kCellBits = 0xFF;
static_assert(kCells <= kCellBits + 1);
constexpr float kClosed = std::numeric_limits<float>::infinity();

// One batch while it is solved. Always inlined: compiled for the instruction set of the caller.
template <int Bytes, class Mass>
struct Batch {
    using Floats = Vec<float, kBatchLanes, Bytes>;
    using Ints = Vec<std::int32_t, kBatchLanes, Bytes>;
    using Doubles = Vec<double, kBatchLanes, Bytes>;

    const TransportBatch<Mass>& b;
    const TransportBatchCosts& costs;
    TransportAnswer<Mass>& answer;
    const int rows;
    const int cols;
    Mass mass[kBatchNodes][kBatchLanes];
    double cost[kCells][kBatchLanes];
    float key[kCells][kBatchLanes];
    double dual[kBatchNodes][kBatchLanes];

    HORD_ALWAYS_INLINE Batch(const TransportBatch<Mass>& batch, const TransportBatchCosts& c,
                             TransportAnswer<Mass>& out)
        : b(batch), costs(c), answer(out), rows(batch.rows), cols(batch.cols) {}

    HORD_ALWAYS_INLINE static int cell(int row, int col) { return row * kFirstColumnNode + col; }
    HORD_ALWAYS_INLINE static int column(int j) { return kFirstColumnNode + j; }

    HORD_ALWAYS_INLINE void gather() {
        std::int32_t bin[kBatchNodes][kBatchLanes];  // for rows: the offset of their costs
        const auto transpose = [&](int node, int side, int k, std::int32_t times) __attribute__((always_inline)) {
            for (int l = 0; l < kBatchLanes; ++l) mass[node][l] = b.problem[l].mass[side][k];
            for (int l = 0; l < kBatchLanes; ++l) bin[node][l] = b.problem[l].bin[side][k] * times;
        };
        for (int i = 0; i < rows; ++i) transpose(i, 0, i, costs.bins);
        for (int j = 0; j < cols; ++j) transpose(column(j), 1, j, 1);
        for (int i = 0; i < rows; ++i) {
            const Ints begin = Ints::load(bin[i]);
            for (int j = 0; j < cols; ++j) {
                std::uint32_t place[kBatchLanes];
                (begin + Ints::load(bin[column(j)])).template bit_cast<std::uint32_t>().store(place);
                double* const c = cost[cell(i, j)];
                for (int l = 0; l < kBatchLanes; ++l) c[l] = costs.table[place[l]];
            }
        }
    }

    HORD_ALWAYS_INLINE Doubles masses(int node) const {
        double exact[kBatchLanes];
        for (int l = 0; l < kBatchLanes; ++l) exact[l] = static_cast<double>(mass[node][l]);
        return Doubles::load(exact);
    }

    HORD_ALWAYS_INLINE void set_key(int cell, Floats order) {
        const Ints bits =
            (order.template bit_cast<std::int32_t>() & Ints::broadcast(~kCellBits)) | Ints::broadcast(cell);
        bits.template bit_cast<float>().store(key[cell]);
    }

    HORD_ALWAYS_INLINE void from_one() {
        double sum[kBatchLanes] = {};
        for (int j = 0; j < cols; ++j) {
            for (int l = 0; l < kBatchLanes; ++l)
                sum[l] += static_cast<double>(mass[column(j)][l]) * cost[cell(0, j)][l];
        }
        for (int l = 0; l < kBatchLanes; ++l) answer.cost[l] = sum[l];
        for (int l = 0; l < kBatchLanes; ++l) answer.proven[l] = true;
    }

    // Of two columns the one with the lower key comes first: its mass is added to `before` of the other.
    HORD_ALWAYS_INLINE static void add_before(const float* key_a, const float* key_b, const Mass* mass_a,
                                              const Mass* mass_b, Mass* before_a, Mass* before_b) {
        std::int32_t a_first[kBatchLanes];
        Floats::load(key_a).less_than(Floats::load(key_b)).store(a_first);
        if constexpr (sizeof(Mass) == sizeof(std::int32_t)) {
            const Ints first = Ints::load(a_first);
            (Ints::load(before_b) + (first & Ints::load(mass_a))).store(before_b);
            (Ints::load(before_a) + select(first, Ints::broadcast(0), Ints::load(mass_b))).store(before_a);
        } else {
            for (int l = 0; l < kBatchLanes; ++l) before_b[l] += a_first[l] != 0 ? mass_a[l] : Mass{0};
            for (int l = 0; l < kBatchLanes; ++l) before_a[l] += a_first[l] != 0 ? Mass{0} : mass_b[l];
        }
    }

    // Two rows. Float keys order the columns. The plan is proven if no column served by the first row gains less from
    // it than one served by the second row.
    HORD_ALWAYS_INLINE void knapsack() {
        for (int j = 0; j < cols; ++j) {
            float gain[kBatchLanes];
            for (int l = 0; l < kBatchLanes; ++l)
                gain[l] = static_cast<float>(cost[cell(0, j)][l] - cost[cell(1, j)][l]);
            set_key(j, Floats::load(gain));
        }
        // `before`: mass of the columns with lower keys. Keys are unique.
        Mass before[kMaxBatchSide][kBatchLanes] = {}, taken[kMaxBatchSide][kBatchLanes];
        for (int j = 0; j < cols; ++j) {
            for (int k = 0; k < j; ++k)
                add_before(key[j], key[k], mass[column(j)], mass[column(k)], before[j], before[k]);
        }
        for (int j = 0; j < cols; ++j) {
            for (int l = 0; l < kBatchLanes; ++l)
                taken[j][l] = min(max(mass[0][l] - before[j][l], Mass{0}), mass[column(j)][l]);
        }
        double sum[kBatchLanes] = {};
        double most_served[kBatchLanes], least_left[kBatchLanes];  // cost from the first row minus cost from the second
        for (int l = 0; l < kBatchLanes; ++l) most_served[l] = -std::numeric_limits<double>::infinity();
        for (int l = 0; l < kBatchLanes; ++l) least_left[l] = std::numeric_limits<double>::infinity();
        for (int j = 0; j < cols; ++j) {
            for (int l = 0; l < kBatchLanes; ++l) {
                const double by_first = cost[cell(0, j)][l] - cost[cell(1, j)][l];
                const bool serves = taken[j][l] > 0, leaves = taken[j][l] < mass[column(j)][l];
                most_served[l] = serves && most_served[l] < by_first ? by_first : most_served[l];
                least_left[l] = leaves && by_first < least_left[l] ? by_first : least_left[l];
            }
            for (int l = 0; l < kBatchLanes; ++l) {
                sum[l] += static_cast<double>(taken[j][l]) * cost[cell(0, j)][l] +
                    static_cast<double>(mass[column(j)][l] - taken[j][l]) * cost[cell(1, j)][l];
            }
        }
        for (int l = 0; l < kBatchLanes; ++l) answer.cost[l] = sum[l];
        for (int l = 0; l < kBatchLanes; ++l) answer.proven[l] = most_served[l] - least_left[l] <= costs.tolerance;
    }

    // Keys: c_ij - R_i - K_j, with the mass-weighted mean costs R_i of rows and K_j of columns.
    HORD_ALWAYS_INLINE void order_cells() {
        float share[kBatchNodes][kBatchLanes];
        float mean[kBatchNodes][kBatchLanes];
        double total[kBatchLanes] = {};
        for (int i = 0; i < rows; ++i) {
            for (int l = 0; l < kBatchLanes; ++l) total[l] += static_cast<double>(mass[i][l]);
        }
        for (int l = 0; l < kBatchLanes; ++l) total[l] = 1 / total[l];
        const auto prepare = [&](int node) __attribute__((always_inline)) {
            double exact[kBatchLanes];
            (masses(node) * Doubles::load(total)).store(exact);
            for (int l = 0; l < kBatchLanes; ++l) share[node][l] = static_cast<float>(exact[l]);
            Floats::broadcast(0).store(mean[node]);
        };
        for (int i = 0; i < rows; ++i) prepare(i);
        for (int j = 0; j < cols; ++j) prepare(column(j));
        for (int i = 0; i < rows; ++i) {
            Floats mean_row = Floats::broadcast(0);
            const Floats share_row = Floats::load(share[i]);
            for (int j = 0; j < cols; ++j) {
                float rough[kBatchLanes];
                for (int l = 0; l < kBatchLanes; ++l) rough[l] = static_cast<float>(cost[cell(i, j)][l]);
                const Floats c = Floats::load(rough);
                c.store(key[cell(i, j)]);
                mean_row = mean_row + c * Floats::load(share[column(j)]);
                (Floats::load(mean[column(j)]) + c * share_row).store(mean[column(j)]);
            }
            mean_row.store(mean[i]);
        }
        for (int i = 0; i < rows; ++i) {
            const Floats mean_row = Floats::load(mean[i]);
            for (int j = 0; j < cols; ++j)
                set_key(cell(i, j), Floats::load(key[cell(i, j)]) - mean_row - Floats::load(mean[column(j)]));
        }
    }

    // Per lane the cell with the least key whose row and column are open.
    HORD_ALWAYS_INLINE Ints best_cells(const float (*closed)[kBatchLanes]) const {
        Floats in_all = Floats::broadcast(kClosed);
        for (int i = 0; i < rows; ++i) {
            Floats in_row = Floats::broadcast(kClosed);
            for (int j = 0; j < cols; ++j)
                in_row = min(in_row, Floats::load(key[cell(i, j)]) + Floats::load(closed[column(j)]));
            in_all = min(in_all, in_row + Floats::load(closed[i]));
        }
        return in_all.template bit_cast<std::int32_t>() & Ints::broadcast(kCellBits);
    }

    // The plan: every step uses up one row or one column (if tied, the column, unless it is the last).
    HORD_ALWAYS_INLINE void serve(std::int32_t (*served)[kBatchLanes]) {
        float closed[kBatchNodes][kBatchLanes];  // 0, or kClosed once it is used up
        Mass left[kBatchNodes][kBatchLanes];
        const auto open = [&](int node) __attribute__((always_inline)) {
            Floats::broadcast(0).store(closed[node]);
            for (int l = 0; l < kBatchLanes; ++l) left[node][l] = mass[node][l];
        };
        for (int i = 0; i < rows; ++i) open(i);
        for (int j = 0; j < cols; ++j) open(column(j));
        std::int32_t open_cols[kBatchLanes];
        Ints::broadcast(cols).store(open_cols);
        const int steps = rows + cols - 1;
        for (int step = 0; step < steps; ++step) {
            best_cells(closed).store(served[step]);
            if constexpr (sizeof(Mass) == sizeof(std::int32_t)) {
                serve_lanes(step, Ints::load(served[step]), left, closed, open_cols);
            } else {
                for (int l = 0; l < kBatchLanes; ++l) {
                    // Branch-free: branches would be unpredictable.
                    const std::int32_t row = served[step][l] / kFirstColumnNode;
                    const std::int32_t col = column(served[step][l] % kFirstColumnNode);
                    const Mass in_row = left[row][l], in_col = left[col][l];
                    const Mass moved = min(in_row, in_col);
                    const std::int32_t row_closes = -((in_row < in_col ? 1 : 0) | (open_cols[l] == 1 ? 1 : 0));
                    const std::int32_t swap = (row ^ col) & row_closes;
                    open_cols[l] -= 1 + row_closes;
                    left[row][l] = in_row - moved;
                    left[col][l] = in_col - moved;
                    answer.flow[step][l] = moved;
                    answer.child[step][l] = col ^ swap;
                    answer.parent[step][l] = row ^ swap;
                    closed[col ^ swap][l] = kClosed;
                }
            }
        }
    }

    HORD_ALWAYS_INLINE void serve_lanes(int step, Ints cells, std::int32_t (*left)[kBatchLanes],
                                        float (*closed)[kBatchLanes], std::int32_t* open_cols) {
        const Ints row = cells >> 4;
        const Ints col = (cells & Ints::broadcast(kFirstColumnNode - 1)) + Ints::broadcast(kFirstColumnNode);
        Ints in_row = Ints::broadcast(0), in_col = Ints::broadcast(0);
        for (int i = 0; i < rows; ++i) in_row = in_row | (row.equal_to(Ints::broadcast(i)) & Ints::load(left[i]));
        for (int j = 0; j < cols; ++j)
            in_col = in_col | (col.equal_to(Ints::broadcast(column(j))) & Ints::load(left[column(j)]));
        const Ints moved = min(in_row, in_col);
        const Ints closes_row = in_col.greater_than(in_row) | Ints::load(open_cols).equal_to(Ints::broadcast(1));
        const Ints child = select(closes_row, row, col);
        (Ints::load(open_cols) - Ints::broadcast(1) - closes_row).store(open_cols);
        child.store(answer.child[step]);
        select(closes_row, col, row).store(answer.parent[step]);
        moved.store(answer.flow[step]);
        const Ints shut = Floats::broadcast(kClosed).template bit_cast<std::int32_t>();
        const auto use_up = [&](int node, const Ints& its_side) __attribute__((always_inline)) {
            (Ints::load(left[node]) - (its_side.equal_to(Ints::broadcast(node)) & moved)).store(left[node]);
            const Ints was = Floats::load(closed[node]).template bit_cast<std::int32_t>();
            (was | (child.equal_to(Ints::broadcast(node)) & shut)).template bit_cast<float>().store(closed[node]);
        };
        for (int i = 0; i < rows; ++i) use_up(i, row);
        for (int j = 0; j < cols; ++j) use_up(column(j), col);
    }

    // The proof: duals from the last step backwards, and no reduced cost below zero. The cost is computed from the
    // duals.
    HORD_ALWAYS_INLINE void prove(const std::int32_t (*served)[kBatchLanes]) {
        double* const duals = dual[0];
        const double* const cell_costs = cost[0];
        const int steps = rows + cols - 1;
        for (int l = 0; l < kBatchLanes; ++l) dual[answer.parent[steps - 1][l]][l] = 0;
        for (int step = steps - 1; step >= 0; --step) {
            std::uint32_t child[kBatchLanes], parent[kBatchLanes],
                by[kBatchLanes];  // offsets from the first lane
            const auto place = [](const std::int32_t* of) __attribute__((always_inline)) {
                return ((Ints::load(of) << 4) + Ints::iota()).template bit_cast<std::uint32_t>();
            };
            static_assert(kBatchLanes == 1 << 4);
            place(answer.child[step]).store(child);
            place(answer.parent[step]).store(parent);
            place(served[step]).store(by);
            for (int l = 0; l < kBatchLanes; ++l) duals[child[l]] = cell_costs[by[l]] - duals[parent[l]];
        }
        Doubles least = Doubles::broadcast(0), sum = Doubles::broadcast(0);
        for (int i = 0; i < rows; ++i) {
            const Doubles of_row = Doubles::load(dual[i]);
            for (int j = 0; j < cols; ++j)
                least = min(least, Doubles::load(cost[cell(i, j)]) - of_row - Doubles::load(dual[column(j)]));
            sum = sum + masses(i) * of_row;
        }
        for (int j = 0; j < cols; ++j) sum = sum + masses(column(j)) * Doubles::load(dual[column(j)]);
        sum.store(answer.cost);
        double worst[kBatchLanes];
        least.store(worst);
        for (int l = 0; l < kBatchLanes; ++l) answer.proven[l] = worst[l] >= -costs.tolerance;
    }

    HORD_ALWAYS_INLINE void solve() {
        gather();
        if (rows == 1) return from_one();
        if (rows > 2) return by_least_cost();
        knapsack();
        // Unproven lanes are planned as with more rows, so that the simplex has a plan to start from; others stay.
        double proven_cost[kBatchLanes];
        bool proven[kBatchLanes], all = true;
        for (int l = 0; l < kBatchLanes; ++l) proven_cost[l] = answer.cost[l];
        for (int l = 0; l < kBatchLanes; ++l) proven[l] = answer.proven[l];
        for (int l = 0; l < b.filled; ++l) all = all && proven[l];
        if (all) return;
        by_least_cost();
        for (int l = 0; l < kBatchLanes; ++l) answer.cost[l] = proven[l] ? proven_cost[l] : answer.cost[l];
        for (int l = 0; l < kBatchLanes; ++l) answer.proven[l] = proven[l] || answer.proven[l];
    }

    HORD_ALWAYS_INLINE void by_least_cost() {
        std::int32_t served[kMaxBatchSteps][kBatchLanes];
        order_cells();
        serve(served);
        prove(served);
        int unproven = 0;
        for (int l = 0; l < b.filled; ++l) unproven += answer.proven[l] ? 0 : 1;
        if (unproven >= kFewestLanes) hand_over();
    }

    HORD_ALWAYS_INLINE void hand_over() {
        for (int i = 0; i < rows; ++i) {
            for (int j = 0; j < cols; ++j) Doubles::load(cost[cell(i, j)]).store(answer.cell_cost[cell(i, j)]);
            Doubles::load(dual[i]).store(answer.dual[i]);
        }
        for (int j = 0; j < cols; ++j) Doubles::load(dual[column(j)]).store(answer.dual[column(j)]);
    }
};

template <int Bytes, class Mass>
HORD_ALWAYS_INLINE void solve(const TransportBatch<Mass>& batch, const TransportBatchCosts& costs,
                              TransportAnswer<Mass>& answer) {
    Batch<Bytes, Mass>(batch, costs, answer).solve();
}
HORD_FOR_EACH_ISA(int32_kernel, solve, std::int32_t)
HORD_FOR_EACH_ISA(double_kernel, solve, double)

}  // namespace

template <>
SolveTransportBatch<std::int32_t> transport_kernel(Isa isa) {
    return int32_kernel(isa);
}
template <>
SolveTransportBatch<double> transport_kernel(Isa isa) {
    return double_kernel(isa);
}

}  // namespace hord::algo
