// The transportation simplex: least-cost transport of integer masses from rows (sources) to columns (sinks).
//
// Start: cells in order of least reduced cost c_ij - R_i - K_j, with R_i and K_j the mass-weighted mean cost of a
// row and a column. Then pivots on a strongly feasible spanning tree (Cunningham 1976): a tree arc that
// carries nothing always points to the root, the leaving arc is the last blocking one along the cycle from its apex,
// and so no tree ever comes twice: it ends. Pivots are bounded besides (kPivotsANode).
//
// Numbers. Masses are integers below 2^53 held in doubles, exact. Costs and dual variables are doubles. A cell enters
// when its reduced cost is below -tolerance, tolerance = 2^-36 * largest cost: above what rounding adds up to in dual
// variables (sums along the tree of magnitude <= 450 * largest cost, computed afresh from the tree before the last check
// when more than 16 pivots changed them), so that rounding alone never makes a pivot. The accepted plan costs at most tolerance + rounding
// more a unit of mass than the optimum: < 1e-9 for costs up to 20.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/transport_scans.h"

namespace hord::algo {

// A problem: masses of rows and columns, all positive integers with equal sums, and the bin each belongs to.
struct Transport {
    int rows = 0;
    int cols = 0;
    const double* supply = nullptr;
    const double* demand = nullptr;
    const std::uint8_t* row_bin = nullptr;
    const std::uint8_t* col_bin = nullptr;
};

class TransportSimplex {
  public:
    static constexpr double kTolerance = 0x1p-36;  // of the largest cost: below it, a reduced cost is negative

    // `cost` is a table of bins x bins costs that outlives this object; a problem has at most `bins` rows and columns.
    TransportSimplex(const double* cost, int bins, double largest_cost, Isa isa);

    struct Outcome {
        double cost = 0;  // sum of mass times cost over the plan
        int pivots = 0;
        bool proven = true;
    };
    Outcome solve(const Transport& problem);

  private:
    static constexpr int kPivotsANode = 200;
    static constexpr int kPivotsBetweenDuals = 16;
    static constexpr int kRowsAtOnce = 8;  // priced before the best of them enters
    static constexpr int kWordBits = 64;
    using Word = std::uint64_t;

    void order_cells(const Transport& problem);
    void start(const Transport& problem);
    void hang(int child, int parent, double flow);
    void compute_duals();
    bool price(int& enter_row, int& enter_col);
    void pivot(int enter_row, int enter_col);
    [[nodiscard]] double plan_cost() const;

    [[nodiscard]] double& cell(int row, int col) { return cell_[static_cast<std::size_t>(row * stride_ + col)]; }
    [[nodiscard]] double arc_cost(int node) const;
    [[nodiscard]] Word* below(int node) { return below_.data() + static_cast<std::ptrdiff_t>(node * words_); }
    [[nodiscard]] bool is_below(int node, int ancestor) {
        return ((below(ancestor)[node / kWordBits] >> (node % kWordBits)) & 1U) != 0;
    }

    const double* table_;
    int bins_;
    double tolerance_;

    // The problem at hand. Nodes 0..rows-1 are rows, rows..rows+cols-1 columns.
    int rows_ = 0, cols_ = 0, nodes_ = 0;
    int stride_ = 0;  // columns, rounded up to whole vectors; the padding never prices
    int words_ = 0;   // of a set of nodes
    int next_row_ = 0;
    std::vector<double> cell_;  // rows x stride costs
    std::vector<double> u_, v_;  // dual variables; c_ij = u_i + v_j on the tree
    std::vector<double> flow_;  // on the arc to the parent
    std::vector<int> parent_, hung_in_order_;
    std::vector<Word> below_;  // nodes in the subtree of a node, itself included
    std::vector<int> pending_;
    std::vector<double> key_, best_of_row_, shut_row_, shut_col_;  // the order of the start
    std::vector<double> demand_, left_row_, left_col_, mean_col_;
    int hung_ = 0;
    TransportScans scan_;
};

}  // namespace hord::algo
