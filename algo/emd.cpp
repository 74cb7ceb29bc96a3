#include "algo/emd.h"

#include <algorithm>
#include <array>
#include <vector>

#include "algo/fixed.h"
#include "algo/residual.h"
#include "algo/transport_simplex.h"

namespace hord::algo {
namespace {

std::size_t index(int k) { return static_cast<std::size_t>(k); }

double total(const ResidualSide& side) {
    double sum = 0;
    for (int k = 0; k < side.count; ++k) sum += side.mass[index(k)];
    return sum;
}

// Small problems of one shape, and where their answers go.
template <class Mass>
struct Bucket {
    SmallBatch<Mass> batch;
    std::array<double, kWide> mass;  // on either side
    std::array<double*, kWide> out;

    void add(const ResidualSide& rows, const ResidualSide& cols, double on_either_side, double* answer) {
        const int lane = batch.filled++;
        for (int i = 0; i < rows.count; ++i) put(i, lane, rows, i);
        for (int j = 0; j < cols.count; ++j) put(kFirstSmallColumn + j, lane, cols, j);
        mass[index(lane)] = on_either_side;
        out[index(lane)] = answer;
    }
    // The first lane's problem, where there is no other: what is computed of it is not looked at.
    void fill_up() {
        for (int node = 0; node < kSmallNodes; ++node) {
            std::fill(batch.mass[node] + batch.filled, batch.mass[node] + kWide, batch.mass[node][0]);
            std::fill(batch.bin[node] + batch.filled, batch.bin[node] + kWide, batch.bin[node][0]);
        }
    }

  private:
    void put(int node, int lane, const ResidualSide& side, int k) {
        batch.mass[node][lane] = static_cast<Mass>(side.mass[index(k)]);
        batch.bin[node][lane] = side.bin[index(k)];
    }
};

// One for every shape.
template <class Mass>
class Buckets {
  public:
    Buckets() : buckets_(index((kSmallSide + 1) * (kSmallSide + 1))) {
        for (int rows = 2; rows <= kSmallSide; ++rows) {
            for (int cols = rows; cols <= kSmallSide; ++cols) {
                auto& batch = of(rows, cols).batch;
                batch.rows = rows;
                batch.cols = cols;
            }
        }
    }
    Bucket<Mass>& of(int rows, int cols) { return buckets_[index(rows * (kSmallSide + 1) + cols)]; }
    std::vector<Bucket<Mass>>& all() { return buckets_; }

  private:
    std::vector<Bucket<Mass>> buckets_;
};

}  // namespace

struct EmdSolver::State {
    State(const GroundDistance& g, Isa isa)
        : ground(g), simplex(ground.row(0), ground.bins(), ground.largest(), isa),
          costs{ground.row(0), ground.bins(), ground.largest() * TransportSimplex::kTolerance}, solve_light(solve_small(isa)),
          solve_heavy(solve_small_heavy(isa)) {}

    bool find_sides(const Hord& a, const Hord& b);
    double from_one() const;
    double by_simplex(const Transport& problem, const TransportStep* start);
    template <class Mass>
    void submit_to(Bucket<Mass>& bucket, double mass, double* out, bool at_once);
    void submit(const Hord& a, const Hord& b, double* out, bool at_once);
    void finish();
    template <class Mass>
    void solve_bucket(Bucket<Mass>& full);
    template <class Mass>
    double improve(const SmallBatch<Mass>& batch, int lane);

    GroundDistance ground;
    TransportSimplex simplex;
    SmallCosts costs;
    SolveSmall solve_light;
    SolveSmallHeavy solve_heavy;
    Buckets<std::int32_t> light;
    Buckets<double> heavy;
    ResidualSide more, less;
    const ResidualSide* fewer = nullptr;  // the two sides: rows
    const ResidualSide* others = nullptr;  // and columns
    Work work;
};

// False: nothing has to move.
bool EmdSolver::State::find_sides(const Hord& a, const Hord& b) {
    ++work.pairs;
    expect_no_overflow(a.sum < kSumLimit && b.sum < kSumLimit);
    if (a.sum == 0 || b.sum == 0) return false;
    if (ground.is_metric()) {
        find_residual(a, b, ground.bins(), more, less);
    } else {
        keep_all(a, b, ground.bins(), more, less);
    }
    expect_no_overflow(total(more) == total(less) && total(more) <= static_cast<double>(a.sum) * static_cast<double>(b.sum));
    if (more.count == 0 || less.count == 0) return false;
    const bool swap = less.precedes(more);
    fewer = swap ? &less : &more;
    others = swap ? &more : &less;
    return true;
}

// All that the one bin has goes to, or comes from, the others.
double EmdSolver::State::from_one() const {
    const double* cost = ground.row(fewer->bin[0]);
    double sum = 0;
    for (int j = 0; j < others->count; ++j) sum += others->mass[index(j)] * cost[others->bin[index(j)]];
    return sum;
}

double EmdSolver::State::by_simplex(const Transport& problem, const TransportStep* start) {
    const auto outcome = simplex.solve(problem, start);
    ++work.simplex;
    work.pivots += static_cast<std::uint64_t>(outcome.pivots);
    work.unproven += outcome.proven ? 0U : 1U;
    return outcome.cost;
}

// From the plan of a lane on.
template <class Mass>
double EmdSolver::State::improve(const SmallBatch<Mass>& batch, int lane) {
    std::array<std::uint8_t, kSmallNodes> bin;
    for (int node = 0; node < kSmallNodes; ++node) bin[index(node)] = static_cast<std::uint8_t>(batch.bin[node][lane]);
    const auto node_of = [&](std::int32_t small) { return small < kFirstSmallColumn ? small : small - kFirstSmallColumn + batch.rows; };
    std::array<TransportStep, kMostSmallSteps> steps;
    for (int step = 0; step < batch.rows + batch.cols - 1; ++step) {
        steps[index(step)] = {static_cast<double>(batch.flow[step][lane]), node_of(batch.child[step][lane]), node_of(batch.parent[step][lane])};
    }
    return by_simplex({batch.rows, batch.cols, nullptr, nullptr, bin.data(), bin.data() + kFirstSmallColumn}, steps.data());
}

template <class Mass>
void EmdSolver::State::solve_bucket(Bucket<Mass>& full) {
    SmallBatch<Mass>& batch = full.batch;
    work.small += static_cast<std::uint64_t>(batch.filled);
    if (batch.filled < kWide) full.fill_up();
    if constexpr (std::is_same_v<Mass, std::int32_t>) {
        solve_light(batch, costs);
    } else {
        solve_heavy(batch, costs);
    }
    for (int lane = 0; lane < batch.filled; ++lane) {
        const double cost = batch.proven[lane] ? batch.cost[lane] : improve(batch, lane);
        *full.out[index(lane)] = cost / full.mass[index(lane)];
    }
    batch.filled = 0;
}

template <class Mass>
void EmdSolver::State::submit_to(Bucket<Mass>& bucket, double mass, double* out, bool at_once) {
    bucket.add(*fewer, *others, mass, out);
    if (at_once || bucket.batch.filled == kWide) solve_bucket(bucket);
}

void EmdSolver::State::submit(const Hord& a, const Hord& b, double* out, bool at_once) {
    if (!find_sides(a, b)) {
        *out = 0;
        return;
    }
    const double mass = static_cast<double>(a.sum) * static_cast<double>(b.sum);
    const int rows = fewer->count, cols = others->count;
    if (rows == 1) {
        *out = from_one() / mass;
    } else if (cols > kSmallSide) {
        *out = by_simplex({rows, cols, fewer->mass.data(), others->mass.data(), fewer->bin.data(), others->bin.data()}, nullptr) / mass;
    } else if (mass < kLightMass) {
        submit_to(light.of(rows, cols), mass, out, at_once);
    } else {
        submit_to(heavy.of(rows, cols), mass, out, at_once);
    }
}

void EmdSolver::State::finish() {
    const auto solve_rest = [this](auto& bucket) {
        if (bucket.batch.filled > 0) solve_bucket(bucket);
    };
    std::ranges::for_each(light.all(), solve_rest);
    std::ranges::for_each(heavy.all(), solve_rest);
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
