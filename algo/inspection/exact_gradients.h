// Replaces upper bounds of the EMD gradient (algo/soa/soa_emd_bounds.h) by its exact values, lenslet by lenslet, where
// a verdict needs them and as long as the budgets last (docs/notes/inspection.md, "Bounded time").
//
// The order in which lenslets are solved, and where the budget of work ends, depend on the frame alone, not on the
// number of threads. Values are the bits of algo/maps/feature_map.h. Nothing is allocated after create().
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algo/emd/emd_solver.h"
#include "algo/features/gradient.h"
#include "algo/frame/decode.h"
#include "algo/frame/lenslet_scan.h"
#include "algo/inspection/pipeline.h"
#include "algo/maps/row_thread_pool.h"

namespace hord::algo {

class ExactGradients {
  public:
    // `limit_bins`: of the gradient. `pool` outlives this. Fails as GroundDistance and EmdSolver do.
    static Result<ExactGradients> create(const Extents& extents, float limit_bins, RowThreadPool& pool);

    // Starts a frame. `mask`: kDark, kSaturated and kBorder of every lenslet; `gradient`: upper bounds, 0 where there
    // is no gradient. Both stay in place until the next start(). `now` may be null; `end_ns`: when time runs out, 0:
    // never.
    void start(const FrameView& frame, const LightLevels& levels, std::span<const std::uint8_t> mask,
               std::span<float> gradient, const InspectionLimits& limits, NowNs now, std::int64_t end_ns);

    // 1: the lenslet's gradient is an upper bound; 0: it is exact, or there is none.
    [[nodiscard]] std::span<const std::uint8_t> bounds() const { return is_bound_; }
    [[nodiscard]] bool out_of_work() const { return work_left_ <= 0; }
    [[nodiscard]] bool out_of_time() const { return out_of_time_; }

    // Below every gradient that has this severity, a value over the limit, rounding included.
    [[nodiscard]] float least_gradient(float severity) const { return severity * limit_bins_ * 0.999F; }

    // Solves all lenslets with a gradient of at least `least` and severity(k) >= level > 0, largest first. `severity`:
    // computed from gradient[k], not decreasing with it, and quick: it is asked of every lenslet. False if a budget ran
    // out before.
    template <class Severity>
    bool solve_from(float level, float least, Severity&& severity) {
        const auto wanted = [&, gradient = gradient_, bound = is_bound_.data()](std::size_t k) {
            return (gradient[k] >= least) & (bound[k] != 0) & (severity(k) >= level);
        };
        const bool all = sort_candidates(
            wanted, wanted, [&](std::uint32_t k) { return (severity(k) - level) / (4 * level); }, most_affordable());
        std::size_t next = 0;
        while (next < candidates_) {
            if (!may_go_on()) return false;
            const std::size_t count = std::min(next_chunk(kMaxChunk), candidates_ - next);
            next += solve(std::span(order_).subspan(next, count));
        }
        return all;
    }

    // The largest of `known`, kInsignificantScore, and of the severities below `ceiling` of lenslets that are bounds,
    // by branch and bound; severity(k) is at most `known`, or at most gradient[k] over the limit. Only lenslets whose
    // bound exceeds the largest value found so far are solved, largest bound first. `all_known` is false if a budget
    // ran out; the result is then the largest bound.
    template <class Severity>
    float largest(float known, float ceiling, Severity&& severity, bool& all_known) {
        all_known = true;
        known = std::max(known, kInsignificantScore);
        const float floor = known, least = least_gradient(known);
        const auto may_be_wanted = [=, gradient = gradient_, bound = is_bound_.data()](std::size_t k) {
            return (gradient[k] >= least) & (bound[k] != 0);
        };
        const auto wanted = [&](std::size_t k) {
            const float value = severity(k);
            return value > floor && value < ceiling;
        };
        sort_candidates(
            may_be_wanted, wanted, [&](std::uint32_t k) { return (severity(k) - floor) / (ceiling - floor); },
            is_bound_.size());
        std::size_t next = 0, limit = kFirstChunk;
        while (next < candidates_) {
            if (!may_go_on()) {
                all_known = false;
                break;
            }
            // Those that may still exceed the largest value, at the front of what is left of order_.
            const std::size_t most = next_chunk(limit), first = next;
            std::size_t count = 0;
            for (; next < candidates_ && count < most; ++next) {
                if (severity(order_[next]) > known) order_[first + count++] = order_[next];
            }
            const std::size_t solved = solve(std::span(order_).subspan(first, count));
            for (std::size_t k = first; k < first + solved; ++k) known = std::max(known, severity(order_[k]));
            // The others stay candidates, in front of what was not looked at.
            for (std::size_t k = first + count; k > first + solved; --k) order_[--next] = order_[k - 1];
            limit = std::min(2 * limit, kMaxChunk);
        }
        for (; next < candidates_; ++next) known = std::max(known, severity(order_[next]));
        return known;
    }

  private:
    static constexpr std::size_t kFirstChunk = 4, kMaxChunk = 4096;  // lenslets between two looks at the budgets
    static constexpr std::size_t kShare = 64;                        // lenslets that a thread takes at once
    static constexpr int kBuckets = 256;

    struct ShareDone {
        std::size_t solved = 0;
        std::int64_t work = 0;
    };

    // The working memory of one thread.
    struct Worker {
        Worker(const Extents& bins, EmdSolver emd_solver)
            : hords{HordRow(bins), HordRow(bins), HordRow(bins), HordRow(bins)}, solver(std::move(emd_solver)) {}
        std::array<HordRow, 4> hords;  // of one lenslet each
        std::array<SparseHord, 4> sparse;
        EmdSolver solver;
        std::array<EmdGradient, kShare> gradients;
    };

    ExactGradients(const Extents& extents, float limit_bins, RowThreadPool& pool, std::vector<Worker> workers);

    // order_: the lenslets with may_be_wanted(k), free of branches, and wanted(k), by falling place(k) in kBuckets
    // buckets of 0..1, then by number. Buckets after the first `most` lenslets are left out; false if there are any.
    template <class Candidate, class Wanted, class Place>
    bool sort_candidates(const Candidate& may_be_wanted, const Wanted& wanted, const Place& place, std::size_t most) {
        const auto bucket = [&](std::uint32_t k) {
            return static_cast<std::size_t>(kBuckets - 1) -
                static_cast<std::size_t>(std::clamp(place(k), 0.0F, 0.999F) * kBuckets);
        };
        std::array<std::uint32_t, kBuckets> next{};
        const auto for_each_wanted = [&](auto&& visit) {
            for_each_suiting(0, is_bound_.size(), may_be_wanted, [&](std::size_t k) {
                if (wanted(k)) visit(static_cast<std::uint32_t>(k));
            });
        };
        candidates_ = 0;
        std::size_t all = 0;
        for_each_wanted([&](std::uint32_t k) {
            ++next[bucket(k)];
            ++all;
        });
        if (all == 0) return true;
        std::size_t buckets = 0;
        for (; buckets < next.size() && candidates_ < most; ++buckets) {
            candidates_ +=
                std::exchange(next[buckets], static_cast<std::uint32_t>(candidates_));  // now: its first place
        }
        for_each_wanted([&](std::uint32_t k) {
            if (const std::size_t b = bucket(k); b < buckets) order_[next[b]++] = k;
        });
        return candidates_ == all;
    }
    [[nodiscard]] std::size_t most_affordable() const;
    bool may_go_on();
    [[nodiscard]] std::size_t next_chunk(std::size_t limit) const;
    std::size_t solve(std::span<std::uint32_t> lenslets);
    ShareDone solve_share(Worker& worker, std::span<const std::uint32_t> lenslets, std::int64_t budget,
                          bool at_least_one);
    void decode(Worker& worker, int at, int m, int n) const;

    Extents extents_;
    float limit_bins_;
    RowThreadPool* pool_;
    std::vector<Worker> workers_;
    std::vector<std::uint8_t> is_bound_;
    std::vector<std::uint32_t> order_;
    std::size_t candidates_ = 0;
    std::array<ShareDone, kMaxChunk / kShare> shares_done_{};
    std::array<std::uint32_t, kMaxChunk> unsolved_{};

    // Of the present frame.
    FrameView frame_;
    LightLevels levels_;
    std::span<const std::uint8_t> mask_;
    std::span<float> gradient_;
    NowNs now_ = nullptr;
    std::int64_t end_ns_ = 0;
    bool out_of_time_ = false;
    std::int64_t work_left_ = 0, work_done_ = 0, solved_ = 0;
};

}  // namespace hord::algo
