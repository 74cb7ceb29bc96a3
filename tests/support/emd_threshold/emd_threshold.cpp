#include "tests/support/emd_threshold/emd_threshold.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "algo/features/gradient.h"
#include "algo/features/row_window.h"
#include "algo/maps/row_thread_pool.h"
#include "tests/support/emd_threshold/emd_bounds.h"

namespace hord::algo {
namespace {

constexpr int kBandRows = 16;  // the undecided pairs of a band are solved in batches

struct Worker {
    Worker(const Extents& e, const GroundDistance& ground, EmdSolver s)
        : window(e), across(ground), down(ground), solver(std::move(s)),
          gradients(static_cast<std::size_t>(kBandRows * e.m)), open(gradients.size()) {}
    RowWindow window;
    EmdBounds across, down;  // of a lenslet
    EmdSolver solver;
    std::vector<EmdGradient> gradients;  // of the undecided lenslets
    std::vector<std::size_t> open;       // indices of the undecided lenslets
    std::size_t undecided = 0;
    std::uint64_t pairs = 0, solved = 0;
};

}  // namespace

struct EmdThresholdMap::State {
    Extents extents;
    int bits = 8;
    LightLevels levels;
    std::unique_ptr<RowThreadPool> pool;
    std::vector<Worker> workers;
    std::vector<std::uint8_t> at_or_above, mask;
    float limit = 0;

    void decide_band(Worker& worker, const FrameView& frame, int first, int last);
    EmdGradient* decide_by_bounds(Worker& worker, std::size_t k, int weight_x, int weight_y);
};

// Decides by the bounds, cheapest first. Returns null if they decide, otherwise where to write the exact distances.
EmdGradient* EmdThresholdMap::State::decide_by_bounds(Worker& worker, std::size_t k, int weight_x, int weight_y) {
    using Order = EmdBounds::Order;
    const EmdBounds &across = worker.across, &down = worker.down;
    const auto is_below = [&](double x, double y) {
        return static_cast<float>(EmdGradient{x, y, weight_x, weight_y}.norm()) < limit;
    };
    at_or_above[k] = 0;
    if (is_below(across.upper_by_mass(), down.upper_by_mass())) return nullptr;
    const double most_x = across.upper(Order::by_lines), most_y = down.upper(Order::by_lines);
    if (is_below(most_x, most_y)) return nullptr;
    at_or_above[k] = is_below(across.lower(), down.lower()) ? 0 : 1;
    if (at_or_above[k] != 0) return nullptr;
    if (is_below(std::min(most_x, across.upper(Order::by_columns)), std::min(most_y, down.upper(Order::by_columns))))
        return nullptr;
    worker.open[worker.undecided] = k;
    EmdGradient& gradients = worker.gradients[worker.undecided++];
    gradients = {0, 0, weight_x, weight_y};
    return &gradients;
}

void EmdThresholdMap::State::decide_band(Worker& worker, const FrameView& frame, int first, int last) {
    RowWindow& window = worker.window;
    window.stream(frame, levels, first, last, false, [&](int n) {
        for (int m = 0; m < extents.m; ++m) {
            const auto near = window.neighbours(m, n);
            const std::size_t k = extents.index(m, n);
            mask[k] = near.mask;
            at_or_above[k] = 0;
            if ((near.mask & kNoGradient) != 0) continue;
            const Hord left = window.row(n).hord(near.left), right = window.row(n).hord(near.right);
            const Hord above = window.row(near.above).hord(m), below = window.row(near.below).hord(m);
            worker.pairs += 2;
            worker.across.set_pair(left, right);
            worker.down.set_pair(above, below);
            EmdGradient* open = decide_by_bounds(worker, k, near.across.weight(), near.down.weight());
            if (open == nullptr) continue;
            worker.solver.submit(left, right, &open->x);
            worker.solver.submit(above, below, &open->y);
            worker.solved += 2;
        }
    });
    worker.solver.finish();
    for (std::size_t u = 0; u < worker.undecided; ++u)
        at_or_above[worker.open[u]] = static_cast<float>(worker.gradients[u].norm()) >= limit ? 1 : 0;
    worker.undecided = 0;
}

Result<EmdThresholdMap> EmdThresholdMap::create(const Extents& extents, int bits, const LightLevels& levels,
                                                const GroundDistance& ground, int threads) {
    if (auto valid = check(extents); !valid) return tl::unexpected(valid.error());
    if (auto valid = check_bits(bits); !valid) return tl::unexpected(valid.error());
    if (ground.bins_i() != extents.i || ground.bins_j() != extents.j) {
        return fail(ErrorCode::invalid_argument, "a ground distance between other bins than those of the lenslets",
                    "make one for the same bins");
    }
    auto pool = RowThreadPool::create(threads);
    if (!pool) return tl::unexpected(pool.error());
    auto state = common::make_opaque<State>();
    state->extents = extents;
    state->bits = bits;
    state->levels = levels;
    state->pool = std::move(*pool);
    for (int worker = 0; worker < threads; ++worker) {
        auto solver = EmdSolver::create(ground);
        if (!solver) return tl::unexpected(solver.error());
        state->workers.emplace_back(extents, ground, std::move(*solver));
    }
    state->at_or_above.resize(extents.lenslets());
    state->mask.resize(extents.lenslets());
    return EmdThresholdMap(std::move(state));
}

Result<DecisionMap> EmdThresholdMap::decide(const FrameView& frame, float limit) {
    State& s = *state_;
    if (auto valid = check_frame(frame, s.extents, s.bits); !valid) return tl::unexpected(valid.error());
    if (std::isnan(limit))
        return fail(ErrorCode::invalid_argument, "a limit that is not a number",
                    "give one in the ground distance's unit");
    s.limit = limit;
    for (Worker& worker : s.workers) worker.pairs = worker.solved = 0;
    s.pool->share_out((s.extents.n + kBandRows - 1) / kBandRows, [&](int worker, int band) {
        s.decide_band(s.workers[static_cast<std::size_t>(worker)], frame, band * kBandRows,
                      std::min((band + 1) * kBandRows, s.extents.n));
    });
    DecisionMap map{s.at_or_above, s.mask, 0, 0};
    for (const Worker& worker : s.workers) {
        map.pairs += worker.pairs;
        map.solved += worker.solved;
    }
    return map;
}

}  // namespace hord::algo
