// The transportation simplex: least-cost transport of integer masses from rows (sources) to columns (sinks).
//
// Start: transport_start.h. Then the cell of least reduced cost (of more than 48 rows, in some of them) enters a
// strongly feasible spanning tree (transport_tree.h), which ends: no tree ever comes twice. Pivots are bounded besides
// (kPivotsANode).
//
// Numbers. Masses are integers below 2^53 held in doubles, exact. To choose pivots, costs are integers: the largest is
// 2^27, and the low bits of each, as many as are needed, are its row and column (its tag: 10 bits of 19 x 22 cells, at
// most 16). So dual variables, sums and differences of costs along the tree, are exact; they are kept within 2^29, so
// that no reduced cost leaves 31 bits. When no cell is below zero so, every cell that the rounding of costs around its
// cycle could hide is computed from the costs in double precision, and enters if it is below -tolerance, tolerance =
// 2^-36 * largest cost. A sum of at most 450 costs, it is wrong by less than 2^-43 of the largest: rounding alone never
// makes a pivot. The accepted plan costs at most tolerance + rounding more a unit of mass than the optimum: < 1e-9 for
// costs up to 20. Where dual variables leave their range (four times the largest cost), all begins again with costs of
// 2, then 4, then 6 bits fewer, which no tree can take out of it.
#pragma once

#include <cstdint>
#include <memory>

#include "algo/simd/isa.h"

namespace hord::algo {

// A row and a column exchange `flow`, which uses up one of them: of a tie the column, unless it is the last.
struct TransportStep {
    double flow = 0;
    std::int16_t row = 0;
    std::int16_t column = 0;
    bool row_used_up = false;  // else the column
};

// A problem: masses of rows and columns, all positive integers with equal sums, and the bin each belongs to.
struct Transport {
    int rows = 0;
    int cols = 0;
    const double* supply = nullptr;
    const double* demand = nullptr;
    const std::uint8_t* row_bin = nullptr;
    const std::uint8_t* col_bin = nullptr;
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
    // `start`: rows + cols - 1 steps that use up one row or column each (of a tie the column, unless it is the last),
    // the last of them the last row; supply and demand are not read then. nullptr: it is found here.
    Outcome solve(const Transport& problem, const TransportStep* start = nullptr);

  private:
    using Solve = Outcome (*)(TransportWorkspace& workspace, const Transport& problem, const TransportStep* start);
    std::unique_ptr<TransportWorkspace> workspace_;
    Solve solve_;
};

}  // namespace hord::algo
