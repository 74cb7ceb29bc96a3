#include "algo/emd.h"

#include <algorithm>
#include <array>
#include <vector>

#include "algo/lit_bins.h"
#include "algo/transport_simplex.h"

namespace hord::algo {
namespace {

std::size_t index(int k) { return static_cast<std::size_t>(k); }

// Bins that have too much, or too little, over the common denominator.
struct Side {
    int count = 0;
    std::array<double, kMostBins + 1> mass;  // one more: the loops below write before they decide
    std::array<std::uint8_t, kMostBins + 1> bin;

    // Which side becomes the rows: the one with fewer bins; of equals the one that comes first in bins, then in masses.
    // So d(a,b) and d(b,a) are the same problem, and equal to the last bit.
    [[nodiscard]] bool precedes(const Side& other) const {
        if (count != other.count) return count < other.count;
        const auto [mine, its] = std::mismatch(bin.begin(), bin.begin() + count, other.bin.begin());
        if (mine != bin.begin() + count) return *mine < *its;
        return std::lexicographical_compare(mass.begin(), mass.begin() + count, other.mass.begin(), other.mass.begin() + count);
    }
};

// d = a * S_b - b * S_a, bin by bin; what both share is gone. No branches on the data: they would be guesses.
void cancel(const Hord& a, const Hord& b, int bins, Side& more, Side& less) {
    const std::uint16_t* const mass_a = a.mass;
    const std::uint16_t* const mass_b = b.mass;
    const std::int64_t sum_a = a.sum;
    const std::int64_t sum_b = b.sum;
    const LitBins lit(mass_a, mass_b, bins);
    std::size_t n_more = 0, n_less = 0;
    for (int w = 0; w < lit.words(); ++w) {
        for (std::uint64_t rest = lit.word(w); rest != 0; rest &= rest - 1) {
            const int k = w * 64 + __builtin_ctzll(rest);
            const std::int64_t d = mass_a[k] * sum_b - mass_b[k] * sum_a;
            const auto mass = static_cast<double>(d);
            more.mass[n_more] = mass;
            more.bin[n_more] = static_cast<std::uint8_t>(k);
            n_more += d > 0 ? 1U : 0U;
            less.mass[n_less] = -mass;
            less.bin[n_less] = static_cast<std::uint8_t>(k);
            n_less += d < 0 ? 1U : 0U;
        }
    }
    more.count = static_cast<int>(n_more);
    less.count = static_cast<int>(n_less);
}

// Where shared mass may have to move, too: a * S_b against b * S_a.
void keep(const Hord& h, std::int64_t other_sum, int bins, Side& side) {
    const LitBins lit(h.mass, bins);
    for (int w = 0; w < lit.words(); ++w) {
        for (std::uint64_t rest = lit.word(w); rest != 0; rest &= rest - 1) {
            const int k = w * 64 + __builtin_ctzll(rest);
            side.mass[index(side.count)] = static_cast<double>(h.mass[k] * other_sum);
            side.bin[index(side.count)] = static_cast<std::uint8_t>(k);
            ++side.count;
        }
    }
}

// Small problems of one shape, and where their answers go.
struct Bucket {
    SmallBatch<kWide> batch;
    std::array<double, kWide> mass;  // on either side
    std::array<double*, kWide> out;
};

template <int W>
void put(SmallBatch<W>& batch, int lane, const Side& rows, const Side& cols) {
    for (int i = 0; i < rows.count; ++i) {
        batch.mass[i][lane] = rows.mass[index(i)];
        batch.bin[i][lane] = rows.bin[index(i)];
    }
    for (int j = 0; j < cols.count; ++j) {
        batch.mass[kSmallSide + j][lane] = cols.mass[index(j)];
        batch.bin[kSmallSide + j][lane] = cols.bin[index(j)];
    }
}

}  // namespace

struct EmdSolver::State {
    State(const GroundDistance& g, Isa isa)
        : ground(g), simplex(ground.row(0), ground.bins(), ground.largest(), isa),
          costs{ground.row(0), ground.bins(), ground.largest() * TransportSimplex::kTolerance}, solve_wide(algo::solve_wide(isa)),
          buckets(index((kSmallSide + 1) * (kSmallSide + 1))) {
        for (int rows = 2; rows <= kSmallSide; ++rows) {
            for (int cols = rows; cols <= kSmallSide; ++cols) {
                auto& batch = bucket(rows, cols).batch;
                batch.rows = rows;
                batch.cols = cols;
            }
        }
    }

    Bucket& bucket(int rows, int cols) { return buckets[index(rows * (kSmallSide + 1) + cols)]; }
    bool find_sides(const Hord& a, const Hord& b);
    double from_one() const;
    double by_simplex(const double* supply, const double* demand, const std::uint8_t* row_bin, const std::uint8_t* col_bin, int r, int c);
    double solve_alone();
    void solve_bucket(Bucket& full);

    GroundDistance ground;
    TransportSimplex simplex;
    SmallCosts costs;
    SolveWide solve_wide;
    SmallBatch<1> alone;
    std::vector<Bucket> buckets;
    Side more, less;
    const Side* fewer = nullptr;  // the two sides: rows
    const Side* others = nullptr;  // and columns
    Work work;
};

// False: nothing has to move.
bool EmdSolver::State::find_sides(const Hord& a, const Hord& b) {
    ++work.pairs;
    more.count = less.count = 0;
    if (a.sum == 0 || b.sum == 0) return false;
    if (ground.is_metric()) {
        cancel(a, b, ground.bins(), more, less);
    } else {
        keep(a, b.sum, ground.bins(), more);
        keep(b, a.sum, ground.bins(), less);
    }
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

double EmdSolver::State::by_simplex(const double* supply, const double* demand, const std::uint8_t* row_bin, const std::uint8_t* col_bin,
                                    int r, int c) {
    const auto outcome = simplex.solve({r, c, supply, demand, row_bin, col_bin});
    ++work.simplex;
    work.pivots += static_cast<std::uint64_t>(outcome.pivots);
    work.unproven += outcome.proven ? 0U : 1U;
    return outcome.cost;
}

double EmdSolver::State::solve_alone() {
    if (fewer->count == 1) return from_one();
    if (others->count <= kSmallSide) {
        ++work.small;
        alone.rows = fewer->count;
        alone.cols = others->count;
        put(alone, 0, *fewer, *others);
        solve_small(alone, costs);
        if (alone.proven[0]) return alone.cost[0];
    }
    return by_simplex(fewer->mass.data(), others->mass.data(), fewer->bin.data(), others->bin.data(), fewer->count, others->count);
}

void EmdSolver::State::solve_bucket(Bucket& full) {
    SmallBatch<kWide>& batch = full.batch;
    work.small += static_cast<std::uint64_t>(batch.filled);
    solve_wide(batch, costs);
    for (int lane = 0; lane < batch.filled; ++lane) {
        double cost = batch.cost[lane];
        if (!batch.proven[lane]) {
            std::array<double, 2 * kSmallSide> mass;
            std::array<std::uint8_t, 2 * kSmallSide> bin;
            for (std::size_t node = 0; node < mass.size(); ++node) {
                mass[node] = batch.mass[node][lane];
                bin[node] = static_cast<std::uint8_t>(batch.bin[node][lane]);
            }
            cost = by_simplex(mass.data(), mass.data() + kSmallSide, bin.data(), bin.data() + kSmallSide, batch.rows, batch.cols);
        }
        *full.out[index(lane)] = cost / full.mass[index(lane)];
    }
    batch.filled = 0;
}

Result<EmdSolver> EmdSolver::create(const GroundDistance& ground, Isa isa) {
    if (!has(isa)) return fail(ErrorCode::unsupported, "an instruction set that this processor does not have", "use best_isa()");
    return EmdSolver(std::make_unique<State>(ground, isa));
}

double EmdSolver::distance(const Hord& a, const Hord& b) {
    State& s = *state_;
    if (!s.find_sides(a, b)) return 0;
    return s.solve_alone() / (static_cast<double>(a.sum) * static_cast<double>(b.sum));
}

void EmdSolver::submit(const Hord& a, const Hord& b, double* out) {
    State& s = *state_;
    if (!s.find_sides(a, b)) {
        *out = 0;
        return;
    }
    const double mass = static_cast<double>(a.sum) * static_cast<double>(b.sum);
    if (s.fewer->count == 1 || s.others->count > kSmallSide) {
        *out = s.solve_alone() / mass;
        return;
    }
    Bucket& bucket = s.bucket(s.fewer->count, s.others->count);
    const int lane = bucket.batch.filled++;
    put(bucket.batch, lane, *s.fewer, *s.others);
    bucket.mass[index(lane)] = mass;
    bucket.out[index(lane)] = out;
    if (bucket.batch.filled == kWide) s.solve_bucket(bucket);
}

void EmdSolver::finish() {
    for (Bucket& bucket : state_->buckets) {
        if (bucket.batch.filled > 0) state_->solve_bucket(bucket);
    }
}

const EmdSolver::Work& EmdSolver::work() const { return state_->work; }

EmdSolver::EmdSolver(std::unique_ptr<State> state) : state_(std::move(state)) {}
EmdSolver::EmdSolver(EmdSolver&&) noexcept = default;
EmdSolver& EmdSolver::operator=(EmdSolver&&) noexcept = default;
EmdSolver::~EmdSolver() = default;

}  // namespace hord::algo
