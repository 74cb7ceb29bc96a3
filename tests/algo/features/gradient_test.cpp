#include "algo/features/gradient.h"

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/features/jacobian.h"

namespace hord::algo {
namespace {

struct Masses {
    std::vector<std::uint16_t> mass;
    [[nodiscard]] Hord hord() const {
        std::uint32_t sum = 0;
        for (const std::uint16_t a : mass) sum += a;
        return {mass.data(), sum};
    }
    [[nodiscard]] Deflection mean(int i, int j) const {
        std::int32_t x = 0, y = 0;
        for (int k = 0; k < i * j; ++k) {
            x += (2 * (k % i) - (i - 1)) * mass[static_cast<std::size_t>(k)];
            y += (2 * (k / i) - (j - 1)) * mass[static_cast<std::size_t>(k)];
        }
        return mean_deflection(hord().sum, x, y);
    }
};

EmdSolver solver_for(int i, int j) { return std::move(*EmdSolver::create(*GroundDistance::between_bins(i, j))); }

EmdGradient emd_gradient(EmdSolver& solver, const Stencil& across, const Masses& left, const Masses& right,
                         const Stencil& down, const Masses& above, const Masses& below) {
    EmdGradient gradient;
    const auto closed = [&](const Masses& m) {
        SparseHord hord;
        const std::array sum{m.hord().sum};
        solver.compact()(m.mass.data(), std::span(sum), static_cast<int>(m.mass.size()), &hord);
        return hord;
    };
    submit_emd_gradient(solver, across, closed(left), closed(right), down, closed(above), closed(below), gradient);
    solver.finish();
    return gradient;
}

constexpr Stencil kCentral = stencil(true, true);

TEST(EmdGradient, of_hand_written_neighbours) {
    EmdSolver solver = solver_for(3, 3);
    const Masses left{{0, 0, 0, 4, 0, 0, 0, 0, 0}}, right{{0, 0, 0, 0, 0, 7, 0, 0, 0}};  // two bins apart
    const Masses above{{0, 0, 0, 0, 6, 0, 0, 0, 0}},
        below{{1, 0, 1, 0, 0, 0, 1, 0, 1}};  // from the centre to all corners
    const EmdGradient g = emd_gradient(solver, kCentral, left, right, kCentral, above, below);
    EXPECT_NEAR(g.x, 2.0, 1e-9);
    EXPECT_NEAR(g.y, std::sqrt(2.0), 1e-9);
    EXPECT_NEAR(g.norm(), std::sqrt(6.0), 1e-9);
}

TEST(EmdGradient, counts_a_one_sided_difference_twice) {
    EmdSolver solver = solver_for(3, 3);
    const Masses a{{0, 0, 0, 1, 0, 0, 0, 0, 0}}, b{{0, 0, 0, 0, 1, 0, 0, 0, 0}};
    const EmdGradient g = emd_gradient(solver, stencil(false, true), a, b, stencil(true, false), a, a);
    EXPECT_NEAR(g.norm(), 2.0, 1e-9);
    EXPECT_EQ(g.y, 0.0);
}

// EMD is never less than the distance of the means, so the gradient is never less than twice the Jacobian's norm.
TEST(EmdGradient, is_at_least_twice_the_frobenius_norm) {
    std::mt19937 random(8);
    for (int round = 0; round < 3000; ++round) {
        const int i = 3 + static_cast<int>(random() % 8), j = 3 + static_cast<int>(random() % 8);
        EmdSolver solver = solver_for(i, j);
        Masses around[4];
        for (Masses& m : around) {
            m.mass.resize(static_cast<std::size_t>(i * j));
            for (int lit = 1 + static_cast<int>(random() % 6); lit > 0; --lit)
                m.mass[random() % m.mass.size()] = static_cast<std::uint16_t>(1 + random() % 255);
        }
        const double emd = emd_gradient(solver, kCentral, around[0], around[1], kCentral, around[2], around[3]).norm();
        const SlopeQ slope = frobenius_norm(jacobian_of(kCentral, around[0].mean(i, j), around[1].mean(i, j), kCentral,
                                                        around[2].mean(i, j), around[3].mean(i, j)));
        ASSERT_GE(emd, 2 * slope.to_double_rounded() - 1e-6);  // the slope's own error, algo/features/jacobian.h
    }
}

}  // namespace
}  // namespace hord::algo
