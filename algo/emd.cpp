#include "algo/emd.h"

#include <algorithm>
#include <vector>

#include "algo/transport_simplex.h"

namespace hord::algo {
namespace {

// What has to move: bins with too much and bins with too little, over the common denominator.
struct Side {
    int count = 0;
    std::vector<double> mass;
    std::vector<std::uint8_t> bin;

    explicit Side(int bins) : mass(static_cast<std::size_t>(bins)), bin(static_cast<std::size_t>(bins)) {}
    void add(int k, double m) {
        mass[static_cast<std::size_t>(count)] = m;
        bin[static_cast<std::size_t>(count)] = static_cast<std::uint8_t>(k);
        ++count;
    }

    // Which side becomes the rows: the one with fewer bins; of equals the one that comes first in bins, then in masses.
    // So d(a,b) and d(b,a) are the same problem, and equal to the last bit.
    [[nodiscard]] bool precedes(const Side& other) const {
        if (count != other.count) return count < other.count;
        const auto [mine, its] = std::mismatch(bin.begin(), bin.begin() + count, other.bin.begin());
        if (mine != bin.begin() + count) return *mine < *its;
        return std::lexicographical_compare(mass.begin(), mass.begin() + count, other.mass.begin(), other.mass.begin() + count);
    }
};

}  // namespace

struct EmdSolver::State {
    explicit State(const GroundDistance& g)
        : ground(g), simplex(ground.row(0), ground.bins(), ground.largest()), more(g.bins()), less(g.bins()), order(static_cast<std::size_t>(g.bins())) {}

    void cancel(const Hord& a, const Hord& b);
    void keep(const Hord& a, const Hord& b);
    double from_one(const Side& one, const Side& others) const;
    double from_two(const Side& two, const Side& others);
    double solve(const Side& rows, const Side& cols);

    GroundDistance ground;
    TransportSimplex simplex;
    Side more, less;
    std::vector<int> order;
    Work work;
};

// d = a * S_b - b * S_a, bin by bin; what both share is gone.
void EmdSolver::State::cancel(const Hord& a, const Hord& b) {
    const int bins = ground.bins();
    for (int k = 0; k < bins; ++k) {
        const std::int64_t d = static_cast<std::int64_t>(a.mass[k]) * b.sum - static_cast<std::int64_t>(b.mass[k]) * a.sum;
        if (d > 0) more.add(k, static_cast<double>(d));
        if (d < 0) less.add(k, static_cast<double>(-d));
    }
}

void EmdSolver::State::keep(const Hord& a, const Hord& b) {
    const int bins = ground.bins();
    for (int k = 0; k < bins; ++k) {
        if (a.mass[k] > 0) more.add(k, static_cast<double>(static_cast<std::int64_t>(a.mass[k]) * b.sum));
        if (b.mass[k] > 0) less.add(k, static_cast<double>(static_cast<std::int64_t>(b.mass[k]) * a.sum));
    }
}

double EmdSolver::State::from_one(const Side& one, const Side& others) const {
    const double* cost = ground.row(one.bin[0]);
    double sum = 0;
    for (std::size_t k = 0; k < static_cast<std::size_t>(others.count); ++k) sum += others.mass[k] * cost[others.bin[k]];
    return sum;
}

// A fractional knapsack: the bins that gain most by being served from the first of the two get it all, in order, until
// it is used up.
double EmdSolver::State::from_two(const Side& two, const Side& others) {
    const double* first = ground.row(two.bin[0]);
    const double* second = ground.row(two.bin[1]);
    const auto gain = [&](int k) {
        const int bin = others.bin[static_cast<std::size_t>(k)];
        return second[bin] - first[bin];
    };
    for (int k = 0; k < others.count; ++k) {
        int at = k;
        for (; at > 0 && gain(order[static_cast<std::size_t>(at - 1)]) < gain(k); --at) {
            order[static_cast<std::size_t>(at)] = order[static_cast<std::size_t>(at - 1)];
        }
        order[static_cast<std::size_t>(at)] = k;
    }
    double left = two.mass[0];
    double sum = 0;
    for (int at = 0; at < others.count; ++at) {
        const auto k = static_cast<std::size_t>(order[static_cast<std::size_t>(at)]);
        const double from_first = std::min(left, others.mass[k]);
        left -= from_first;
        sum += from_first * first[others.bin[k]] + (others.mass[k] - from_first) * second[others.bin[k]];
    }
    return sum;
}

double EmdSolver::State::solve(const Side& rows, const Side& cols) {
    if (rows.count <= 2) {
        ++work.closed_forms;
        return rows.count == 1 ? from_one(rows, cols) : from_two(rows, cols);
    }
    const auto outcome = simplex.solve({rows.count, cols.count, rows.mass.data(), cols.mass.data(), rows.bin.data(), cols.bin.data()});
    work.pivots += static_cast<std::uint64_t>(outcome.pivots);
    work.unproven += outcome.proven ? 0U : 1U;
    return outcome.cost;
}

Result<EmdSolver> EmdSolver::create(const GroundDistance& ground) { return EmdSolver(std::make_unique<State>(ground)); }

double EmdSolver::distance(const Hord& a, const Hord& b) {
    State& s = *state_;
    ++s.work.pairs;
    if (a.sum == 0 || b.sum == 0) return 0;
    s.more.count = s.less.count = 0;
    if (s.ground.is_metric()) {
        s.cancel(a, b);
    } else {
        s.keep(a, b);
    }
    if (s.more.count == 0 || s.less.count == 0) return 0;
    const double cost = s.less.precedes(s.more) ? s.solve(s.less, s.more) : s.solve(s.more, s.less);
    return cost / (static_cast<double>(a.sum) * static_cast<double>(b.sum));
}

const EmdSolver::Work& EmdSolver::work() const { return state_->work; }

EmdSolver::EmdSolver(std::unique_ptr<State> state) : state_(std::move(state)) {}
EmdSolver::EmdSolver(EmdSolver&&) noexcept = default;
EmdSolver& EmdSolver::operator=(EmdSolver&&) noexcept = default;
EmdSolver::~EmdSolver() = default;

}  // namespace hord::algo
