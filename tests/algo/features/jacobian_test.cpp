#include "algo/features/jacobian.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

const double kEntryError = std::ldexp(1.0, -23);  // derived in docs/notes/features.md
const double kSingularError = std::ldexp(1.0, -21);
const double kNormError = 2 * kEntryError + std::ldexp(1.0, -25);  // four entries and the truncated root

Deflection deflection(double x, double y) {
    return {DeflectionQ::from_raw(std::lround(std::ldexp(x, 24))),
            DeflectionQ::from_raw(std::lround(std::ldexp(y, 24)))};
}

constexpr Stencil kCentral = stencil(true, true);

TEST(Stencil, is_central_where_it_can_be_and_one_sided_beside_a_hole) {
    EXPECT_EQ(kCentral.before, -1);
    EXPECT_EQ(kCentral.after, 1);
    EXPECT_EQ(kCentral.weight(), 1);
    EXPECT_EQ(stencil(false, true).before, 0);
    EXPECT_EQ(stencil(false, true).weight(), 2);
    EXPECT_EQ(stencil(true, false).after, 0);
    EXPECT_EQ(stencil(true, false).weight(), 2);
    EXPECT_FALSE(stencil(false, false).valid());
}

TEST(Jacobian, of_hand_written_deflections) {
    const Jacobian j = jacobian_of(kCentral, deflection(-1, 0.5), deflection(2, 0.25), kCentral, deflection(0, -3),
                                   deflection(-0.5, 3));
    EXPECT_EQ(j.x_by_m.to_double_rounded(), 1.5);
    EXPECT_EQ(j.y_by_m.to_double_rounded(), -0.125);
    EXPECT_EQ(j.x_by_n.to_double_rounded(), -0.25);
    EXPECT_EQ(j.y_by_n.to_double_rounded(), 3.0);
    const Jacobian right_triangle =
        jacobian_of(kCentral, deflection(0, 0), deflection(6, 0), kCentral, deflection(0, 0), deflection(0, 8));
    EXPECT_EQ(frobenius_norm(right_triangle).to_double_rounded(), 5.0);  // 3 and 4
    EXPECT_EQ(frobenius_norm(Jacobian{}).raw(), 0);
}

TEST(Jacobian, of_a_linear_field_is_the_same_beside_a_hole) {
    const Jacobian whole = jacobian_of(kCentral, deflection(-0.25, 0), deflection(0.25, 0), kCentral,
                                       deflection(0, -0.5), deflection(0, 0.5));
    const Jacobian beside = jacobian_of(stencil(false, true), deflection(0, 0), deflection(0.25, 0),
                                        stencil(true, false), deflection(0, -0.5), deflection(0, 0));
    EXPECT_EQ(whole.x_by_m, beside.x_by_m);
    EXPECT_EQ(whole.y_by_n, beside.y_by_n);
}

TEST(Jacobian, is_within_its_bound_of_double) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> bins(-7, 7);
    for (int round = 0; round < 20000; ++round) {
        const double scale = std::ldexp(1.0, -static_cast<int>(random() % 20));
        std::array<double, 8> v{};
        for (double& value : v) value = bins(random) * scale;
        const Jacobian j = jacobian_of(kCentral, deflection(v[0], v[1]), deflection(v[2], v[3]), kCentral,
                                       deflection(v[4], v[5]), deflection(v[6], v[7]));
        const double xm = (v[2] - v[0]) / 2, ym = (v[3] - v[1]) / 2, xn = (v[6] - v[4]) / 2, yn = (v[7] - v[5]) / 2;
        EXPECT_NEAR(j.x_by_m.to_double_rounded(), xm, kEntryError);
        EXPECT_NEAR(j.x_by_n.to_double_rounded(), xn, kEntryError);
        EXPECT_NEAR(j.y_by_m.to_double_rounded(), ym, kEntryError);
        EXPECT_NEAR(j.y_by_n.to_double_rounded(), yn, kEntryError);
        EXPECT_NEAR(frobenius_norm(j).to_double_rounded(), std::sqrt(xm * xm + ym * ym + xn * xn + yn * yn),
                    kNormError);
    }
    EXPECT_LT(kNormError, std::ldexp(1.0, -12));
}

Jacobian written(double x_m, double x_n, double y_m, double y_n) {
    const auto q = [](double value) { return SlopeQ::from_raw(std::lround(std::ldexp(value, 25))); };
    return {q(x_m), q(x_n), q(y_m), q(y_n)};
}

TEST(SingularNorms, of_hand_written_jacobians) {
    const SingularNorms lens = singular_norms(written(-0.5, 0, 0, -0.5));  // the same in every direction
    EXPECT_EQ(lens.nuclear.to_double_rounded(), 1.0);
    EXPECT_EQ(lens.spectral.to_double_rounded(), 0.5);
    EXPECT_EQ(lens.anisotropy.raw(), 0);
    const SingularNorms scratch = singular_norms(written(3, 4, 0, 0));  // one direction only
    EXPECT_EQ(scratch.nuclear.to_double_rounded(), 5.0);
    EXPECT_EQ(scratch.spectral.to_double_rounded(), 5.0);
    EXPECT_EQ(scratch.anisotropy.to_double_rounded(), 1.0);
    const SingularNorms both = singular_norms(written(0, 3, -1, 0));  // singular values 3 and 1
    EXPECT_EQ(both.nuclear.to_double_rounded(), 4.0);
    EXPECT_EQ(both.spectral.to_double_rounded(), 3.0);
    EXPECT_EQ(both.anisotropy.to_double_rounded(), 0.5);
    const SingularNorms none = singular_norms({});
    EXPECT_EQ(none.nuclear.raw(), 0);
    EXPECT_EQ(none.spectral.raw(), 0);
    EXPECT_EQ(none.anisotropy.raw(), 0);
}

TEST(SingularNorms, are_within_their_bounds_of_double_from_tiny_to_huge_and_nearly_rank_one) {
    std::mt19937 random(6);
    std::uniform_real_distribution<double> entry(-14, 14);
    for (int round = 0; round < 40000; ++round) {
        const double scale = std::ldexp(1.0, -static_cast<int>(random() % 24));
        double a = entry(random) * scale, b = entry(random) * scale, c = entry(random) * scale,
               d = entry(random) * scale;
        if (round % 3 == 0) d = b * c / (a == 0 ? 1 : a);                                         // singular
        if (round % 3 == 1) d = b * c / (a == 0 ? 1 : a) * (1 + std::ldexp(entry(random), -20));  // nearly
        if (std::abs(d) > 14) continue;
        const SingularNorms norms = singular_norms(written(a, b, c, d));
        const double p = std::hypot(a + d, b - c), q = std::hypot(a - d, b + c);
        ASSERT_NEAR(norms.nuclear.to_double_rounded(), std::max(p, q), kSingularError);
        ASSERT_NEAR(norms.spectral.to_double_rounded(), (p + q) / 2, kSingularError);
        if (std::max(p, q) > 0.01) {
            // a change of kSingularError in either root changes their ratio by at most twice that over the larger
            ASSERT_NEAR(norms.anisotropy.to_double_rounded(), std::min(p, q) / std::max(p, q),
                        2 * kSingularError / std::max(p, q) + std::ldexp(1.0, -24));
        }
        ASSERT_LE(norms.anisotropy.to_double_rounded(), 1.0);
        // spectral <= Frobenius <= nuclear
        ASSERT_LE(norms.spectral.to_double_rounded(),
                  frobenius_norm(written(a, b, c, d)).to_double_rounded() + kSingularError);
        ASSERT_GE(norms.nuclear.to_double_rounded(),
                  frobenius_norm(written(a, b, c, d)).to_double_rounded() - kSingularError);
    }
    EXPECT_LT(kSingularError, std::ldexp(1.0, -12));
}

TEST(SingularNorms, of_the_largest_jumps_stay_in_range) {
    const SingularNorms norms = singular_norms(written(14, 14, 14, -14));
    EXPECT_NEAR(norms.nuclear.to_double_rounded(), 28 * std::sqrt(2.0), kSingularError);
    EXPECT_NEAR(norms.spectral.to_double_rounded(), 14 * std::sqrt(2.0), kSingularError);
    EXPECT_EQ(singular_norms(written(14, 14, 14, 14)).spectral.to_double_rounded(), 28.0);
}

TEST(Jacobian, of_the_largest_jumps_stays_in_range) {
    const Stencil one_sided = stencil(true, false);
    const Jacobian j =
        jacobian_of(one_sided, deflection(-7, 7), deflection(7, -7), one_sided, deflection(7, 7), deflection(-7, -7));
    EXPECT_EQ(j.x_by_m.to_double_rounded(), 14.0);
    EXPECT_EQ(frobenius_norm(j).to_double_rounded(), 28.0);
}

}  // namespace
}  // namespace hord::algo
