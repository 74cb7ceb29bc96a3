// The transportation simplex: least-cost transport of integer masses from rows (sources) to columns (sinks).
//
// Starts from a plan (transport_start.h). Then the cell with the least reduced cost enters a strongly feasible spanning
// tree (transport_tree.h); with more than kRowsToPrice rows, the least of some of them. No tree repeats, so it ends;
// kPivotsPerNode limits the pivots in addition.
//
// Numbers. Masses are integers < 2^53 held in doubles, exact. Pivots are chosen with integer costs up to 2^27 whose low
// bits are tags (transport_cells.h). Duals, sums and differences of costs along the tree, are exact and limited to
// 2^29: reduced costs fit 31 bits. When no reduced cost is negative, every cell whose sign may be wrong by the rounding
// of integer costs around its cycle is computed again from double costs. It enters if it is below -tolerance = -2^-36
// of the largest cost; a sum of at most 450 costs is wrong by less than 2^-43 of it, so rounding alone never pivots.
// The accepted plan costs at most tolerance + rounding per unit of mass more than the optimum: < 1e-9 for costs up
// to 20. If duals leave their range, the solve starts again with costs of 2, 4, then 6 bits fewer, which no tree can
// exceed.
#pragma once

#include <cstdint>

#include "algo/simd/isa.h"
#include "common/opaque.h"

namespace hord::algo {

// One step of a plan: `flow` moves from row to column and uses up one of them (if tied, the column, unless it is the
// last).
struct TransportStep {
    double flow = 0;
    std::int16_t row = 0;
    std::int16_t column = 0;
    bool row_used_up = false;  // else the column
};

// Masses of rows and columns, positive integers with equal sums, and the bin of each.
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
    static constexpr double kTolerance = 0x1p-36;  // of the largest cost

    // `cost`: bins x bins costs, copied. A problem has at most `bins` rows and columns.
    TransportSimplex(const double* cost, int bins, double largest_cost, Isa isa);

    struct Outcome {
        double cost = 0;  // sum of mass times cost over the plan
        int pivots = 0;
        bool proven = true;
    };
    // `start`: rows + cols - 1 steps, the last of which uses up the last row; supply and demand are not read then.
    // nullptr: transport_start.h finds a plan. `proven` is false only at the pivot limit.
    Outcome solve(const Transport& problem, const TransportStep* start = nullptr);

  private:
    using Solve = Outcome (*)(TransportWorkspace& workspace, const Transport& problem, const TransportStep* start);
    common::Opaque<TransportWorkspace> workspace_;
    Solve solve_;
};

}  // namespace hord::algo
