#include "algo/emd/emd_solver.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

#include "algo/emd/knapsack_batch.h"
#include "algo/emd/residual.h"
#include "algo/emd/sparse_hord.h"
#include "algo/emd/transport_cells.h"
#include "algo/emd/transport_lanes.h"
#include "algo/emd/transport_simplex.h"
#include "common/fixed.h"

namespace hord::algo {
namespace {

std::size_t index(int k) { return static_cast<std::size_t>(k); }

template <class Mass>
double total(const ResidualSide<Mass>& side) {
    double sum = 0;
    for (int k = 0; k < side.count; ++k) sum += static_cast<double>(side.mass[index(k)]);
    return sum;
}

// The residual and the batches of problems with one type of masses.
template <class Mass>
struct MassSolver {
    MassSolver(FindResidual<Mass> find_it, Isa isa)
        : find(find_it), solve(transport_kernel<Mass>(isa)), pivot(lanes_kernel<Mass>(isa)) {}

    FindResidual<Mass> find;
    Residual<Mass> residual;
    SolveTransportBatch<Mass> solve;
    PivotLanes<Mass> pivot;
    TransportAnswer<Mass> answer;
    TransportBatches<Mass> batches;
};
using Int32Masses = MassSolver<std::int32_t>;  // S_a * S_b < kInt32MassLimit
using DoubleMasses = MassSolver<double>;

// Surplus and deficit have the same mass, at most the denominator.
bool adds_up(const SparseDifference& difference) {
    std::int64_t surplus = 0, deficit = 0;
    for (const std::int32_t d : difference.excess) (d > 0 ? surplus : deficit) += d;
    return surplus == -deficit && surplus <= difference.denominator;
}

// Copies the full capacity: a constant size compiles to vector moves.
template <class Mass>
void put(const ResidualSide<Mass>& side, Mass* to_mass, std::uint8_t* to_bin) {
    std::memcpy(to_mass, side.mass.data(), kMaxBatchSide * sizeof(Mass));
    std::memcpy(to_bin, side.bin.data(), kMaxBatchSide);
}

}  // namespace

// A problem for the simplex: a copy, so that it can wait for another one.
struct WaitingProblem {
    int rows = 0, cols = 0;
    std::array<double, kMaxBinCount> supply, demand;
    std::array<std::uint8_t, kMaxBinCount> row_bin, col_bin;
    double mass = 0;  // S_a * S_b
    double* out = nullptr;

    template <class Mass>
    void copy(const ResidualSide<Mass>& row_side, const ResidualSide<Mass>& col_side) {
        rows = row_side.count;
        cols = col_side.count;
        std::copy_n(row_side.mass.begin(), rows, supply.begin());
        std::copy_n(col_side.mass.begin(), cols, demand.begin());
        std::copy_n(row_side.bin.begin(), rows, row_bin.begin());
        std::copy_n(col_side.bin.begin(), cols, col_bin.begin());
    }
    [[nodiscard]] Transport transport() const {
        return {rows, cols, supply.data(), demand.data(), row_bin.data(), col_bin.data()};
    }
};

struct EmdSolver::State {
    State(const GroundDistance& g, Isa isa)
        : ground(g),
          simplex(ground.row(0), ground.bins(), ground.largest(), isa), costs{ground.row(0), ground.bins(),
                                                                              ground.largest() *
                                                                                  TransportSimplex::kTolerance},
          sparse(sparse_kernels(ground.is_metric() ? widest(isa) : Isa::portable)),
          int32_masses(find_residual_for(widest(isa)), widest(isa)), double_masses(find_residual<double>, widest(isa)),
          solve_knapsack(knapsack_kernel(widest(isa))) {}

    // For kernels that are vectors throughout, or have an instruction of the widest set.
    static Isa widest(Isa isa) { return isa == Isa::portable ? isa : widest_isa(); }

    void submit(const Hord& a, const Hord& b, double* out, bool at_once);
    void submit(const SparseHord& a, const SparseHord& b, double* out);
    void finish();
    template <class Mass>
    void submit_as(MassSolver<Mass>& masses, const Hord& a, const Hord& b, double mass, double* out, bool at_once);
    void submit_difference(const SparseDifference& difference);
    void solve_knapsack_batch();
    template <class Mass>
    double from_one(const ResidualSide<Mass>& one, const ResidualSide<Mass>& others) const;
    template <class Mass>
    void solve_batch(MassSolver<Mass>& masses, std::size_t shape);
    template <class Mass>
    double improve(const TransportBatch<Mass>& batch, const TransportAnswer<Mass>& answer, int lane);
    template <class Mass>
    void pivot_unproven(MassSolver<Mass>& masses, const TransportBatch<Mass>& batch);
    void solve_waiting();
    double cost_of(const TransportSimplex::Outcome& outcome);

    GroundDistance ground;
    TransportSimplex simplex;
    TransportBatchCosts costs;
    SparseKernels sparse;  // portable (none) if the ground is no metric: they cancel shared mass
    Int32Masses int32_masses;
    DoubleMasses double_masses;
    SolveKnapsackBatch solve_knapsack;
    KnapsackBatch knapsacks;
    std::array<WaitingProblem, 2> waiting;  // for the simplex, which solves two together
    std::size_t waiting_count = 0;
    Counters counters;
};

void EmdSolver::State::submit(const Hord& a, const Hord& b, double* out, bool at_once) {
    ++counters.pairs;
    expect_no_overflow(a.sum < kSumLimit && b.sum < kSumLimit);
    *out = 0;
    if (a.sum == 0 || b.sum == 0) return;
    const double mass = static_cast<double>(a.sum) * static_cast<double>(b.sum);
    if (mass < kInt32MassLimit) {
        submit_as(int32_masses, a, b, mass, out, at_once);
    } else {
        submit_as(double_masses, a, b, mass, out, at_once);
    }
}

// `mass`: S_a * S_b, the mass of a side before cancelling.
template <class Mass>
void EmdSolver::State::submit_as(MassSolver<Mass>& masses, const Hord& a, const Hord& b, double mass, double* out,
                                 bool at_once) {
    Residual<Mass>& residual = masses.residual;
    if (ground.is_metric()) {
        masses.find(a, b, ground.bins(), residual);
    } else {
        keep_shared(a, b, ground.bins(), residual);
    }
    expect_no_overflow(total(residual.side[0]) == total(residual.side[1]) && total(residual.side[0]) <= mass);
    if (residual.side[0].count == 0) return;  // nothing has to move
    const std::size_t of_rows = residual.rows();
    const ResidualSide<Mass>&rows = residual.side[of_rows], &cols = residual.side[1 - of_rows];
    if (rows.count == 1) {
        *out = from_one(rows, cols) / mass;
    } else if (cols.count > kMaxBatchSide) {
        WaitingProblem& problem = waiting[waiting_count++];
        problem.copy(rows, cols);
        problem.mass = mass;
        problem.out = out;
        if (at_once || waiting_count == waiting.size()) solve_waiting();
    } else {
        const std::size_t shape = masses.batches.shape(rows.count, cols.count);
        BatchedProblem<Mass>& problem = masses.batches.add(shape);
        put(rows, problem.mass[0], problem.bin[0]);
        put(cols, problem.mass[1], problem.bin[1]);
        problem.out = out;
        *out = mass;  // the divisor, until solve_batch() replaces it by the distance: the problem has no room for it
        if (at_once || masses.batches.filled[shape] == kBatchLanes) solve_batch(masses, shape);
    }
}

void EmdSolver::State::submit(const SparseHord& a, const SparseHord& b, double* out) {
    SparseDifference& next = knapsacks.difference[knapsacks.filled];
    const int bins = sparse.subtract(a, b, next);
    if (bins == 0) return submit(a.hord(), b.hord(), out, false);
    expect_no_overflow(a.sum < kSumLimit && b.sum < kSumLimit && adds_up(next));
    ++counters.pairs;
    next.out = out;
    if (bins > kMaxKnapsackBins) return submit_difference(next);
    if (++knapsacks.filled == kBatchLanes) solve_knapsack_batch();
}

// Adds the difference to a transport batch.
void EmdSolver::State::submit_difference(const SparseDifference& difference) {
    const std::size_t shape = sparse.put(difference, int32_masses.batches);
    if (shape != 0 && int32_masses.batches.filled[shape] == kBatchLanes) solve_batch(int32_masses, shape);
}

void EmdSolver::State::solve_knapsack_batch() {
    KnapsackAnswer answer;
    solve_knapsack(knapsacks, costs, answer);
    for (int lane = 0; lane < knapsacks.filled; ++lane) *knapsacks.difference[lane].out = answer.distance[lane];
    counters.knapsack += static_cast<std::uint64_t>(knapsacks.filled);
    for (std::uint32_t rest = ~answer.proven & ((1U << knapsacks.filled) - 1); rest != 0; rest &= rest - 1) {
        --counters.knapsack;
        submit_difference(knapsacks.difference[__builtin_ctz(rest)]);
    }
    knapsacks.filled = 0;
}

// The cost of a problem with one row: all its mass moves between that bin and the columns.
template <class Mass>
double EmdSolver::State::from_one(const ResidualSide<Mass>& one, const ResidualSide<Mass>& others) const {
    const double* cost = ground.row(one.bin[0]);
    double sum = 0;
    for (int j = 0; j < others.count; ++j)
        sum += static_cast<double>(others.mass[index(j)]) * cost[others.bin[index(j)]];
    return sum;
}

template <class Mass>
void EmdSolver::State::solve_batch(MassSolver<Mass>& masses, std::size_t shape) {
    const TransportBatch<Mass>& batch = masses.batches.padded(shape);
    TransportAnswer<Mass>& answer = masses.answer;
    counters.transport += static_cast<std::uint64_t>(batch.filled);
    masses.solve(batch, costs, answer);
    pivot_unproven(masses, batch);
    for (int lane = 0; lane < batch.filled; ++lane) {
        double& out = *batch.problem[lane].out;  // still the divisor S_a * S_b
        out = (answer.proven[lane] ? answer.cost[lane] : improve(batch, answer, lane)) / out;
    }
}

// Many unproven lanes are solved together.
template <class Mass>
void EmdSolver::State::pivot_unproven(MassSolver<Mass>& masses, const TransportBatch<Mass>& batch) {
    TransportAnswer<Mass>& answer = masses.answer;
    std::uint32_t unproven = 0;
    for (int lane = 0; lane < batch.filled; ++lane) unproven |= (answer.proven[lane] ? 0U : 1U) << lane;
    if (std::popcount(unproven) < kFewestLanes) return;
    LaneOutcome outcome;
    const double scale = TransportCosts::kMaxCost / ground.largest();
    masses.pivot(answer, batch.rows, batch.cols, unproven, scale, costs.tolerance, outcome);
    for (std::uint32_t rest = outcome.solved; rest != 0; rest &= rest - 1) {
        const int lane = std::countr_zero(rest);
        answer.cost[lane] = cost_of({outcome.cost[lane], outcome.pivots[lane]});
        answer.proven[lane] = true;
    }
}

// Continues with the simplex from the plan of one lane.
template <class Mass>
double EmdSolver::State::improve(const TransportBatch<Mass>& batch, const TransportAnswer<Mass>& answer, int lane) {
    std::array<TransportStep, kMaxBatchSteps> steps;
    for (int step = 0; step < batch.rows + batch.cols - 1; ++step) {
        const std::int32_t child = answer.child[step][lane], parent = answer.parent[step][lane];
        steps[index(step)] = {static_cast<double>(answer.flow[step][lane]),
                              static_cast<std::int16_t>(std::min(child, parent)),
                              static_cast<std::int16_t>(std::max(child, parent) - kFirstColumnNode), child < parent};
    }
    const auto& [row_bin, col_bin] = batch.problem[lane].bin;
    return cost_of(simplex.solve({batch.rows, batch.cols, nullptr, nullptr, row_bin, col_bin}, steps.data()));
}

// One or two problems.
void EmdSolver::State::solve_waiting() {
    if (waiting_count == 2) {
        const auto outcomes = simplex.solve_two({waiting[0].transport(), waiting[1].transport()});
        for (std::size_t k = 0; k < 2; ++k) *waiting[k].out = cost_of(outcomes[k]) / waiting[k].mass;
    } else {
        *waiting[0].out = cost_of(simplex.solve(waiting[0].transport())) / waiting[0].mass;
    }
    waiting_count = 0;
}

double EmdSolver::State::cost_of(const TransportSimplex::Outcome& outcome) {
    ++counters.simplex;
    counters.pivots += static_cast<std::uint64_t>(outcome.pivots);
    counters.unproven += outcome.proven ? 0U : 1U;
    return outcome.cost;
}

void EmdSolver::State::finish() {
    const auto solve_rest = [this](auto& masses) {
        for (std::size_t shape = 0; shape < masses.batches.kShapes; ++shape) {
            if (masses.batches.filled[shape] > 0) solve_batch(masses, shape);
        }
    };
    if (knapsacks.filled > 0) solve_knapsack_batch();
    if (waiting_count > 0) solve_waiting();
    solve_rest(int32_masses);
    solve_rest(double_masses);
}

Result<EmdSolver> EmdSolver::create(const GroundDistance& ground, Isa isa) {
    if (!has(isa))
        return fail(ErrorCode::unsupported, "an instruction set that this processor does not have", "use best_isa()");
    return EmdSolver(common::make_opaque<State>(ground, isa));
}

double EmdSolver::distance(const Hord& a, const Hord& b) {
    double answer = 0;
    state_->submit(a, b, &answer, true);
    return answer;
}

void EmdSolver::submit(const Hord& a, const Hord& b, double* out) { state_->submit(a, b, out, false); }
void EmdSolver::submit(const SparseHord& a, const SparseHord& b, double* out) { state_->submit(a, b, out); }
CompactFunction EmdSolver::compact() const { return state_->sparse.compact; }
void EmdSolver::finish() { state_->finish(); }

const EmdSolver::Counters& EmdSolver::counters() const { return state_->counters; }

}  // namespace hord::algo
