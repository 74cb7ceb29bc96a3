// The transportation simplex: least-cost transport of integer masses from rows (sources) to columns (sinks).
//
// Start: the row with the cell of least reduced cost c_ij - R_i - K_j serves its columns in that order until it is used up, then the
// next row; R_i and K_j are the mass-weighted mean costs of a row and a column. Then pivots on a strongly feasible spanning tree
// (transport_tree.h), which ends: no tree ever comes twice. Pivots are bounded besides (kPivotsANode).
//
// Numbers. Masses are integers below 2^53 held in doubles, exact. Costs and dual variables are doubles. A cell enters
// when its reduced cost is below -tolerance, tolerance = 2^-36 * largest cost: above what rounding adds up to in dual
// variables (sums along the tree of magnitude <= 450 * largest cost, 2^-44 of the largest cost a pivot, computed afresh from the tree before the
// last check when more than 64 pivots changed them), so that rounding alone never makes a pivot. The accepted plan costs at most tolerance + rounding
// more a unit of mass than the optimum: < 1e-9 for costs up to 20.
// Candidates are found in single precision, a block of rows at a time; where none is left, a pass in double precision decides.
// The order of the start is an int32 a cell: its reduced cost in units of 2^-14 of the largest cost, above the cell's
// row and column (8 bits each, so at most 256 of either). While pricing, the 16 low bits of a reduced
// cost are replaced in the same way: an order again, 2^-7 of it.
#pragma once

#include <cstdint>
#include <memory>

#include "algo/isa.h"

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

// A step of a start: a row and a column exchange `flow`, which uses up one of them, the child. Nodes: rows, then columns.
struct TransportStep {
    double flow = 0;
    std::int32_t child = 0;
    std::int32_t parent = 0;
};

struct TransportWorkspace;

class TransportSimplex {
  public:
    static constexpr double kTolerance = 0x1p-36;  // of the largest cost: below it, a reduced cost is negative

    // `cost` is a table of bins x bins costs that outlives this object; a problem has at most `bins` rows and columns.
    TransportSimplex(const double* cost, int bins, double largest_cost, Isa isa);
    ~TransportSimplex();
    TransportSimplex(TransportSimplex&&) noexcept;
    TransportSimplex& operator=(TransportSimplex&&) noexcept;

    struct Outcome {
        double cost = 0;  // sum of mass times cost over the plan
        int pivots = 0;
        bool proven = true;
    };
    // `start`: rows + cols - 1 steps that use up one row or column each (of a tie the column, unless it is the last), the
    // last of them the last row; supply and demand are not read then. nullptr: it is found here.
    Outcome solve(const Transport& problem, const TransportStep* start = nullptr);

  private:
    using Solve = Outcome (*)(TransportWorkspace& workspace, const Transport& problem, const TransportStep* start);
    std::unique_ptr<TransportWorkspace> workspace_;
    Solve solve_;
};

}  // namespace hord::algo
