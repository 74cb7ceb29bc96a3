#include "algo/emd/transport_simplex.h"

#include <algorithm>
#include <array>
#include <bit>

#include "algo/emd/transport_cells.h"
#include "algo/emd/transport_start.h"
#include "algo/emd/transport_tree.h"
#include "algo/simd/aligned.h"
#include "common/fixed.h"

namespace hord::algo {
namespace {

using Outcome = TransportSimplex::Outcome;

constexpr int kLanes = TransportCosts::kLanes;
constexpr int kPivotsPerNode = 200;
constexpr int kRowsToPrice = 24;  // problems with more rows price
constexpr int kRowsAtOnce = 20;   // this many at a time
constexpr std::int32_t kPadding = TransportCosts::kPadding;
constexpr std::int32_t kMaxDual = TransportCosts::kMaxDual;
// Bits that costs lose each time duals leave that range. At most three times: a path of 449 arcs sums at most 225 costs
// of up to 2^21, which is within the range.
constexpr int kCoarserBits = 2;
constexpr std::int32_t kExcluded = 1 << 28;  // added to cells in the tree, so that they are never the least
constexpr std::int32_t kNoCell = TransportCosts::kNoCell;
constexpr double kNoCost = 1e30;  // double cost of padding

constexpr int padded(int count) { return TransportCosts::padded(count); }
std::size_t size(int count) { return static_cast<std::size_t>(count); }

constexpr int kMaxWords = 15;  // of 32 arcs: two sides of 15 x 15 bins

}  // namespace

// Memory of one problem until its tree is built.
struct TransportProblemSpace {
    explicit TransportProblemSpace(int side) : start(size(side)) {
        // Reading the last row by more vectors than it has stays inside.
        cell.resize(size(side * (side + TransportStartSpace::kMaxVectors * kLanes)));
        for (auto* values : {&row_begin, &col_bin}) values->resize(size(side));
    }
    AlignedVector<std::int32_t> cell;       // integer costs, rows x stride
    AlignedVector<std::int32_t> row_begin;  // offset of a row in the cost tables
    AlignedVector<std::int32_t> col_bin;    // bin of a column, padding included
    TransportStartSpace start;
};

struct TransportWorkspace {
    TransportWorkspace(const double* costs, int max_bins, double largest_cost)
        : bins(max_bins), tolerance(largest_cost * TransportSimplex::kTolerance),
          scale(largest_cost > 0 ? TransportCosts::kMaxCost / largest_cost : 0),
          of_problem{TransportProblemSpace(padded(max_bins)), TransportProblemSpace(padded(max_bins))} {
        const int side = padded(bins);
        cost.resize(size(bins * (bins + 1)), kNoCost);
        rough_cost.resize(cost.size(), kPadding);
        for (int i = 0; i < bins; ++i) {
            for (int j = 0; j < bins; ++j) {
                const double c = costs[static_cast<std::ptrdiff_t>(i) * bins + j];
                cost[size(i * (bins + 1) + j)] = c;
                rough_cost[size(i * (bins + 1) + j)] = static_cast<std::int32_t>(c * scale);
            }
        }
        flow.resize(size(2 * side));
        path.resize(size(2 * side * kMaxWords));
        dual.resize(size(2 * side));
        arcs.resize(size(2 * side));
    }

    int bins;
    double tolerance;
    double scale;                            // from a double cost to an integer one
    AlignedVector<double> cost;              // bins x (bins + 1); bin number `bins` is padding
    AlignedVector<std::int32_t> rough_cost;  // the same as integers

    std::array<TransportProblemSpace, 2> of_problem;

    // The tree.
    AlignedVector<std::int32_t> path, dual;
    AlignedVector<double> flow;
    AlignedVector<TransportArc> arcs;
};

namespace {

// gather() and attach_steps() are scalar loops, not inlined: inside Problem::solve() they would lack registers.

// Copies the costs of a problem's cells, row by row.
[[gnu::noinline]] void gather(const std::int32_t* table, int rows, int stride, const std::int32_t* row_begin,
                              const std::int32_t* col_bin, std::int32_t* cells) {
    for (int i = 0; i < rows; ++i, cells += stride) {
        const std::int32_t* const from = table + row_begin[i];
        for (int j = 0; j < stride; j += kLanes) {
            for (int l = 0; l < kLanes; ++l) cells[j + l] = from[col_bin[j + l]];
        }
    }
}

// Builds the tree from its root: what a step used up becomes the child of the other. Excludes its cells.
template <class Tree>
[[gnu::noinline]] void attach_steps(Tree& target, const TransportStep* steps, int last, std::int32_t* cells, int stride,
                                    std::int32_t tags) {
    Tree tree = target;  // a copy stays in registers
    for (int step = last; step >= 0; --step) {
        const TransportStep s = steps[step];
        std::int32_t& cell = cells[s.row * stride + s.column];
        tree.attach(step, s.row, tree.first_column + s.column, s.row_used_up, s.flow, cell & ~tags, 2 * kMaxDual);
        cell += kExcluded;
    }
    target.row_is_below = tree.row_is_below;
}

// One problem while it is solved. Always inlined: compiled for the instruction set of the caller.
template <int Bytes>
struct Problem {
    using Cells = TransportCells<Bytes>;
    using Ints = typename Cells::Ints;

    TransportWorkspace& w;
    TransportProblemSpace& own;
    const Transport& p;
    const Cells cells;
    const int first_column;  // among nodes

    HORD_ALWAYS_INLINE Problem(TransportWorkspace& workspace, int number, const Transport& problem)
        : w(workspace), own(workspace.of_problem[size(number)]), p(problem),
          cells(problem.rows, problem.cols, own.cell.data()), first_column(padded(problem.rows)) {}

    // `coarser`: number of low bits that costs lose.
    HORD_ALWAYS_INLINE void gather_costs(int coarser) {
        std::int32_t* const bin = own.col_bin.data();
        std::int32_t* const begin = own.row_begin.data();
        for (int i = 0; i < p.rows; ++i) begin[i] = p.row_bin[i] * (w.bins + 1);
        for (int j = 0; j < p.cols; ++j) bin[j] = p.col_bin[j];
        for (int j = p.cols; j < cells.stride; ++j) bin[j] = w.bins;
        gather(w.rough_cost.data(), p.rows, cells.stride, begin, bin, cells.cell);
        for (int i = 0; coarser != 0 && i < p.rows; ++i) {
            for (int j = 0; j < p.cols; ++j) cells.row(i)[j] >>= coarser;
        }
        // A separate loop: by now the stores above have completed.
        const Ints half = Ints::broadcast(cells.tags / 2 + 1), no_tag = Ints::broadcast(~cells.tags),
                   next = Ints::broadcast(kLanes);
        for (int i = 0; i < p.rows; ++i) {
            std::int32_t* here = cells.row(i);
            Ints tag = Ints::iota() + Ints::broadcast(i << cells.col_bits);
            for (int j = 0; j < cells.stride; j += kLanes) {
                (((Ints::load(here + j) + half) & no_tag) + tag).store(here + j);
                tag = tag + next;
            }
        }
    }

    template <int Words>
    using Tree = TransportTree<Words, Bytes>;

    HORD_ALWAYS_INLINE std::int32_t& cell(const TransportArc& arc) const {
        return cells.row(arc.row)[arc.column - first_column];
    }
    HORD_ALWAYS_INLINE double exact_cost(const TransportArc& arc) const {
        return w.cost.data()[own.row_begin.data()[arc.row] + own.col_bin.data()[arc.column - first_column]];
    }

    template <int Words>
    HORD_ALWAYS_INLINE void build_tree(Tree<Words>& tree, const TransportStep* steps) {
        const int last = p.rows + p.cols - 2;
        tree.set_root(steps[last].row_used_up ? first_column + steps[last].column : steps[last].row);
        attach_steps(tree, steps, last, cells.cell, cells.stride, cells.tags);
    }

    // The least integer reduced cost of some rows, with the tag of its cell.
    HORD_ALWAYS_INLINE std::int32_t price(const std::int32_t* dual, int first_row, int last_row) const {
        Ints least = Ints::broadcast(kNoCell);
        cells.for_columns([&](int first, auto vectors) __attribute__((always_inline)) {
            Ints best[vectors];
            const std::int32_t* const top = cells.row(first_row) + first;
            Cells::template least_of_columns<vectors>(
                last_row - first_row, [&](int i) __attribute__((always_inline)) { return top + i * cells.stride; },
                dual + first_row, best);
            for (int k = 0; k < vectors; ++k)
                least = min(least, best[k] + Ints::load(dual + first_column + first + k * kLanes));
        });
        return least.reduce_min();
    }

    HORD_ALWAYS_INLINE static std::int64_t largest_of(const std::int32_t* dual, int nodes) {
        Ints largest = Ints::broadcast(0);
        for (int x = 0; x < nodes; x += kLanes) {
            const Ints d = Ints::load(dual + x);
            largest = max(largest, max(d, Ints::broadcast(0) - d));
        }
        return -std::int64_t{(Ints::broadcast(0) - largest).reduce_min()};
    }

    // The cell enters the tree and is excluded; the one that leaves is included again.
    template <int Words>
    HORD_ALWAYS_INLINE void pivot(Tree<Words>& tree, const TransportArc& enters, std::int32_t reduced) {
        cell(enters) += kExcluded;
        cell(tree.pivot(enters.row, enters.column, reduced)) -= kExcluded;
    }

    // Pivots until no integer reduced cost is negative; `least` is then the least of all cells. False: duals left their
    // range.
    template <int Words>
    HORD_ALWAYS_INLINE bool improve(Tree<Words>& tree, int max_pivots, int& pivots, std::int32_t& least) {
        const int at_once = p.rows <= kRowsToPrice ? p.rows : kRowsAtOnce;
        std::int64_t bound = largest_of(tree.dual, tree.nodes);
        for (int first = 0, without = 0; without < p.rows && pivots < max_pivots;) {
            if (bound > kMaxDual) {
                bound = largest_of(tree.dual, tree.nodes);
                if (bound > kMaxDual) return false;
            }
            const int last = min(first + at_once, p.rows);
            const std::int32_t best = price(tree.dual, first, last);
            without += last - first;
            first = last == p.rows ? 0 : last;
            least = min(least, best);
            if (best >= 0) continue;
            without = 0;
            least = kNoCell;
            const std::int32_t reduced = best & ~cells.tags;
            pivot(tree, {cells.row_of(best), first_column + cells.col_of(best)}, reduced);
            bound -= reduced;
            ++pivots;
        }
        return true;
    }

    // Integer reduced costs up to this may be negative in double precision: each cost of the cycle is rounded by half a
    // tag and one.
    HORD_ALWAYS_INLINE std::int32_t doubtful(int arcs) const { return arcs * (cells.tags / 2 + 2) | cells.tags; }

    // Whether the reduced cost is below -tolerance in double precision. `rough`: the integer one, with tag.
    template <int Words>
    HORD_ALWAYS_INLINE bool is_negative(const Tree<Words>& tree, const TransportArc& enters, std::int32_t rough) const {
        const auto cycle = tree.cycle(enters.row, enters.column);
        if (rough > doubtful(1 + cycle.arcs.count())) return false;
        double sum = exact_cost(enters);
        cycle.arcs.for_each([&](int a) __attribute__((always_inline)) {
            sum += negated_if(exact_cost(tree.arc[a]), cycle.decreasing.has(a));
        });
        return sum < -w.tolerance;
    }

    // Upper bound of the arcs of a cycle.
    template <int Words>
    HORD_ALWAYS_INLINE int longest_cycle(const Tree<Words>& tree) const {
        if (Words <= 2) return 2 * min(p.rows, p.cols);
        int row = 0, col = 0;  // greatest depths
        for (int i = 0; i < p.rows; ++i) row = std::max(row, tree.path_of(i).count());
        for (int j = 0; j < p.cols; ++j) col = std::max(col, tree.path_of(first_column + j).count());
        return 1 + row + col;
    }

    HORD_ALWAYS_INLINE std::int32_t rough_reduced(const std::int32_t* dual, const TransportArc& arc) const {
        return cell(arc) + dual[arc.row] + dual[arc.column];
    }

    // Finds a cell outside the tree with a negative reduced cost in double precision. `least`: a lower bound of all
    // integer ones. Only columns with a doubtful cell are computed.
    template <int Words>
    HORD_ALWAYS_INLINE bool price_in_double(const Tree<Words>& tree, std::int32_t least, TransportArc& enters) const {
        const std::int32_t clear_from = doubtful(longest_cycle(tree));
        if (least > clear_from) return false;
        bool found = false;
        cells.for_columns([&](int first, auto vectors) __attribute__((always_inline)) {
            Ints best[vectors];
            Cells::template least_of_columns<vectors>(
                p.rows, [&](int i) __attribute__((always_inline)) { return cells.row(i) + first; }, tree.dual, best);
            Ints bits = Ints::broadcast(0), bit = Ints::powers_of_two();
            for (int k = 0; k < vectors; ++k) {
                const Ints clear = (best[k] + Ints::load(tree.dual + first_column + first + k * kLanes))
                                       .greater_than(Ints::broadcast(clear_from));
                bits = bits | select(clear, Ints::broadcast(0), bit);
                bit = bit << kLanes;
            }
            for (auto doubted = static_cast<std::uint32_t>(bits.reduce_or()); doubted != 0 && !found;
                 doubted &= doubted - 1) {
                enters.column = first_column + first + std::countr_zero(doubted);
                for (enters.row = 0; enters.row < p.rows && !found; enters.row += found ? 0 : 1) {
                    const std::int32_t reduced = rough_reduced(tree.dual, enters);
                    found = reduced <= clear_from && is_negative(tree, enters, reduced);
                }
            }
        });
        return found;
    }

    template <int Words>
    HORD_ALWAYS_INLINE double plan_cost(const Tree<Words>& tree) const {
        double sum = 0;
        for (int a = 0; a < p.rows + p.cols - 1; ++a) sum += tree.flow[a] * exact_cost(tree.arc[a]);
        return sum;
    }

    // Pivots by integer costs, then by double costs. False: duals left their range.
    template <int Words>
    HORD_ALWAYS_INLINE bool optimize(Tree<Words>& tree, Outcome& outcome) {
        const int max_pivots = outcome.pivots + kPivotsPerNode * (p.rows + p.cols);
        std::int32_t least = kNoCell;
        if (!improve(tree, max_pivots, outcome.pivots, least)) return false;
        outcome.proven = outcome.pivots < max_pivots;
        for (TransportArc enters; outcome.proven && price_in_double(tree, least, enters);) {
            const std::int32_t reduced = rough_reduced(tree.dual, enters);
            pivot(tree, enters, reduced & ~cells.tags);
            least = 0;  // unknown now: any cell may be doubtful
            outcome.proven = ++outcome.pivots < max_pivots;
            if (largest_of(tree.dual, tree.nodes) > kMaxDual) return false;
        }
        outcome.cost = plan_cost(tree);
        return true;
    }

    template <int Words>
    HORD_ALWAYS_INLINE Outcome solve_with(const TransportStep* start) {
        Outcome outcome;
        for (int coarser = 0;; coarser += kCoarserBits) {
            if (coarser != 0) gather_costs(coarser);
            Tree<Words> tree{first_column,
                             first_column + cells.stride,
                             w.path.data(),
                             w.dual.data(),
                             w.flow.data(),
                             w.arcs.data(),
                             {}};
            build_tree(tree, start);
            if (optimize(tree, outcome)) return outcome;
        }
    }

    HORD_ALWAYS_INLINE Outcome solve(const TransportStep* start) {
        const int arcs = p.rows + p.cols - 1;
        if (arcs <= 30) return solve_with<1>(start);
        if (arcs <= 64) return solve_with<2>(start);
        if (arcs <= 96) return solve_with<3>(start);
        if (arcs <= 224) return solve_with<7>(start);
        return solve_with<kMaxWords>(start);
    }
};

// Finds the starting plans of one or two problems. Vectors: of columns of the larger one.
template <int Vectors, int Bytes>
HORD_ALWAYS_INLINE void find_starts(TransportWorkspace& w, const Transport* problem, int problems) {
    const auto start = [&](int k) __attribute__((always_inline)) {
        return TransportStart<Vectors, Bytes>(Problem<Bytes>(w, k, problem[k]).cells, w.of_problem[size(k)].start,
                                              problem[k].supply, problem[k].demand);
    };
    auto last = start(problems - 1);
    if (problems == 2) {
        auto first = start(0);
        while (!first.is_found() && !last.is_found()) {
            first.serve();
            last.serve();
        }
        while (!first.is_found()) first.serve();
    }
    while (!last.is_found()) last.serve();
}

template <int Bytes>
HORD_ALWAYS_INLINE void solve_body(TransportWorkspace& w, const Transport* problem, int problems,
                                   const TransportStep* start, Outcome* outcome) {
    constexpr int kBytes = Bytes < 32 ? Bytes : 32;
    int cols = 0;
    for (int k = 0; k < problems; ++k) {
        Problem<kBytes>(w, k, problem[k]).gather_costs(0);
        cols = max(cols, problem[k].cols);
    }
    if (start == nullptr) {
        // No case for one vector: problems of up to eight columns come with a plan (algo/emd/transport_batch.h).
        switch (padded(cols) / kLanes) {
            case 1:
            case 2: find_starts<2, kBytes>(w, problem, problems); break;
            case 3: find_starts<3, kBytes>(w, problem, problems); break;
            case 4: find_starts<4, kBytes>(w, problem, problems); break;
            case 5: find_starts<5, kBytes>(w, problem, problems); break;
            case 6: find_starts<6, kBytes>(w, problem, problems); break;
            default: find_starts<0, kBytes>(w, problem, problems);
        }
    }
    for (int k = 0; k < problems; ++k) {
        outcome[k] = Problem<kBytes>(w, k, problem[k])
                         .solve(start != nullptr ? start : w.of_problem[size(k)].start.steps.data());
    }
}

HORD_FOR_EACH_ISA(solve_for, solve_body)

}  // namespace

TransportSimplex::TransportSimplex(const double* cost, int bins, double largest_cost, Isa isa)
    : workspace_(common::make_opaque<TransportWorkspace>(cost, bins, largest_cost)), solve_(solve_for(isa)) {}

Outcome TransportSimplex::solve(const Transport& problem, const TransportStep* start) {
    Outcome outcome;
    solve_(*workspace_, &problem, 1, start, &outcome);
    return outcome;
}

std::array<Outcome, 2> TransportSimplex::solve_two(const std::array<Transport, 2>& problems) {
    std::array<Outcome, 2> outcomes;
    solve_(*workspace_, problems.data(), 2, nullptr, outcomes.data());
    return outcomes;
}

}  // namespace hord::algo
