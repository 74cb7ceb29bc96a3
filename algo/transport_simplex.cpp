#include "algo/transport_simplex.h"

#include <algorithm>
#include <bit>
#include <limits>

namespace hord::algo {
namespace {

constexpr int kRoot = -1;
constexpr int kUnknown = -2;
constexpr double kClosed = std::numeric_limits<double>::infinity();

std::size_t index(int k) { return static_cast<std::size_t>(k); }

int padded(int count) { return (count + kScanLanes - 1) / kScanLanes * kScanLanes; }

}  // namespace

TransportSimplex::TransportSimplex(const double* cost, int bins, double largest_cost, Isa isa)
    : table_(cost), bins_(bins), tolerance_(largest_cost * kTolerance), scan_(transport_scans(isa)) {
    const auto side = index(padded(bins));
    const auto nodes = 2 * side;
    for (auto* cells : {&cell_, &key_}) cells->resize(side * side);
    for (auto* values : {&u_, &v_, &best_of_row_, &shut_row_, &shut_col_, &demand_, &left_row_, &left_col_, &mean_col_}) values->resize(side);
    flow_.resize(nodes);
    for (auto* list : {&parent_, &hung_in_order_, &pending_}) list->resize(nodes);
    below_.resize((nodes + 1) * (nodes / kWordBits + 1));  // one more: a copy of the subtree that moves
}

TransportSimplex::Outcome TransportSimplex::solve(const Transport& problem) {
    rows_ = problem.rows;
    cols_ = problem.cols;
    nodes_ = rows_ + cols_;
    words_ = nodes_ / kWordBits + 1;
    stride_ = padded(cols_);
    order_cells(problem);
    start(problem);

    Outcome outcome;
    int since_duals = 0;
    int row = 0, col = 0;
    for (;;) {
        if (price(row, col)) {
            if (outcome.pivots == kPivotsANode * nodes_) {
                outcome.proven = false;
                break;
            }
            pivot(row, col);
            ++outcome.pivots;
            ++since_duals;
        } else if (since_duals > kPivotsBetweenDuals) {  // what the pivots added up to in rounding is taken out before the last check
            compute_duals();
            since_duals = 0;
        } else {
            break;
        }
    }
    outcome.cost = plan_cost();
    return outcome;
}

// Costs of the problem's cells, and the key that says when each is served: c_ij - R_i - K_j.
void TransportSimplex::order_cells(const Transport& problem) {
    double total = 0;
    for (int i = 0; i < rows_; ++i) total += problem.supply[i];
    std::copy_n(problem.demand, cols_, demand_.begin());
    std::fill(demand_.begin() + cols_, demand_.begin() + stride_, 0.0);
    std::fill_n(mean_col_.begin(), stride_, 0.0);
    for (int i = 0; i < rows_; ++i) {
        u_[index(i)] = scan_.gather(table_ + static_cast<std::ptrdiff_t>(problem.row_bin[i]) * bins_, problem.col_bin, cols_, stride_,
                                    demand_.data(), problem.supply[i] / total, &cell(i, 0), mean_col_.data()) / total;
    }
    for (int i = 0; i < rows_; ++i) {
        scan_.keys(&cell(i, 0), mean_col_.data(), u_[index(i)], i, stride_, key_.data() + static_cast<std::ptrdiff_t>(i * stride_));
    }
}

// Builds a plan and its tree: the open cell of least key takes all it can, and its row or its column, whichever is used up,
// is closed and hangs from the other. Where both are used up the column is closed: the row stays open with nothing
// left and closes later below some column, so that arcs which carry nothing point to the root.
void TransportSimplex::start(const Transport& problem) {
    std::copy_n(problem.supply, rows_, left_row_.begin());
    std::copy_n(problem.demand, cols_, left_col_.begin());
    for (int node = 0; node < nodes_; ++node) {
        std::fill_n(below(node), words_, Word{0});
        below(node)[node / kWordBits] |= Word{1} << (node % kWordBits);
    }
    std::fill(shut_col_.begin(), shut_col_.begin() + cols_, 0.0);
    std::fill(shut_col_.begin() + cols_, shut_col_.begin() + stride_, kClosed);
    std::fill(shut_row_.begin(), shut_row_.begin() + padded(rows_), 0.0);
    std::fill(best_of_row_.begin(), best_of_row_.begin() + padded(rows_), kClosed);
    const auto best_in = [&](int i) {
        return scan_.least(key_.data() + static_cast<std::ptrdiff_t>(i * stride_), shut_col_.data(), stride_);
    };
    for (int i = 0; i < rows_; ++i) best_of_row_[index(i)] = best_in(i);

    hung_ = 0;
    int open_rows = rows_, open_cols = cols_;
    while (open_rows + open_cols > 2) {
        const auto bits = std::bit_cast<std::uint64_t>(scan_.least(best_of_row_.data(), shut_row_.data(), padded(rows_)));
        const auto i = static_cast<int>(bits >> 8 & 0xFF);
        const auto j = static_cast<int>(bits & 0xFF);
        if (shut_col_[index(j)] != 0) {  // its best column has closed since
            best_of_row_[index(i)] = best_in(i);
            continue;
        }
        double& left_row = left_row_[index(i)];
        double& left_col = left_col_[index(j)];
        if (open_rows == 1 || (open_cols > 1 && left_col <= left_row)) {
            hang(rows_ + j, i, left_col);
            left_row -= left_col;
            shut_col_[index(j)] = kClosed;
            --open_cols;
        } else {
            hang(i, rows_ + j, left_row);
            left_col -= left_row;
            shut_row_[index(i)] = kClosed;
            --open_rows;
        }
    }
    const auto last_row = static_cast<int>(std::find(shut_row_.begin(), shut_row_.end(), 0.0) - shut_row_.begin());
    const auto last_col = static_cast<int>(std::find(shut_col_.begin(), shut_col_.end(), 0.0) - shut_col_.begin());
    const int root = rows_ + last_col;
    hang(last_row, root, left_row_[index(last_row)]);
    parent_[index(root)] = kRoot;
    flow_[index(root)] = 0;

    std::fill_n(v_.begin(), stride_, 0.0);
    while (hung_ > 0) {
        const int node = hung_in_order_[index(--hung_)];
        const int parent = parent_[index(node)];
        if (node < rows_) {
            u_[index(node)] = cell(node, parent - rows_) - v_[index(parent - rows_)];
        } else {
            v_[index(node - rows_)] = cell(parent, node - rows_) - u_[index(parent)];
        }
    }
    next_row_ = 0;
}

void TransportSimplex::hang(int child, int parent, double flow) {
    parent_[index(child)] = parent;
    flow_[index(child)] = flow;
    hung_in_order_[index(hung_++)] = child;
    for (int w = 0; w < words_; ++w) below(parent)[w] |= below(child)[w];
}

double TransportSimplex::arc_cost(int node) const {
    const int parent = parent_[index(node)];
    const int row = std::min(node, parent);
    const int col = std::max(node, parent) - rows_;
    return cell_[index(row * stride_ + col)];
}

// From the tree alone: every node after its parent.
void TransportSimplex::compute_duals() {
    std::vector<int>& pending = pending_;
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

// A cell that lowers the cost: the best in the next block of rows that holds one.
bool TransportSimplex::price(int& enter_row, int& enter_col) {
    for (int seen = 0; seen < rows_;) {
        const int first = next_row_;
        const int last = std::min(first + kRowsAtOnce, rows_);
        seen += last - first;
        next_row_ = last == rows_ ? 0 : last;
        const double least = scan_.least_reduced(cell_.data(), u_.data(), v_.data(), first, last, stride_, &enter_row);
        if (least < -tolerance_) {
            const double* costs = &cell(enter_row, 0);
            const double u = u_[index(enter_row)];
            enter_col = 0;
            while (costs[enter_col] - v_[index(enter_col)] - u != least) ++enter_col;
            return true;
        }
    }
    return false;
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
