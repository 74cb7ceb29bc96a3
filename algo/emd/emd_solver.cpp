#include "algo/emd/emd_solver.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "algo/emd/knapsack_batch.h"
#include "algo/emd/residual.h"
#include "algo/emd/sparse_hord.h"
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

// Problems whose masses have one format: what is found of a pair, and the small ones.
template <class Mass>
struct Format {
    Format(FindResidual<Mass> find_it, Isa isa) : find(find_it), solve(transport_kernel<Mass>(isa)) {}

    FindResidual<Mass> find;
    Residual<Mass> residual;
    SolveSmall<Mass> solve;
    TransportAnswer<Mass> answer;
    TransportBatches<Mass> small;
};

// What one has too much is what the other has too little, and no more than there is.
bool adds_up(const ClosedDifference& difference) {
    std::int64_t more = 0, less = 0;
    for (const std::int32_t d : difference.more) (d > 0 ? more : less) += d;
    return more == -less && more <= difference.denominator;
}

// As many as there may be: a count that is known is faster than the right one.
template <class Mass>
void put(const ResidualSide<Mass>& side, Mass* to_mass, std::uint8_t* to_bin) {
    std::memcpy(to_mass, side.mass.data(), kMaxBatchSide * sizeof(Mass));
    std::memcpy(to_bin, side.bin.data(), kMaxBatchSide);
}

}  // namespace

struct EmdSolver::State {
    State(const GroundDistance& g, Isa isa)
        : ground(g),
          simplex(ground.row(0), ground.bins(), ground.largest(), isa), costs{ground.row(0), ground.bins(),
                                                                              ground.largest() *
                                                                                  TransportSimplex::kTolerance},
          closed(sparse_kernels(ground.is_metric() ? widest(isa) : Isa::portable)),
          light(find_residual_for(widest(isa)), isa), heavy(find_residual<double>, isa),
          solve_knapsack_of(knapsack_kernel(isa)) {}

    // For what a wider instruction set has an instruction for.
    static Isa widest(Isa isa) { return isa == Isa::portable ? isa : widest_isa(); }

    void submit(const Hord& a, const Hord& b, double* out, bool at_once);
    void submit(const SparseHord& a, const SparseHord& b, double* out);
    void finish();
    template <class Mass>
    void submit_as(Format<Mass>& format, const Hord& a, const Hord& b, double mass, double* out, bool at_once);
    void submit_difference(const ClosedDifference& difference);
    void solve_knapsack_batch();
    template <class Mass>
    double from_one(const ResidualSide<Mass>& one, const ResidualSide<Mass>& others) const;
    template <class Mass>
    void solve_batch(Format<Mass>& format, std::size_t shape);
    template <class Mass>
    double improve(const TransportBatch<Mass>& batch, const TransportAnswer<Mass>& answer, int lane);
    template <class Mass>
    double by_simplex(const ResidualSide<Mass>& rows, const ResidualSide<Mass>& cols);
    double by_simplex(const Transport& problem, const TransportStep* start);

    GroundDistance ground;
    TransportSimplex simplex;
    TransportBatchCosts costs;
    SparseKernels closed;  // of a metric: what both share must not be cancelled where it may have to move
    Format<std::int32_t> light;
    Format<double> heavy;
    SolveFew solve_knapsack_of;
    KnapsackBatch few;
    Work work;
};

void EmdSolver::State::submit(const Hord& a, const Hord& b, double* out, bool at_once) {
    ++work.pairs;
    expect_no_overflow(a.sum < kSumLimit && b.sum < kSumLimit);
    *out = 0;
    if (a.sum == 0 || b.sum == 0) return;
    const double mass = static_cast<double>(a.sum) * static_cast<double>(b.sum);
    if (mass < kLightMass) {
        submit_as(light, a, b, mass, out, at_once);
    } else {
        submit_as(heavy, a, b, mass, out, at_once);
    }
}

// `mass`: what either side has in all, the shared mass included.
template <class Mass>
void EmdSolver::State::submit_as(Format<Mass>& format, const Hord& a, const Hord& b, double mass, double* out,
                                 bool at_once) {
    Residual<Mass>& residual = format.residual;
    if (ground.is_metric()) {
        format.find(a, b, ground.bins(), residual);
    } else {
        keep_all(a, b, ground.bins(), residual);
    }
    expect_no_overflow(total(residual.side[0]) == total(residual.side[1]) && total(residual.side[0]) <= mass);
    if (residual.side[0].count == 0) return;  // nothing has to move
    const std::size_t of_rows = residual.rows();
    const ResidualSide<Mass>&rows = residual.side[of_rows], &cols = residual.side[1 - of_rows];
    if (rows.count == 1) {
        *out = from_one(rows, cols) / mass;
    } else if (cols.count > kMaxBatchSide) {
        *out = by_simplex(rows, cols) / mass;
    } else {
        const std::size_t shape = format.small.shape(rows.count, cols.count);
        SmallProblem<Mass>& problem = format.small.add(shape);
        put(rows, problem.mass[0], problem.bin[0]);
        put(cols, problem.mass[1], problem.bin[1]);
        problem.out = out;
        *out = mass;  // until it is solved
        if (at_once || format.small.filled[shape] == kWide) solve_batch(format, shape);
    }
}

void EmdSolver::State::submit(const SparseHord& a, const SparseHord& b, double* out) {
    ClosedDifference& next = few.difference[few.filled];
    const int bins = closed.subtract(a, b, next);
    if (bins == 0) return submit(a.hord(), b.hord(), out, false);
    expect_no_overflow(a.sum < kSumLimit && b.sum < kSumLimit && adds_up(next));
    ++work.pairs;
    next.out = out;
    if (bins > kMaxKnapsackBins) return submit_difference(next);
    if (++few.filled == kWide) solve_knapsack_batch();
}

// As one of the small problems.
void EmdSolver::State::submit_difference(const ClosedDifference& difference) {
    const std::size_t shape = closed.put(difference, light.small);
    if (shape != 0 && light.small.filled[shape] == kWide) solve_batch(light, shape);
}

void EmdSolver::State::solve_knapsack_batch() {
    KnapsackAnswer answer;
    solve_knapsack_of(few, costs, answer);
    for (int lane = 0; lane < few.filled; ++lane) *few.difference[lane].out = answer.distance[lane];
    work.few += static_cast<std::uint64_t>(few.filled);
    for (std::uint32_t rest = ~answer.proven & ((1U << few.filled) - 1); rest != 0; rest &= rest - 1) {
        --work.few;
        submit_difference(few.difference[__builtin_ctz(rest)]);
    }
    few.filled = 0;
}

// All that the one bin has goes to, or comes from, the others.
template <class Mass>
double EmdSolver::State::from_one(const ResidualSide<Mass>& one, const ResidualSide<Mass>& others) const {
    const double* cost = ground.row(one.bin[0]);
    double sum = 0;
    for (int j = 0; j < others.count; ++j)
        sum += static_cast<double>(others.mass[index(j)]) * cost[others.bin[index(j)]];
    return sum;
}

template <class Mass>
void EmdSolver::State::solve_batch(Format<Mass>& format, std::size_t shape) {
    const TransportBatch<Mass>& batch = format.small.take(shape);
    TransportAnswer<Mass>& answer = format.answer;
    work.small += static_cast<std::uint64_t>(batch.filled);
    format.solve(batch, costs, answer);
    for (int lane = 0; lane < batch.filled; ++lane) {
        double& out = *batch.problem[lane].out;
        out = (answer.proven[lane] ? answer.cost[lane] : improve(batch, answer, lane)) / out;
    }
}

// From the plan of a lane on.
template <class Mass>
double EmdSolver::State::improve(const TransportBatch<Mass>& batch, const TransportAnswer<Mass>& answer, int lane) {
    std::array<TransportStep, kMaxBatchSteps> steps;
    for (int step = 0; step < batch.rows + batch.cols - 1; ++step) {
        const std::int32_t child = answer.child[step][lane], parent = answer.parent[step][lane];
        steps[index(step)] = {static_cast<double>(answer.flow[step][lane]),
                              static_cast<std::int16_t>(std::min(child, parent)),
                              static_cast<std::int16_t>(std::max(child, parent) - kFirstSmallColumn), child < parent};
    }
    const auto& [row_bin, col_bin] = batch.problem[lane].bin;
    return by_simplex({batch.rows, batch.cols, nullptr, nullptr, row_bin, col_bin}, steps.data());
}

template <class Mass>
double EmdSolver::State::by_simplex(const ResidualSide<Mass>& rows, const ResidualSide<Mass>& cols) {
    std::array<double, kMaxBinCount> supply, demand;
    std::copy_n(rows.mass.begin(), rows.count, supply.begin());
    std::copy_n(cols.mass.begin(), cols.count, demand.begin());
    return by_simplex({rows.count, cols.count, supply.data(), demand.data(), rows.bin.data(), cols.bin.data()},
                      nullptr);
}

double EmdSolver::State::by_simplex(const Transport& problem, const TransportStep* start) {
    const auto outcome = simplex.solve(problem, start);
    ++work.simplex;
    work.pivots += static_cast<std::uint64_t>(outcome.pivots);
    work.unproven += outcome.proven ? 0U : 1U;
    return outcome.cost;
}

void EmdSolver::State::finish() {
    const auto solve_rest = [this](auto& format) {
        for (std::size_t shape = 0; shape < format.small.kShapes; ++shape) {
            if (format.small.filled[shape] > 0) solve_batch(format, shape);
        }
    };
    if (few.filled > 0) solve_knapsack_batch();
    solve_rest(light);
    solve_rest(heavy);
}

Result<EmdSolver> EmdSolver::create(const GroundDistance& ground, Isa isa) {
    if (!has(isa))
        return fail(ErrorCode::unsupported, "an instruction set that this processor does not have", "use best_isa()");
    return EmdSolver(std::make_unique<State>(ground, isa));
}

double EmdSolver::distance(const Hord& a, const Hord& b) {
    double answer = 0;
    state_->submit(a, b, &answer, true);
    return answer;
}

void EmdSolver::submit(const Hord& a, const Hord& b, double* out) { state_->submit(a, b, out, false); }
void EmdSolver::submit(const SparseHord& a, const SparseHord& b, double* out) { state_->submit(a, b, out); }
CloseUp EmdSolver::compact() const { return state_->closed.compact; }
void EmdSolver::finish() { state_->finish(); }

const EmdSolver::Work& EmdSolver::work() const { return state_->work; }

EmdSolver::EmdSolver(std::unique_ptr<State> state) : state_(std::move(state)) {}
EmdSolver::EmdSolver(EmdSolver&&) noexcept = default;
EmdSolver& EmdSolver::operator=(EmdSolver&&) noexcept = default;
EmdSolver::~EmdSolver() = default;

}  // namespace hord::algo
