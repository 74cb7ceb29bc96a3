// Lower and upper bounds of the earth mover's distance. They decide most comparisons with a limit without a solver.
//
//   lower  from the W1 of the two marginals (Jensen): sqrt(x^2 + y^2) for Euclidean ground, x + y for Manhattan,
//          x^2 + y^2 for squared Euclidean; 0 if the ground distance has a threshold.
//   upper  the mass not shared times the largest cost; or, tighter, the cheaper of two plans that move mass in order,
//          line by line and column by column.
// Both are widened by 2^-35 of the largest cost, so that they hold the double that EmdSolver returns, rounding
// included. Formats and ranges are those of emd_solver.h. Test: tests/support/emd_threshold/emd_bounds_test.cpp.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/emd/emd_solver.h"
#include "algo/emd/projection.h"

namespace hord::algo {

// Not thread-safe. Allocates only in its constructor.
class EmdBounds {
  public:
    explicit EmdBounds(const GroundDistance& ground);

    // Sets the pair that the functions below bound. Each costs as much as a small exact solve in a batch, except
    // upper_by_mass(), which is nearly free. All are 0 if either HORD is dark.
    void set_pair(const Hord& a, const Hord& b);
    [[nodiscard]] double lower() const;
    [[nodiscard]] double upper_by_mass() const;
    enum class Order : std::uint8_t { by_lines, by_columns };
    [[nodiscard]] double upper(Order order) const;

  private:
    struct BinOrder {
        std::vector<std::uint8_t> bin_at, place_of;  // inverse of each other
        bool is_identity = false;
    };
    [[nodiscard]] double plan_in_order(const BinOrder& order) const;

    GroundDistance ground_;
    Projection x_, y_;
    BinOrder orders_[2];
    Difference difference_;
    double unit_ = 1;              // S_a * S_b
    std::int64_t not_shared_ = 0;  // < 2^48
    double margin_;
};

}  // namespace hord::algo
