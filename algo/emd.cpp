#include "algo/emd.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "algo/fixed.h"
#include "algo/residual.h"
#include "algo/transport_simplex.h"

namespace hord::algo {
namespace {

constexpr int kStartsThatPay = 8;  // fewer are found sooner one by one

std::size_t index(int k) { return static_cast<std::size_t>(k); }

template <class Mass>
double total(const ResidualSide<Mass>& side) {
    double sum = 0;
    for (int k = 0; k < side.count; ++k) sum += static_cast<double>(side.mass[index(k)]);
    return sum;
}

// Small problems of one shape, and where their answers go.
template <class Mass>
struct Bucket {
    SmallBatch<Mass> batch;
    std::array<double, kWide> mass;  // on either side
    std::array<double*, kWide> out;

    void add(const ResidualSide<Mass>& rows, const ResidualSide<Mass>& cols, double on_either_side, double* answer) {
        const int place = batch.filled++;
        SmallProblem<Mass>& problem = batch.problem[place];
        put(rows, problem.mass, problem.bin);
        put(cols, problem.mass + kFirstSmallColumn, problem.bin + kFirstSmallColumn);
        mass[index(place)] = on_either_side;
        out[index(place)] = answer;
    }
    // Once more the first, where there is no other.
    void fill_up() { std::fill(batch.problem + batch.filled, batch.problem + kWide, batch.problem[0]); }

  private:
    // As many as there may be: a count that is known is faster than the right one.
    static void put(const ResidualSide<Mass>& side, Mass* to_mass, std::uint8_t* to_bin) {
        std::memcpy(to_mass, side.mass.data(), kSmallSide * sizeof(Mass));
        std::memcpy(to_bin, side.bin.data(), kSmallSide);
    }
};

// Problems whose masses have one format: what is found of a pair, and the small ones, a bucket for every shape.
template <class Mass>
struct Format {
    Format(FindResidual<Mass> find_it, Isa isa) : find(find_it), solve(solve_small<Mass>(isa)), buckets(index((kSmallSide + 1) * (kSmallSide + 1))) {
        for (int rows = 2; rows <= kSmallSide; ++rows) {
            for (int cols = rows; cols <= kSmallSide; ++cols) {
                auto& batch = bucket(rows, cols).batch;
                batch.rows = rows;
                batch.cols = cols;
            }
        }
    }
    Bucket<Mass>& bucket(int rows, int cols) { return buckets[index(rows * (kSmallSide + 1) + cols)]; }

    FindResidual<Mass> find;
    Residual<Mass> residual;
    SolveSmall<Mass> solve;
    SmallAnswer<Mass> answer;
    std::vector<Bucket<Mass>> buckets;
};

// Larger problems of one shape, whose starts are found side by side.
struct StartBucket {
    TransportBatch batch;
    std::array<double, kMostStarts> mass;  // on either side
    std::array<double*, kMostStarts> out;

    template <class Mass>
    void add(const ResidualSide<Mass>& rows, const ResidualSide<Mass>& cols, double on_either_side, double* answer) {
        const std::size_t place = index(batch.filled++);
        put(rows, batch.problem[place].rows);
        put(cols, batch.problem[place].cols);
        mass[place] = on_either_side;
        out[place] = answer;
    }

  private:
    template <class Mass>
    static void put(const ResidualSide<Mass>& from, TransportBatch::Side& to) {
        for (std::size_t k = 0; k < kMostStartSide; ++k) to.mass[k] = static_cast<double>(from.mass[k]);
        std::copy_n(from.bin.begin(), kMostStartSide, to.bin.begin());
    }
};

// One for every shape.
class StartBuckets {
  public:
    StartBuckets() : buckets_(index((kMostStartSide - kSmallSide) * (kMostStartSide + 1))) {
        for (int cols = kSmallSide + 1; cols <= kMostStartSide; ++cols) {
            for (int rows = 2; rows <= cols; ++rows) {
                TransportBatch& batch = of(rows, cols).batch;
                batch.rows = rows;
                batch.cols = cols;
            }
        }
    }
    StartBucket& of(int rows, int cols) { return buckets_[index((cols - kSmallSide - 1) * (kMostStartSide + 1) + rows)]; }
    auto begin() { return buckets_.begin(); }
    auto end() { return buckets_.end(); }

  private:
    std::vector<StartBucket> buckets_;
};

}  // namespace

struct EmdSolver::State {
    State(const GroundDistance& g, Isa isa)
        : ground(g), simplex(ground.row(0), ground.bins(), ground.largest(), isa),
          costs{ground.row(0), ground.bins(), ground.largest() * TransportSimplex::kTolerance}, light(find_residual_for(isa), isa),
          heavy(find_residual<double>, isa) {}

    void submit(const Hord& a, const Hord& b, double* out, bool at_once);
    void finish();
    template <class Mass>
    void submit_as(Format<Mass>& format, const Hord& a, const Hord& b, double mass, double* out, bool at_once);
    template <class Mass>
    double from_one(const ResidualSide<Mass>& one, const ResidualSide<Mass>& others) const;
    template <class Mass>
    void solve_bucket(Format<Mass>& format, Bucket<Mass>& full);
    template <class Mass>
    double improve(const SmallBatch<Mass>& batch, const SmallAnswer<Mass>& answer, int lane);
    template <class Mass>
    double by_simplex(const ResidualSide<Mass>& rows, const ResidualSide<Mass>& cols);
    double by_simplex(const Transport& problem, const TransportStep* start);
    void solve_started(StartBucket& bucket);

    GroundDistance ground;
    TransportSimplex simplex;
    SmallCosts costs;
    Format<std::int32_t> light;
    Format<double> heavy;
    StartBuckets starts;
    TransportStarts found;
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
    } else if (cols.count > kMostStartSide || (at_once && cols.count > kSmallSide)) {
        *out = by_simplex(rows, cols) / mass;
    } else if (cols.count > kSmallSide) {
        StartBucket& bucket = starts.of(rows.count, cols.count);
        bucket.add(rows, cols, mass, out);
        if (bucket.batch.filled == kMostStarts) solve_started(bucket);
    } else {
        Bucket<Mass>& bucket = format.bucket(rows.count, cols.count);
        bucket.add(rows, cols, mass, out);
        if (at_once || bucket.batch.filled == kWide) solve_bucket(format, bucket);
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
void EmdSolver::State::solve_bucket(Format<Mass>& format, Bucket<Mass>& full) {
    SmallBatch<Mass>& batch = full.batch;
    SmallAnswer<Mass>& answer = format.answer;
    work.small += static_cast<std::uint64_t>(batch.filled);
    if (batch.filled < kWide) full.fill_up();
    format.solve(batch, costs, answer);
    for (int lane = 0; lane < batch.filled; ++lane) {
        const double cost = answer.proven[lane] ? answer.cost[lane] : improve(batch, answer, lane);
        *full.out[index(lane)] = cost / full.mass[index(lane)];
    }
    batch.filled = 0;
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
    const std::uint8_t* bin = batch.problem[lane].bin;
    return by_simplex({batch.rows, batch.cols, nullptr, nullptr, bin, bin + kFirstSmallColumn}, steps.data());
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

void EmdSolver::State::solve_started(StartBucket& bucket) {
    TransportBatch& batch = bucket.batch;
    const bool many = batch.filled >= kStartsThatPay;
    if (many) simplex.find_starts(batch, found);
    for (std::size_t k = 0; k < index(batch.filled); ++k) {
        const auto& [rows, cols] = batch.problem[k];
        *bucket.out[k] = by_simplex({batch.rows, batch.cols, rows.mass.data(), cols.mass.data(), rows.bin.data(), cols.bin.data()}, many ? found[k].data() : nullptr) / bucket.mass[k];
    }
    batch.filled = 0;
}

void EmdSolver::State::finish() {
    for (StartBucket& bucket : starts) solve_started(bucket);
    const auto solve_rest = [this](auto& format) {
        for (auto& bucket : format.buckets) {
            if (bucket.batch.filled > 0) solve_bucket(format, bucket);
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
