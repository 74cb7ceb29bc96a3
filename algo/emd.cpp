#include "algo/emd.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "algo/aligned.h"
#include "algo/fixed.h"
#include "algo/residual.h"
#include "algo/transport_simplex.h"

namespace hord::algo {
namespace {

std::size_t index(int k) { return static_cast<std::size_t>(k); }

template <class Mass>
double total(const ResidualSide<Mass>& side) {
    double sum = 0;
    for (int k = 0; k < side.count; ++k) sum += static_cast<double>(side.mass[index(k)]);
    return sum;
}

// Problems whose masses have one format: what is found of a pair, and the small ones, a batch for every shape.
template <class Mass>
struct Format {
    Format(FindResidual<Mass> find_it, Isa isa) : find(find_it), solve(solve_small<Mass>(isa)), batches(kShapes) {
        for (int rows = 2; rows <= kSmallSide; ++rows) {
            for (int cols = rows; cols <= kSmallSide; ++cols) {
                batches[shape(rows, cols)].rows = rows;
                batches[shape(rows, cols)].cols = cols;
            }
        }
    }
    static std::size_t shape(int rows, int cols) { return index(rows * (kSmallSide + 1) + cols); }

    // Until it is solved, the mass on either side is where the answer goes.
    void put(const ResidualSide<Mass>& rows, const ResidualSide<Mass>& cols, double on_either_side, double* out, std::size_t shape) {
        SmallProblem<Mass>& problem = batches[shape].problem[filled[shape]++];
        put(rows, problem.mass[0], problem.bin[0]);
        put(cols, problem.mass[1], problem.bin[1]);
        problem.out = out;
        *out = on_either_side;
    }
    // That of a shape, as it is solved: once more the first problem, where there is no other.
    SmallBatch<Mass>& take(std::size_t shape) {
        SmallBatch<Mass>& batch = batches[shape];
        batch.filled = std::exchange(filled[shape], std::uint8_t{0});
        std::fill(batch.problem + batch.filled, batch.problem + kWide, batch.problem[0]);
        return batch;
    }

    static constexpr std::size_t kShapes = (kSmallSide + 1) * (kSmallSide + 1);
    FindResidual<Mass> find;
    Residual<Mass> residual;
    SolveSmall<Mass> solve;
    SmallAnswer<Mass> answer;
    std::array<std::uint8_t, kShapes> filled{};  // of each batch: within three cache lines, which every pair needs
    AlignedVector<SmallBatch<Mass>> batches;

  private:
    // As many as there may be: a count that is known is faster than the right one.
    static void put(const ResidualSide<Mass>& side, Mass* to_mass, std::uint8_t* to_bin) {
        std::memcpy(to_mass, side.mass.data(), kSmallSide * sizeof(Mass));
        std::memcpy(to_bin, side.bin.data(), kSmallSide);
    }
};

}  // namespace

struct EmdSolver::State {
    State(const GroundDistance& g, Isa isa)
        : ground(g), simplex(ground.row(0), ground.bins(), ground.largest(), isa),
          costs{ground.row(0), ground.bins(), ground.largest() * TransportSimplex::kTolerance},
          light(find_residual_for(isa == Isa::portable ? isa : widest_isa()), isa), heavy(find_residual<double>, isa) {}

    void submit(const Hord& a, const Hord& b, double* out, bool at_once);
    void finish();
    template <class Mass>
    void submit_as(Format<Mass>& format, const Hord& a, const Hord& b, double mass, double* out, bool at_once);
    template <class Mass>
    double from_one(const ResidualSide<Mass>& one, const ResidualSide<Mass>& others) const;
    template <class Mass>
    void solve_batch(Format<Mass>& format, std::size_t shape);
    template <class Mass>
    double improve(const SmallBatch<Mass>& batch, const SmallAnswer<Mass>& answer, int lane);
    template <class Mass>
    double by_simplex(const ResidualSide<Mass>& rows, const ResidualSide<Mass>& cols);
    double by_simplex(const Transport& problem, const TransportStep* start);

    GroundDistance ground;
    TransportSimplex simplex;
    SmallCosts costs;
    Format<std::int32_t> light;
    Format<double> heavy;
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
void EmdSolver::State::submit_as(Format<Mass>& format, const Hord& a, const Hord& b, double mass, double* out, bool at_once) {
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
    } else if (cols.count > kSmallSide) {
        *out = by_simplex(rows, cols) / mass;
    } else {
        const std::size_t shape = format.shape(rows.count, cols.count);
        format.put(rows, cols, mass, out, shape);
        if (at_once || format.filled[shape] == kWide) solve_batch(format, shape);
    }
}

// All that the one bin has goes to, or comes from, the others.
template <class Mass>
double EmdSolver::State::from_one(const ResidualSide<Mass>& one, const ResidualSide<Mass>& others) const {
    const double* cost = ground.row(one.bin[0]);
    double sum = 0;
    for (int j = 0; j < others.count; ++j) sum += static_cast<double>(others.mass[index(j)]) * cost[others.bin[index(j)]];
    return sum;
}

template <class Mass>
void EmdSolver::State::solve_batch(Format<Mass>& format, std::size_t shape) {
    const SmallBatch<Mass>& batch = format.take(shape);
    SmallAnswer<Mass>& answer = format.answer;
    work.small += static_cast<std::uint64_t>(batch.filled);
    format.solve(batch, costs, answer);
    for (int lane = 0; lane < batch.filled; ++lane) {
        double& out = *batch.problem[lane].out;
        out = (answer.proven[lane] ? answer.cost[lane] : improve(batch, answer, lane)) / out;
    }
}

// From the plan of a lane on.
template <class Mass>
double EmdSolver::State::improve(const SmallBatch<Mass>& batch, const SmallAnswer<Mass>& answer, int lane) {
    std::array<TransportStep, kMostSmallSteps> steps;
    for (int step = 0; step < batch.rows + batch.cols - 1; ++step) {
        const std::int32_t child = answer.child[step][lane], parent = answer.parent[step][lane];
        steps[index(step)] = {static_cast<double>(answer.flow[step][lane]), static_cast<std::int16_t>(std::min(child, parent)),
                              static_cast<std::int16_t>(std::max(child, parent) - kFirstSmallColumn), child < parent};
    }
    const auto& [row_bin, col_bin] = batch.problem[lane].bin;
    return by_simplex({batch.rows, batch.cols, nullptr, nullptr, row_bin, col_bin}, steps.data());
}

template <class Mass>
double EmdSolver::State::by_simplex(const ResidualSide<Mass>& rows, const ResidualSide<Mass>& cols) {
    std::array<double, kMostBins> supply, demand;
    std::copy_n(rows.mass.begin(), rows.count, supply.begin());
    std::copy_n(cols.mass.begin(), cols.count, demand.begin());
    return by_simplex({rows.count, cols.count, supply.data(), demand.data(), rows.bin.data(), cols.bin.data()}, nullptr);
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
        for (std::size_t shape = 0; shape < format.kShapes; ++shape) {
            if (format.filled[shape] > 0) solve_batch(format, shape);
        }
    };
    solve_rest(light);
    solve_rest(heavy);
}

Result<EmdSolver> EmdSolver::create(const GroundDistance& ground, Isa isa) {
    if (!has(isa)) return fail(ErrorCode::unsupported, "an instruction set that this processor does not have", "use best_isa()");
    return EmdSolver(std::make_unique<State>(ground, isa));
}

double EmdSolver::distance(const Hord& a, const Hord& b) {
    double answer = 0;
    state_->submit(a, b, &answer, true);
    return answer;
}

void EmdSolver::submit(const Hord& a, const Hord& b, double* out) { state_->submit(a, b, out, false); }
void EmdSolver::finish() { state_->finish(); }

const EmdSolver::Work& EmdSolver::work() const { return state_->work; }

EmdSolver::EmdSolver(std::unique_ptr<State> state) : state_(std::move(state)) {}
EmdSolver::EmdSolver(EmdSolver&&) noexcept = default;
EmdSolver& EmdSolver::operator=(EmdSolver&&) noexcept = default;
EmdSolver::~EmdSolver() = default;

}  // namespace hord::algo
