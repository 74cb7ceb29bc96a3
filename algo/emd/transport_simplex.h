// The transportation simplex: least-cost transport of integer masses from rows (sources) to columns (sinks).
//
// Masses are integers < 2^53 held in doubles, exact. A plan is accepted if no reduced cost is below -kTolerance of
// the largest cost; it costs less than 1e-9 per unit of mass more than the optimum, for costs up to 20.
// How the cells are priced, and why it ends: docs/notes/emd.md.
#pragma once

#include <array>
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
    // The same bits as one after the other, in less time: the steps of their starting plans are made in turns.
    std::array<Outcome, 2> solve_two(const std::array<Transport, 2>& problems);

  private:
    using Solve = void (*)(TransportWorkspace& workspace, const Transport* problem, int problems,
                           const TransportStep* start, Outcome* outcome);
    common::Opaque<TransportWorkspace> workspace_;
    Solve solve_;
};

}  // namespace hord::algo
