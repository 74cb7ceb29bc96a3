#include "algo/maps/emd_anytime.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "algo/emd/emd_bounds.h"
#include "algo/features/gradient.h"
#include "algo/features/row_window.h"
#include "algo/maps/row_thread_pool.h"

namespace hord::algo {
namespace {

constexpr int kBandRows = 8;        // rows of a band of bounds
constexpr int kShareLenslets = 32;  // lenslets of a band of exact solves
constexpr double kSqrt8 =
    2.8284271247461907;  // largest norm over largest cost (two components of weight 2), rounded up

float rounded_down(double value) {
    const auto f = static_cast<float>(value);
    return f > value ? std::nextafter(f, -std::numeric_limits<float>::infinity()) : f;
}
float rounded_up(double value) {
    const auto f = static_cast<float>(value);
    return f < value ? std::nextafter(f, std::numeric_limits<float>::infinity()) : f;
}

struct Worker {
    Worker(const Extents& e, const GroundDistance& ground, EmdSolver s)
        : window(e), bounds(ground), solver(std::move(s)) {}
    RowWindow window;
    EmdBounds bounds;
    EmdSolver solver;
    std::array<EmdGradient, kShareLenslets> gradients;
    std::array<std::array<std::uint16_t, kMaxBinCount>, 2> masses;
};

}  // namespace

struct AnytimeEmdMap::State {
    Extents extents;
    int bits = 8;
    LightLevels levels;
    float largest = 0;
    std::unique_ptr<RowThreadPool> pool;
    std::vector<Worker> workers;
    FrameView frame;
    std::vector<float> lower, upper;
    std::vector<std::uint8_t> mask;
    std::vector<std::uint32_t> open;  // a heap once all rows are bounded, widest first
    int rows_bounded = 0;

    [[nodiscard]] std::size_t at(int m, int n) const {
        return static_cast<std::size_t>(n) * static_cast<std::size_t>(extents.m) + static_cast<std::size_t>(m);
    }
    [[nodiscard]] bool narrower(std::uint32_t a, std::uint32_t b) const {
        const float width_a = upper[a] - lower[a], width_b = upper[b] - lower[b];
        return width_a != width_b ? width_a < width_b : a > b;
    }
    void begin();
    void bound_round();
    void bound_band(Worker& worker, int first, int last);
    void solve_piece();
    void solve_share(Worker& worker, std::span<const std::uint32_t> lenslets);
    [[nodiscard]] bool has_hord(std::size_t k) const { return (mask[k] & kNoHord) == 0; }
};

void AnytimeEmdMap::State::begin() {
    rows_bounded = 0;
    open.clear();
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m) {
            const bool edge = n == 0 || n == extents.n - 1 || m == 0 || m == extents.m - 1;
            mask[at(m, n)] = edge ? kBorder : kValid;
            lower[at(m, n)] = 0;
            upper[at(m, n)] = edge ? 0 : largest;
        }
    }
}

void AnytimeEmdMap::State::bound_round() {
    const int first = rows_bounded, last = std::min(first + kRoundRows, extents.n);
    pool->share_out((last - first + kBandRows - 1) / kBandRows, [&](int worker, int band) {
        const int from = first + band * kBandRows;
        bound_band(workers[static_cast<std::size_t>(worker)], from, std::min(from + kBandRows, last));
    });
    for (std::size_t k = at(0, first); k < at(0, last); ++k) {
        if (upper[k] > lower[k]) open.push_back(static_cast<std::uint32_t>(k));
    }
    rows_bounded = last;
    if (last == extents.n) std::make_heap(open.begin(), open.end(), [this](auto a, auto b) { return narrower(a, b); });
}

void AnytimeEmdMap::State::bound_band(Worker& worker, int first, int last) {
    RowWindow& window = worker.window;
    window.stream(frame, levels, first, last, false, [&](int n) {
        for (int m = 0; m < extents.m; ++m) {
            const auto near = window.neighbours(m, n);
            const std::size_t k = at(m, n);
            mask[k] = near.mask;
            lower[k] = upper[k] = 0;
            if ((near.mask & kNoGradient) != 0) continue;
            const Bracket x = worker.bounds(window.row(n).hord(near.left), window.row(n).hord(near.right));
            const Bracket y = worker.bounds(window.row(near.above).hord(m), window.row(near.below).hord(m));
            lower[k] = rounded_down(EmdGradient{x.lower, y.lower, near.across.weight(), near.down.weight()}.norm());
            upper[k] = rounded_up(EmdGradient{x.upper, y.upper, near.across.weight(), near.down.weight()}.norm());
        }
    });
}

void AnytimeEmdMap::State::solve_piece() {
    std::array<std::uint32_t, kLensletsPerPiece> widest;
    int count = 0;
    for (; count < kLensletsPerPiece && !open.empty(); ++count) {
        std::pop_heap(open.begin(), open.end(), [this](auto a, auto b) { return narrower(a, b); });
        widest[static_cast<std::size_t>(count)] = open.back();
        open.pop_back();
    }
    pool->share_out((count + kShareLenslets - 1) / kShareLenslets, [&](int worker, int share) {
        const int from = share * kShareLenslets;
        solve_share(workers[static_cast<std::size_t>(worker)],
                    std::span(widest).subspan(static_cast<std::size_t>(from),
                                              static_cast<std::size_t>(std::min(kShareLenslets, count - from))));
    });
}

// Decodes the HORDs around each lenslet again: keeping all would take twice the memory of the frame.
void AnytimeEmdMap::State::solve_share(Worker& worker, std::span<const std::uint32_t> lenslets) {
    for (std::size_t l = 0; l < lenslets.size(); ++l) {
        const std::size_t k = lenslets[l], columns = static_cast<std::size_t>(extents.m);
        const int m = static_cast<int>(k % columns), n = static_cast<int>(k / columns);
        const Stencil across = stencil(has_hord(k - 1), has_hord(k + 1)),
                      down = stencil(has_hord(k - columns), has_hord(k + columns));
        const auto hord = [&](std::size_t place, int column, int row) {
            return decode_hord(frame, extents, levels, column, row, worker.masses[place]);
        };
        EmdGradient& gradient = worker.gradients[l];
        gradient = {0, 0, across.weight(), down.weight()};
        worker.solver.submit(hord(0, m + across.before, n), hord(1, m + across.after, n), &gradient.x);
        worker.solver.submit(hord(0, m, n + down.before), hord(1, m, n + down.after), &gradient.y);
    }
    worker.solver.finish();
    for (std::size_t l = 0; l < lenslets.size(); ++l)
        lower[lenslets[l]] = upper[lenslets[l]] = static_cast<float>(worker.gradients[l].norm());
}

Result<AnytimeEmdMap> AnytimeEmdMap::create(const Extents& extents, int bits, const LightLevels& levels,
                                            const GroundDistance& ground, int threads) {
    if (auto valid = check(extents); !valid) return tl::unexpected(valid.error());
    if (auto valid = check_bits(bits); !valid) return tl::unexpected(valid.error());
    if (auto valid = check_bins(ground, extents); !valid) return tl::unexpected(valid.error());
    auto pool = RowThreadPool::create(threads);
    if (!pool) return tl::unexpected(pool.error());
    auto state = std::make_unique<State>();
    state->extents = extents;
    state->bits = bits;
    state->levels = levels;
    state->largest = rounded_up(ground.largest() * kSqrt8);
    state->pool = std::move(*pool);
    for (int worker = 0; worker < threads; ++worker) {
        auto solver = EmdSolver::create(ground);
        if (!solver) return tl::unexpected(solver.error());
        state->workers.emplace_back(extents, ground, std::move(*solver));
    }
    state->lower.resize(extents.lenslets());
    state->upper.resize(extents.lenslets());
    state->mask.resize(extents.lenslets());
    state->open.reserve(extents.lenslets());
    return AnytimeEmdMap(std::move(state));
}

Result<BracketMap> AnytimeEmdMap::start(const FrameView& frame, const std::function<bool()>& may_go_on) {
    if (auto valid = check_frame(frame, state_->extents, state_->bits); !valid) return tl::unexpected(valid.error());
    state_->frame = frame;
    state_->begin();
    return refine(may_go_on);
}

BracketMap AnytimeEmdMap::refine(const std::function<bool()>& may_go_on) {
    State& s = *state_;
    while (s.rows_bounded < s.extents.n && may_go_on()) s.bound_round();
    while (s.rows_bounded == s.extents.n && !s.open.empty() && may_go_on()) s.solve_piece();
    return {s.lower, s.upper, s.mask, s.rows_bounded, s.open.size()};
}

AnytimeEmdMap::AnytimeEmdMap(std::unique_ptr<State> state) : state_(std::move(state)) {}
AnytimeEmdMap::AnytimeEmdMap(AnytimeEmdMap&&) noexcept = default;
AnytimeEmdMap& AnytimeEmdMap::operator=(AnytimeEmdMap&&) noexcept = default;
AnytimeEmdMap::~AnytimeEmdMap() = default;

}  // namespace hord::algo
