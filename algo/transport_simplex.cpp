#include "algo/transport_simplex.h"

#include <algorithm>
#include <limits>

namespace hord::algo {
namespace {

constexpr int kRoot = -1;
constexpr int kUnknown = -2;
constexpr int kVector = 8;  // doubles
constexpr double kNeverEnters = 1e300;
constexpr double kTolerance = 0x1p-36;  // of the largest cost

std::size_t index(int k) { return static_cast<std::size_t>(k); }

int rounded_up(int count, int to) { return (count + to - 1) / to * to; }

}  // namespace

TransportSimplex::TransportSimplex(const double* cost, int bins, double largest_cost)
    : table_(cost), bins_(bins), tolerance_(largest_cost * kTolerance) {
    const auto side = index(rounded_up(bins, kVector));
    const auto nodes = 2 * side;
    cell_.resize(side * side);
    for (auto* values : {&u_, &v_, &left_row_, &left_col_, &mean_row_, &mean_col_, &best_key_}) values->resize(side);
    flow_.resize(nodes);
    for (auto* ints : {&parent_, &retired_}) ints->resize(nodes);
    for (auto* ints : {&alive_rows_, &alive_cols_, &best_col_}) ints->resize(side);
    below_.resize((nodes + 1) * (nodes / kWordBits + 1));  // one more: a copy of the subtree that moves
}

TransportSimplex::Outcome TransportSimplex::solve(const Transport& problem) {
    gather_costs(problem);
    start(problem);
    compute_duals();

    Outcome outcome;
    int row = 0, col = 0;
    for (bool fresh = true;;) {
        if (price(row, col)) {
            if (outcome.pivots == kPivotsANode * nodes_) {
                outcome.proven = false;
                break;
            }
            pivot(row, col);
            ++outcome.pivots;
            fresh = false;
        } else if (!fresh) {  // what the pivots added up to in rounding is taken out before the last check
            compute_duals();
            fresh = true;
        } else {
            break;
        }
    }
    outcome.cost = plan_cost();
    return outcome;
}

void TransportSimplex::gather_costs(const Transport& problem) {
    rows_ = problem.rows;
    cols_ = problem.cols;
    nodes_ = rows_ + cols_;
    words_ = nodes_ / kWordBits + 1;
    stride_ = rounded_up(cols_, kVector);
    next_row_ = 0;
    for (int i = 0; i < rows_; ++i) {
        const double* from = table_ + static_cast<std::ptrdiff_t>(problem.row_bin[i]) * bins_;
        double* to = &cell(i, 0);
        for (int j = 0; j < cols_; ++j) to[j] = from[problem.col_bin[j]];
        for (int j = cols_; j < stride_; ++j) to[j] = kNeverEnters;
    }
}

// Builds a plan and its tree: the open cell of least reduced cost takes all it can, and its row or its column, whichever
// is used up, is closed and hangs from the other. Where both are used up the column is closed: the row stays
// open with nothing left and closes later below some column, so that arcs which carry nothing point to the root.
void TransportSimplex::start(const Transport& problem) {
    double total = 0;
    for (int i = 0; i < rows_; ++i) total += problem.supply[i];
    std::copy_n(problem.supply, rows_, left_row_.begin());
    std::copy_n(problem.demand, cols_, left_col_.begin());
    std::fill_n(mean_col_.begin(), stride_, 0.0);
    for (int i = 0; i < rows_; ++i) {
        const double* costs = &cell(i, 0);
        const double share = problem.supply[i] / total;
        double mean = 0;
        for (int j = 0; j < cols_; ++j) {
            mean += problem.demand[j] * costs[j];
            mean_col_[index(j)] += share * costs[j];
        }
        mean_row_[index(i)] = mean / total;
    }

    for (int node = 0; node < nodes_; ++node) {
        std::fill_n(below(node), words_, Word{0});
        below(node)[node / kWordBits] |= Word{1} << (node % kWordBits);
    }
    for (int i = 0; i < rows_; ++i) alive_rows_[index(i)] = i;
    for (int j = 0; j < cols_; ++j) alive_cols_[index(j)] = j;
    int open_rows = rows_, open_cols = cols_;

    const auto find_best = [&](int i) {
        const double* costs = &cell(i, 0);
        double best = std::numeric_limits<double>::infinity();
        for (int a = 0; a < open_cols; ++a) {
            const int j = alive_cols_[index(a)];
            const double key = costs[j] - mean_col_[index(j)];
            if (key < best) {
                best = key;
                best_col_[index(i)] = a;
            }
        }
        best_key_[index(i)] = best - mean_row_[index(i)];
    };
    for (int i = 0; i < rows_; ++i) find_best(i);

    int closed = 0;
    const auto hang = [&](int child, int parent, double flow) {
        parent_[index(child)] = parent;
        flow_[index(child)] = flow;
        retired_[index(closed++)] = child;
        for (int w = 0; w < words_; ++w) below(parent)[w] |= below(child)[w];
    };

    while (open_rows + open_cols > 2) {
        int at_row = 0;
        for (int a = 1; a < open_rows; ++a) {
            if (best_key_[index(alive_rows_[index(a)])] < best_key_[index(alive_rows_[index(at_row)])]) at_row = a;
        }
        const int i = alive_rows_[index(at_row)];
        const int at_col = best_col_[index(i)];
        const int j = alive_cols_[index(at_col)];
        double& left_row = left_row_[index(i)];
        double& left_col = left_col_[index(j)];
        if (open_rows == 1 || (open_cols > 1 && left_col <= left_row)) {
            hang(rows_ + j, i, left_col);
            left_row -= left_col;
            const int last = --open_cols;
            alive_cols_[index(at_col)] = alive_cols_[index(last)];
            for (int a = 0; a < open_rows; ++a) {
                const int row = alive_rows_[index(a)];
                if (best_col_[index(row)] == at_col) {
                    find_best(row);
                } else if (best_col_[index(row)] == last) {
                    best_col_[index(row)] = at_col;
                }
            }
        } else {
            hang(i, rows_ + j, left_row);
            left_col -= left_row;
            alive_rows_[index(at_row)] = alive_rows_[index(--open_rows)];
        }
    }
    const int root = rows_ + alive_cols_[0];
    hang(alive_rows_[0], root, left_row_[index(alive_rows_[0])]);
    parent_[index(root)] = kRoot;
    flow_[index(root)] = 0;
}

double TransportSimplex::arc_cost(int node) const {
    const int parent = parent_[index(node)];
    const int row = std::min(node, parent);
    const int col = std::max(node, parent) - rows_;
    return cell_[index(row * stride_ + col)];
}

// From the tree alone: every node after its parent.
void TransportSimplex::compute_duals() {
    std::vector<int>& pending = retired_;
    const auto dual = [&](int node) -> double& { return node < rows_ ? u_[index(node)] : v_[index(node - rows_)]; };
    Word* known = below(nodes_);
    std::fill_n(known, words_, Word{0});
    const auto is_known = [&](int node) { return ((known[node / kWordBits] >> (node % kWordBits)) & 1U) != 0; };
    for (int node = 0; node < nodes_; ++node) {
        int depth = 0;
        int at = node;
        for (; at != kRoot && !is_known(at); at = parent_[index(at)]) pending[index(depth++)] = at;
        while (depth > 0) {
            const int next = pending[index(--depth)];
            const int parent = parent_[index(next)];
            dual(next) = parent == kRoot ? 0.0 : arc_cost(next) - dual(parent);
            known[next / kWordBits] |= Word{1} << (next % kWordBits);
        }
    }
    std::fill(v_.begin() + cols_, v_.begin() + stride_, 0.0);
}

// The cell with the least reduced cost (the first of equals), if it is below -tolerance.
bool TransportSimplex::price(int& enter_row, int& enter_col) {
    double best = -tolerance_;
    int best_row = -1;
    for (int i = 0; i < rows_; ++i) {
        const double* costs = &cell(i, 0);
        const double u = u_[index(i)];
        double lane[kVector];
        for (int k = 0; k < kVector; ++k) lane[k] = costs[k] - v_[index(k)];
        for (int j = kVector; j < stride_; j += kVector) {
            for (int k = 0; k < kVector; ++k) {
                const double slack = costs[j + k] - v_[index(j + k)];
                lane[k] = slack < lane[k] ? slack : lane[k];
            }
        }
        const double least = *std::min_element(lane, lane + kVector) - u;
        if (least < best) {
            best = least;
            best_row = i;
        }
    }
    if (best_row < 0) return false;
    const double* costs = &cell(best_row, 0);
    const double u = u_[index(best_row)];
    int j = 0;
    while (costs[j] - v_[index(j)] - u != best) ++j;
    enter_row = best_row;
    enter_col = j;
    return true;
}

void TransportSimplex::pivot(int enter_row, int enter_col) {
    const int p = enter_row;
    const int q = rows_ + enter_col;
    const double reduced = cell(enter_row, enter_col) - u_[index(enter_row)] - v_[index(enter_col)];

    int apex = p;
    while (!is_below(q, apex)) apex = parent_[index(apex)];

    // Mass circulates apex -> ... -> p -> q -> ... -> apex. An arc it runs against gives way: those of rows on p's side, of
    // columns on q's side. The last of the blocking ones leaves.
    double moved = std::numeric_limits<double>::infinity();
    int leave = kUnknown;
    bool on_q_side = false;
    for (int x = p; x != apex; x = parent_[index(x)]) {
        if (x < rows_ && flow_[index(x)] < moved) {
            moved = flow_[index(x)];
            leave = x;
        }
    }
    for (int x = q; x != apex; x = parent_[index(x)]) {
        if (x >= rows_ && flow_[index(x)] <= moved) {
            moved = flow_[index(x)];
            leave = x;
            on_q_side = true;
        }
    }
    for (int x = p; x != apex; x = parent_[index(x)]) flow_[index(x)] += x < rows_ ? -moved : moved;
    for (int x = q; x != apex; x = parent_[index(x)]) flow_[index(x)] += x >= rows_ ? -moved : moved;

    Word* subtree = below(nodes_);
    std::copy_n(below(leave), words_, subtree);
    const int stem = on_q_side ? q : p;
    const int hook = on_q_side ? p : q;
    for (int x = parent_[index(leave)]; x != apex; x = parent_[index(x)]) {
        for (int w = 0; w < words_; ++w) below(x)[w] &= ~subtree[w];
    }
    for (int x = hook; x != apex; x = parent_[index(x)]) {
        for (int w = 0; w < words_; ++w) below(x)[w] |= subtree[w];
    }

    // Turn the arcs from the stem up to the leaving one around.
    int child = hook;
    double carried = moved;
    Word previous[8] = {};  // what was below the node before, along the stem
    static_assert(sizeof(previous) * 8 >= 2 * 232 + 1);
    for (int x = stem;;) {
        const int above = parent_[index(x)];
        const double its_flow = flow_[index(x)];
        parent_[index(x)] = child;
        flow_[index(x)] = carried;
        for (int w = 0; w < words_; ++w) {
            const Word was = below(x)[w];
            below(x)[w] = subtree[w] & ~previous[w];
            previous[w] = was;
        }
        if (x == leave) break;
        carried = its_flow;
        child = x;
        x = above;
    }

    const double step = on_q_side ? -reduced : reduced;
    for (int w = 0; w < words_; ++w) {
        for (Word rest = subtree[w]; rest != 0; rest &= rest - 1) {
            const int node = w * kWordBits + __builtin_ctzll(rest);
            if (node < rows_) {
                u_[index(node)] += step;
            } else {
                v_[index(node - rows_)] -= step;
            }
        }
    }
}

double TransportSimplex::plan_cost() const {
    double sum = 0;
    for (int node = 0; node < nodes_; ++node) {
        if (parent_[index(node)] != kRoot && flow_[index(node)] != 0) sum += flow_[index(node)] * arc_cost(node);
    }
    return sum;
}

}  // namespace hord::algo
