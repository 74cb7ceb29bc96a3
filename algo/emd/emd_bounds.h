// Decide without computing everything: brackets of the earth mover's distance, and exact solves only where they matter.
//
//   lower   from W1 of the two marginals (Jensen): sqrt(x^2 + y^2) for the Euclidean ground, x + y for Manhattan, x^2 +
//   y^2 for
//           squared Euclidean; 0 where the ground is cut off at a threshold.
//   upper   what is not shared, times the largest cost: nearly for nothing, and enough where neighbours agree. Else the
//   cheaper of two plans that
//           move it in order: line by line, and column by column.
// Both are widened by 2^-35 of the largest cost, so that they hold the very value EmdSolver returns, rounding included:
// decisions are the same as from exact distances, for every pair. Formats and ranges are those of emd_solver.h.
//
// Tests: tests/algo/emd/emd_bounds_test.cpp.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "algo/emd/emd_solver.h"
#include "algo/emd/projection.h"

namespace hord::algo {

struct Bracket {
    double lower = 0;
    double upper = 0;
    [[nodiscard]] double width() const { return upper - lower; }
};

// Not thread-safe. Allocates only in its constructor.
class EmdBounds {
  public:
    explicit EmdBounds(const GroundDistance& ground);

    // What the bounds are of, one by one: but for upper_by_mass() each costs as much as a small exact solve side by
    // side, and often one is enough. All are 0 when either HORD is dark.
    void take(const Hord& a, const Hord& b);
    [[nodiscard]] double lower() const;
    [[nodiscard]] double upper_by_mass() const;
    enum class Order : std::uint8_t { by_lines, by_columns };
    [[nodiscard]] double upper(Order order) const;

    [[nodiscard]] Bracket operator()(const Hord& a, const Hord& b);

  private:
    // An order of bins, and where each is in it.
    struct Places {
        std::vector<std::uint8_t> bin_at, place_of;
        bool as_numbered = false;
    };
    [[nodiscard]] double plan_in_order(const Places& places) const;

    GroundDistance ground_;
    Projection x_, y_;
    Places orders_[2];
    Difference difference_;
    double unit_ = 1;              // S_a * S_b
    std::int64_t not_shared_ = 0;  // < 2^48
    double margin_;
};

// Whether distances exceed a limit: what `EmdSolver::distance(a, b) > limit` says, mostly without solving.
class EmdDecider {
  public:
    static Result<EmdDecider> create(const GroundDistance& ground);

    [[nodiscard]] bool exceeds(const Hord& a, const Hord& b, double limit);
    // The same for a gradient's norm: sqrt(EMD(left, right)^2 + EMD(above, below)^2) > limit.
    [[nodiscard]] bool gradient_exceeds(const Hord& left, const Hord& right, const Hord& above, const Hord& below,
                                        double limit);

    [[nodiscard]] std::uint64_t solved() const { return solver_.work().pairs; }

  private:
    EmdDecider(const GroundDistance& ground, EmdSolver solver) : bounds_(ground), solver_(std::move(solver)) {}
    EmdBounds bounds_;
    EmdSolver solver_;
};

// As good as the time allows: a bracket for every pair at once, then the widest ones solved until a deadline. Whoever
// judges by `upper` never misses what the exact distance would have found, whenever the deadline came.
class AnytimeEmd {
  public:
    // Room for so many pairs; nothing is allocated later.
    static Result<AnytimeEmd> create(const GroundDistance& ground, std::size_t most_pairs);

    void clear();
    // Brackets the pair; false when there is no room. The HORDs must stay valid until the last refine().
    bool add(const Hord& a, const Hord& b);
    // Solves the widest bracket, again and again, while now() < deadline_ns. Returns how many are still open.
    std::size_t refine(const std::function<std::int64_t()>& now, std::int64_t deadline_ns);
    // In the order of add(). Exact ones have lower == upper.
    [[nodiscard]] std::span<const Bracket> brackets() const { return brackets_; }

  private:
    AnytimeEmd(const GroundDistance& ground, EmdSolver solver, std::size_t most_pairs);
    EmdBounds bounds_;
    EmdSolver solver_;
    std::size_t most_pairs_;
    std::vector<std::array<Hord, 2>> pairs_;
    std::vector<Bracket> brackets_;
    std::vector<std::uint32_t> open_;  // a heap, widest first
    bool is_heap_ = false;
};

}  // namespace hord::algo
