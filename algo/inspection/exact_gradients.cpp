#include "algo/inspection/exact_gradients.h"

#include <algorithm>

namespace hord::algo {
namespace {

// Work of a lenslet, in about nanoseconds of one core with AVX-512 (docs/notes/inspection.md): for its HORDs, and for
// each pair, that grows with the square of the bins lit in either.
constexpr std::int64_t kLensletWork = 300, kPairWork = 80;
constexpr std::int64_t pair_work(std::int64_t bins) { return kPairWork + bins * bins * 11 / 4; }

// Work between two looks at the clock.
constexpr std::int64_t kChunkWork = 1'000'000;

std::int64_t lit_in_either(const Hord& a, const Hord& b, int bins) {
    int lit = 0;
    for (int k = 0; k < bins; ++k) lit += (a.mass[k] | b.mass[k]) != 0 ? 1 : 0;
    return lit;
}

}  // namespace

ExactGradients::ExactGradients(const Extents& extents, float limit_bins, RowThreadPool& pool,
                               std::vector<Worker> workers)
    : extents_(extents), limit_bins_(limit_bins), pool_(&pool), workers_(std::move(workers)),
      is_bound_(extents.lenslets()), order_(extents.lenslets()) {}

Result<ExactGradients> ExactGradients::create(const Extents& extents, float limit_bins, RowThreadPool& pool) {
    const auto ground = GroundDistance::between_bins(extents.i, extents.j);
    if (!ground) return tl::unexpected(ground.error());
    std::vector<Worker> workers;
    for (int worker = 0; worker < pool.threads(); ++worker) {
        auto solver = EmdSolver::create(*ground);
        if (!solver) return tl::unexpected(solver.error());
        workers.emplace_back(Extents{1, 1, extents.i, extents.j}, std::move(*solver));
    }
    return ExactGradients(extents, limit_bins, pool, std::move(workers));
}

void ExactGradients::start(const FrameView& frame, const LightLevels& levels, std::span<const std::uint8_t> mask,
                           std::span<float> gradient, const InspectionLimits& limits, NowNs now, std::int64_t end_ns) {
    frame_ = frame;
    levels_ = levels;
    mask_ = mask;
    gradient_ = gradient;
    now_ = now;
    end_ns_ = end_ns;
    out_of_time_ = false;
    work_left_ = limits.work + limits.work_a_lenslet * static_cast<std::int64_t>(extents_.lenslets());
    work_done_ = solved_ = 0;
    std::ranges::transform(mask, is_bound_.begin(),
                           [](std::uint8_t bits) -> std::uint8_t { return (bits & kNoGradient) == 0 ? 1 : 0; });
}

bool ExactGradients::may_go_on() {
    if (now_ != nullptr && end_ns_ != 0 && now_() >= end_ns_) out_of_time_ = true;
    return !out_of_time_ && work_left_ > 0;
}

// As many lenslets, at the work that a lenslet took so far, as the budget and the clock allow.
std::size_t ExactGradients::next_chunk(std::size_t limit) const {
    if (solved_ == 0) return kFirstChunk;
    const std::int64_t each = std::max<std::int64_t>(1, work_done_ / solved_);
    const auto affordable = static_cast<std::size_t>(std::min(kChunkWork, work_left_) / each);
    return std::clamp(affordable, std::size_t{1}, limit);
}

// Lenslets that the budget can pay for, each with the least work.
std::size_t ExactGradients::most_affordable() const {
    return static_cast<std::size_t>(std::max<std::int64_t>(work_left_, 0) / (kLensletWork + 2 * kPairWork) + 1);
}

// Solves the lenslets that the budget pays for, at least one. They are then at the front; returns how many.
std::size_t ExactGradients::solve(std::span<std::uint32_t> lenslets) {
    const auto share = [&](std::size_t s) {
        return lenslets.subspan(s * kShare, std::min(kShare, lenslets.size() - s * kShare));
    };
    const std::size_t shares = (lenslets.size() + kShare - 1) / kShare;
    if (shares == 0) return 0;
    const std::int64_t budget = std::min(kChunkWork, work_left_) / static_cast<std::int64_t>(shares);
    const auto solve_one = [&](int worker, std::size_t s) {
        shares_done_[s] = solve_share(workers_[static_cast<std::size_t>(worker)], share(s), budget, s == 0);
    };
    if (shares == 1) solve_one(0, 0);  // not worth waking other threads
    else
        pool_->share_out(static_cast<int>(shares),
                         [&](int worker, int s) { solve_one(worker, static_cast<std::size_t>(s)); });
    std::size_t solved = 0, unsolved = 0;
    for (std::size_t s = 0; s < shares; ++s) {
        const std::span<const std::uint32_t> of_share = share(s);
        for (std::size_t k = 0; k < of_share.size(); ++k)
            (k < shares_done_[s].solved ? lenslets[solved++] : unsolved_[unsolved++]) = of_share[k];
        work_left_ -= shares_done_[s].work;
        work_done_ += shares_done_[s].work;
    }
    std::copy_n(unsolved_.begin(), unsolved, lenslets.begin() + static_cast<std::ptrdiff_t>(solved));
    solved_ += static_cast<std::int64_t>(solved);
    return solved;
}

// The HORD of lenslet (m, n) into place `at`.
void ExactGradients::decode(Worker& worker, int at, int m, int n) const {
    const Extents one{1, 1, extents_.i, extents_.j};
    const int x = m * extents_.i;
    const FrameView of_lenslet{frame_.data + n * extents_.j * frame_.stride_bytes + x * frame_.sample_bytes(),
                               frame_.width_px - x, extents_.j, frame_.stride_bytes, frame_.bits};
    const auto place = static_cast<std::size_t>(at);
    HordRow& row = worker.hords[place];
    decode_row(of_lenslet, one, levels_, 0, row);
    worker.solver.compact()(row.hord(0).mass, row.sums(), one.bins(), &worker.sparse[place]);
}

// Stops before the lenslet that would exceed the budget.
ExactGradients::ShareDone ExactGradients::solve_share(Worker& worker, std::span<const std::uint32_t> lenslets,
                                                      std::int64_t budget, bool at_least_one) {
    const auto has_hord = [&](std::size_t k) { return (mask_[k] & kNoHord) == 0; };
    const auto columns = static_cast<std::size_t>(extents_.m);
    ShareDone done;
    for (std::size_t s = 0; s < lenslets.size(); ++s) {
        const std::size_t k = lenslets[s];
        const int m = static_cast<int>(k % columns), n = static_cast<int>(k / columns);
        const Stencil across = stencil(has_hord(k - 1), has_hord(k + 1)),
                      down = stencil(has_hord(k - columns), has_hord(k + columns));
        decode(worker, 0, m + across.before, n);
        decode(worker, 1, m + across.after, n);
        decode(worker, 2, m, n + down.before);
        decode(worker, 3, m, n + down.after);
        const auto& h = worker.sparse;
        const std::int64_t work = kLensletWork + pair_work(lit_in_either(h[0].hord(), h[1].hord(), extents_.bins())) +
            pair_work(lit_in_either(h[2].hord(), h[3].hord(), extents_.bins()));
        if (done.work + work > budget && !(at_least_one && s == 0)) break;
        submit_emd_gradient(worker.solver, across, h[0], h[1], down, h[2], h[3], worker.gradients[s]);
        done.work += work;
        ++done.solved;
    }
    worker.solver.finish();
    for (std::size_t s = 0; s < done.solved; ++s) {
        const std::size_t k = lenslets[s];
        gradient_[k] = static_cast<float>(worker.gradients[s].norm());
        is_bound_[k] = 0;
    }
    return done;
}

}  // namespace hord::algo
