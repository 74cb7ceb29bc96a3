#include "algo/transport_simplex.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "algo/transport_lanes.h"
#include "algo/transport_tree.h"

namespace hord::algo {
namespace {

using Outcome = TransportSimplex::Outcome;

constexpr int kLanes = 16;       // floats and int32
constexpr int kExactLanes = 8;   // doubles
constexpr int kPivotsANode = 200;
constexpr int kPivotsBetweenDuals = 64;
constexpr int kRowsAtOnce = 16;  // priced before the best of them enter
constexpr float kNeverChosen = 1e30F;  // the cost of padding
constexpr std::int32_t kOpen = std::numeric_limits<std::int32_t>::min();
constexpr std::int32_t kClosed = std::numeric_limits<std::int32_t>::max();
constexpr float kKeyUnits = 16000;  // the largest cost, as a key
constexpr float kWorthIt = 0.2F;  // of the best reduced cost of a block: what may enter with it
constexpr double kCoarse = 0x1p-18;  // of the largest cost: what single precision may get wrong

constexpr int padded(int count, int lanes) { return (count + lanes - 1) / lanes * lanes; }
std::size_t size(int count) { return static_cast<std::size_t>(count); }

}  // namespace

// Rows and columns of costs are padded to whole vectors. Nodes: rows, then columns.
struct TransportWorkspace {
    TransportWorkspace(const double* costs, int most_bins, double largest_cost)
        : bins(most_bins), tolerance(largest_cost * TransportSimplex::kTolerance),
          coarse(static_cast<float>(largest_cost * kCoarse)),
          key_scale(largest_cost > 0 ? kKeyUnits / static_cast<float>(largest_cost) : 0) {
        const int side = padded(bins, kLanes);
        cost.resize(size(bins * (bins + 1)), static_cast<double>(kNeverChosen));
        for (int i = 0; i < bins; ++i) std::copy_n(costs + static_cast<std::ptrdiff_t>(i) * bins, bins, cost.begin() + i * (bins + 1));
        rough_cost.assign(cost.begin(), cost.end());
        cell.resize(size(side * side));
        key.resize(size(side * side));
        for (auto* values : {&mean_row, &mean_col, &demand}) values->resize(size(side));
        for (auto* values : {&left_row, &left_col}) values->resize(size(side));
        for (auto* marks : {&shut_col, &best_of_row, &col_bin}) marks->resize(size(side));
        dual.resize(size(2 * side));
        rough_dual.resize(size(2 * side));
        path.resize(size(2 * side));
        steps.resize(size(2 * side));
        nodes1.resize(64);
        nodes2.resize(128);
        nodes4.resize(256);
        nodes8.resize(512);
    }

    template <int Words>
    TreeNode<Words>* tree() {
        if constexpr (Words == 1) return nodes1.data();
        if constexpr (Words == 2) return nodes2.data();
        if constexpr (Words == 4) return nodes4.data();
        if constexpr (Words == 8) return nodes8.data();
    }

    int bins;
    double tolerance;
    float coarse;
    float key_scale;
    std::vector<double> cost;  // bins x (bins + 1): padding is bin number `bins`
    std::vector<float> rough_cost;  // the same, rounded

    std::vector<float> cell;  // costs, rows x stride
    std::vector<double> dual;  // u of rows; minus v of columns: on the tree c = u - dual of the column
    std::vector<float> rough_dual;  // the same, rounded
    std::vector<int> path;
    std::vector<TransportStep> steps;
    std::vector<std::int32_t> col_bin;

    // For the start.
    std::vector<std::int32_t> key;  // rows x stride
    std::vector<std::int32_t> best_of_row, shut_col;
    std::vector<float> mean_row, mean_col, demand;
    std::vector<double> left_row, left_col;

    std::vector<TreeNode<1>> nodes1;
    std::vector<TreeNode<2>> nodes2;
    std::vector<TreeNode<4>> nodes4;
    std::vector<TreeNode<8>> nodes8;
};

namespace {

// One problem, for one instruction set. All inlined into the function that is compiled for it.
template <int Bytes>
struct Problem {
    using Floats = Lanes<float, kLanes, Bytes>;
    using Keys = Lanes<std::int32_t, kLanes, Bytes>;

    TransportWorkspace& w;
    const Transport& p;
    const int stride;

    HORD_ALWAYS_INLINE Problem(TransportWorkspace& workspace, const Transport& problem)
        : w(workspace), p(problem), stride(padded(problem.cols, kLanes)) {}

    HORD_ALWAYS_INLINE int column(int j) const { return p.rows + j; }  // its node
    HORD_ALWAYS_INLINE const double* exact_costs_of(int row) const { return w.cost.data() + static_cast<std::ptrdiff_t>(p.row_bin[row]) * (w.bins + 1); }
    HORD_ALWAYS_INLINE double exact_cost(int row, int col) const { return exact_costs_of(row)[p.col_bin[col]]; }
    HORD_ALWAYS_INLINE float* costs_of(int row) const { return w.cell.data() + static_cast<std::ptrdiff_t>(row) * stride; }
    HORD_ALWAYS_INLINE std::int32_t* keys_of(int row) const { return w.key.data() + static_cast<std::ptrdiff_t>(row) * stride; }

    HORD_ALWAYS_INLINE void gather_costs() {
        std::int32_t* const bin = w.col_bin.data();
        for (int j = 0; j < p.cols; ++j) bin[j] = p.col_bin[j];
        for (int j = p.cols; j < stride; ++j) bin[j] = w.bins;
        for (int i = 0; i < p.rows; ++i) {
            const float* from = w.rough_cost.data() + static_cast<std::ptrdiff_t>(p.row_bin[i]) * (w.bins + 1);
            float* to = costs_of(i);
            for (int j = 0; j < stride; j += kLanes) {
                for (int l = 0; l < kLanes; ++l) to[j + l] = from[bin[j + l]];
            }
        }
    }

    // The key that says when each cell is served: c_ij - R_i - K_j.
    HORD_ALWAYS_INLINE void order_cells() {
        double total = 0;
        for (int i = 0; i < p.rows; ++i) total += p.supply[i];
        const double share = 1 / total;
        float* const demand = w.demand.data();
        float* const mean_col = w.mean_col.data();
        for (int j = 0; j < p.cols; ++j) demand[j] = static_cast<float>(p.demand[j] * share);
        for (int j = p.cols; j < stride; ++j) demand[j] = 0;
        for (int j = 0; j < stride; j += kLanes) Floats::all(0).to(mean_col + j);
        for (int i = 0; i < p.rows; ++i) {
            const auto weight = static_cast<float>(p.supply[i] * share);
            const float* costs = costs_of(i);
            Floats sum = Floats::all(0);
            for (int j = 0; j < stride; j += kLanes) {
                const Floats c = Floats::at(costs + j);
                sum = sum + c * Floats::at(demand + j);
                (Floats::at(mean_col + j) + c * Floats::all(weight)).to(mean_col + j);
            }
            w.mean_row[size(i)] = sum.sum();
        }
        for (int i = 0; i < p.rows; ++i) {
            const float* costs = costs_of(i);
            std::int32_t* keys = keys_of(i);
            const float mean_row = w.mean_row[size(i)];
            for (int j = 0; j < stride; j += kLanes) {
                const Floats order = (Floats::at(costs + j) - Floats::all(mean_row) - Floats::at(mean_col + j)) * Floats::all(w.key_scale);
                const Keys cell = Keys::numbers() + Keys::all(i << 8 | j);
                (order.template converted<std::int32_t>() << 16 | cell).to(keys + j);
            }
        }
    }

    HORD_ALWAYS_INLINE std::int32_t best_in(int row) const {
        const std::int32_t* keys = keys_of(row);
        Keys best = Keys::all(kClosed);
        for (int j = 0; j < stride; j += kLanes) best = lower(best, higher(Keys::at(keys + j), Keys::at(w.shut_col.data() + j)));
        return best.least();
    }

    HORD_ALWAYS_INLINE std::int32_t best_of_rows() const {
        Keys best = Keys::at(w.best_of_row.data());
        for (int i = kLanes; i < p.rows; i += kLanes) best = lower(best, Keys::at(w.best_of_row.data() + i));
        return best.least();
    }

    // The row with the cell of least key serves its columns in the order of their keys until it is used up; then the next row.
    // Each time the row or the column that is used up is closed.
    HORD_ALWAYS_INLINE void find_start(TransportStep* steps) {
        order_cells();
        for (int j = 0; j < stride; j += kLanes) Keys::all(kOpen).to(w.shut_col.data() + j);
        for (int j = p.cols; j < stride; ++j) w.shut_col[size(j)] = kClosed;
        for (int i = 0; i < p.rows; ++i) w.best_of_row[size(i)] = best_in(i);
        for (int i = p.rows; i < padded(p.rows, kLanes); ++i) w.best_of_row[size(i)] = kClosed;
        for (int i = 0; i < p.rows; ++i) w.left_row[size(i)] = p.supply[i];
        for (int j = 0; j < p.cols; ++j) w.left_col[size(j)] = p.demand[j];
        const int last = p.rows + p.cols - 2;
        int open_cols = p.cols;
        std::int32_t best = best_of_rows();
        for (int step = 0;; ++step) {
            if (w.shut_col[size(best & 0xFF)] != kOpen) best = best_in(best >> 8 & 0xFF);  // that column has closed since
            const int i = best >> 8 & 0xFF;
            const int j = best & 0xFF;
            // No branches: they would be guesses.
            const double left_row = w.left_row[size(i)];
            const double left_col = w.left_col[size(j)];
            const int row_used_up = (left_row < left_col ? 1 : 0) | (open_cols == 1 ? 1 : 0);
            const double flow = lower(left_row, left_col);  // the last column has what all rows have left
            w.left_row[size(i)] = left_row - flow;
            w.left_col[size(j)] = left_col - flow;
            w.best_of_row[size(i)] = best ^ ((best ^ kClosed) & -row_used_up);
            w.shut_col[size(j)] = kClosed ^ (-row_used_up & (kClosed ^ kOpen));
            open_cols -= 1 - row_used_up;
            const int swap = (i ^ column(j)) & -row_used_up;
            steps[step] = {flow, column(j) ^ swap, i ^ swap};
            if (step == last) return;
            if (row_used_up != 0) best = best_of_rows();
        }
    }

    // What is used up hangs from the other.
    template <int Words>
    HORD_ALWAYS_INLINE void plant(TreeNode<Words>* tree, const TransportStep* steps) {
        const int last = p.rows + p.cols - 2;
        for (int node = 0; node < p.rows + p.cols; ++node) tree[node].below = NodeSet<Words>::only(node);
        for (int step = 0; step <= last; ++step) {
            const TransportStep& s = steps[step];
            TreeNode<Words>& child = tree[s.child];
            child.parent = s.parent;
            child.flow = s.flow;
            tree[s.parent].below.add(child.below);
        }
        const int root = steps[last].parent;
        tree[root].parent = kNoParent;
        tree[root].flow = 0;

        double* const dual = w.dual.data();
        dual[root] = 0;
        for (int step = last; step >= 0; --step) {
            const TransportStep& s = steps[step];
            dual[s.child] = dual[s.parent] + rise(s.child, s.parent);
        }
    }

    // From a node's dual variable to that of the node below it: the cost of the arc, up to a row, down to a column.
    HORD_ALWAYS_INLINE double rise(int node, int parent) const {
        const int is_column = node >= p.rows ? 1 : 0;
        const int swap = (node ^ parent) & -is_column;
        return exact_cost(node ^ swap, (parent ^ swap) - p.rows) * (1 - 2 * is_column);
    }

    // Dual variables from the tree alone: every node after its parent.
    template <int Words>
    HORD_ALWAYS_INLINE void compute_duals(const TreeNode<Words>* tree) {
        double* const dual = w.dual.data();
        int* const waiting = w.path.data();
        NodeSet<Words> known{};
        for (int node = 0; node < p.rows + p.cols; ++node) {
            int depth = 0;
            for (int at = node; at != kNoParent && !known.has(at); at = tree[at].parent) waiting[depth++] = at;
            while (depth > 0) {
                const int next = waiting[--depth];
                const int parent = tree[next].parent;
                dual[next] = parent == kNoParent ? 0.0 : dual[parent] + rise(next, parent);
                known.add(NodeSet<Words>::only(next));
            }
        }
    }

    HORD_ALWAYS_INLINE double reduced_cost(int row, int col) const {
        const double* const dual = w.dual.data();
        return exact_cost(row, col) + dual[column(col)] - dual[row];
    }

    // The least reduced cost of every lane over a block of rows, in single precision; the 16 low bits are its row and column.
    HORD_ALWAYS_INLINE void price(int first, int last, float* least_of_lane) const {
        for (int node = 0; node < p.rows + p.cols; ++node) w.rough_dual[size(node)] = static_cast<float>(w.dual[size(node)]);
        const float* const dual = w.rough_dual.data();
        const Keys no_tag = Keys::all(~0xFFFF);
        const Keys next_row = Keys::all(1 << 8);
        Floats best = Floats::all(0);
        for (int j = 0; j < stride; j += kLanes) {
            const Floats minus_v = Floats::at(dual + p.rows + j);
            Keys tag = Keys::numbers() + Keys::all(first << 8 | j);
            const float* costs = costs_of(first) + j;
            for (int i = first; i < last; ++i, costs += stride) {
                const Floats reduced = Floats::at(costs) + minus_v - Floats::all(dual[i]);
                const Keys tagged = (reduced.template bits_as<std::int32_t>() & no_tag) | tag;
                tag = tag + next_row;
                best = lower(best, tagged.template bits_as<float>());
            }
        }
        best.to(least_of_lane);
    }

    // The first cell whose reduced cost, in double precision, is below -tolerance. False: there is none.
    HORD_ALWAYS_INLINE bool price_exactly(int& row, int& col) const {
        using Doubles = Lanes<double, kExactLanes, Bytes>;
        const double* const dual = w.dual.data();
        const std::int32_t* const bin = w.col_bin.data();
        for (int i = 0; i < p.rows; ++i) {
            const double* from = exact_costs_of(i);
            Doubles best = Doubles::all(0);
            for (int j = 0; j < p.cols; j += kExactLanes) {
                double costs[kExactLanes];
                for (int l = 0; l < kExactLanes; ++l) costs[l] = from[bin[j + l]];
                best = lower(best, Doubles::at(costs) + Doubles::at(dual + p.rows + j) - Doubles::all(dual[i]));
            }
            if (best.least() < -w.tolerance) {
                row = i;
                for (col = 0; reduced_cost(row, col) >= -w.tolerance;) ++col;
                return true;
            }
        }
        return false;
    }

    template <int Words>
    HORD_ALWAYS_INLINE void enter(TreeNode<Words>* tree, int row, int col, double reduced) {
        const Moved<Words> moved = pivot(tree, row, column(col), w.path.data());
        double* const dual = w.dual.data();
        const double step = reduced * (moved.with_column ? -1 : 1);
        for (int word = 0; word < Words; ++word) {
            for (std::uint64_t rest = moved.nodes.word[word]; rest != 0; rest &= rest - 1) {
                dual[word * 64 + __builtin_ctzll(rest)] += step;
            }
        }
    }

    template <int Words>
    HORD_ALWAYS_INLINE double plan_cost(const TreeNode<Words>* tree) const {
        double sum = 0;
        for (int node = 0; node < p.rows + p.cols; ++node) {
            const int parent = tree[node].parent;
            if (parent != kNoParent) sum += tree[node].flow * std::abs(rise(node, parent));
        }
        return sum;
    }

    template <int Words>
    HORD_ALWAYS_INLINE Outcome improve(const TransportStep* steps) {
        TreeNode<Words>* const tree = w.tree<Words>();
        plant(tree, steps);
        Outcome outcome;
        const int most_pivots = kPivotsANode * (p.rows + p.cols);
        int since_duals = 0;
        int first = 0, rows_without = 0;
        for (;;) {
            // In single precision, as long as that finds something; every cell that enters is checked in double precision.
            while (rows_without < p.rows && outcome.pivots < most_pivots) {
                const int last = first + kRowsAtOnce < p.rows ? first + kRowsAtOnce : p.rows;
                float least[kLanes];
                price(first, last, least);
                rows_without += last - first;
                first = last == p.rows ? 0 : last;
                float best = least[0];
                for (const float candidate : least) best = lower(best, candidate);
                const float good = lower(best * kWorthIt, -w.coarse);
                std::int32_t candidates[kLanes];
                int count = 0;
                for (const float candidate : least) {
                    candidates[count] = __builtin_bit_cast(std::int32_t, candidate);
                    count += candidate <= good ? 1 : 0;
                }
                for (int k = 0; k < count; ++k) {
                    const std::int32_t tag = candidates[k];
                    const int row = tag >> 8 & 0xFF, col = tag & 0xFF;
                    const double reduced = reduced_cost(row, col);
                    if (reduced >= -w.tolerance || reduced > static_cast<double>(good)) continue;
                    enter(tree, row, col, reduced);
                    ++outcome.pivots;
                    ++since_duals;
                    rows_without = 0;
                }
            }
            if (outcome.pivots >= most_pivots) {
                outcome.proven = false;
                break;
            }
            if (since_duals > kPivotsBetweenDuals) {  // what the pivots added up to in rounding is taken out before the last check
                compute_duals(tree);
                since_duals = 0;
            }
            int row = 0, col = 0;
            if (!price_exactly(row, col)) break;
            enter(tree, row, col, reduced_cost(row, col));
            ++outcome.pivots;
            ++since_duals;
            rows_without = 0;
        }
        outcome.cost = plan_cost(tree);
        return outcome;
    }

    HORD_ALWAYS_INLINE Outcome solve(const TransportStep* start) {
        gather_costs();
        if (start == nullptr) {
            find_start(w.steps.data());
            start = w.steps.data();
        }
        const int nodes = p.rows + p.cols;
        if (nodes <= 64) return improve<1>(start);
        if (nodes <= 128) return improve<2>(start);
        if (nodes <= 256) return improve<4>(start);
        return improve<8>(start);
    }
};

template <int Bytes>
HORD_ALWAYS_INLINE Outcome solve_body(TransportWorkspace& workspace, const Transport& problem, const TransportStep* start) {
    return Problem<Bytes>(workspace, problem).solve(start);
}

HORD_FOR_EACH_ISA(solve_for, Outcome, solve_body, (TransportWorkspace& workspace, const Transport& problem, const TransportStep* start),
                  (workspace, problem, start))

}  // namespace

TransportSimplex::TransportSimplex(const double* cost, int bins, double largest_cost, Isa isa)
    : workspace_(std::make_unique<TransportWorkspace>(cost, bins, largest_cost)), solve_(solve_for(isa)) {}
TransportSimplex::~TransportSimplex() = default;
TransportSimplex::TransportSimplex(TransportSimplex&&) noexcept = default;
TransportSimplex& TransportSimplex::operator=(TransportSimplex&&) noexcept = default;

Outcome TransportSimplex::solve(const Transport& problem, const TransportStep* start) { return solve_(*workspace_, problem, start); }

}  // namespace hord::algo
