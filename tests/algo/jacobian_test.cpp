#include "algo/jacobian.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

namespace hord::algo {
namespace {

const double kEntryError = std::ldexp(1.0, -23);                            // derived in algo/jacobian.h
const double kNormError = 2 * kEntryError + std::ldexp(1.0, -25);           // four entries, and the floored root

Deflection deflection(double x, double y) {
    return {DeflectionQ::from_raw(std::lround(std::ldexp(x, 24))), DeflectionQ::from_raw(std::lround(std::ldexp(y, 24)))};
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
    const Jacobian j = jacobian_of(kCentral, deflection(-1, 0.5), deflection(2, 0.25), kCentral, deflection(0, -3), deflection(-0.5, 3));
    EXPECT_EQ(j.x_by_m.to_double_rounded(), 1.5);
    EXPECT_EQ(j.y_by_m.to_double_rounded(), -0.125);
    EXPECT_EQ(j.x_by_n.to_double_rounded(), -0.25);
    EXPECT_EQ(j.y_by_n.to_double_rounded(), 3.0);
    const Jacobian right_triangle = jacobian_of(kCentral, deflection(0, 0), deflection(6, 0), kCentral, deflection(0, 0), deflection(0, 8));
    EXPECT_EQ(frobenius_norm(right_triangle).to_double_rounded(), 5.0);  // 3 and 4
    EXPECT_EQ(frobenius_norm(Jacobian{}).raw(), 0);
}

TEST(Jacobian, of_a_linear_field_is_the_same_beside_a_hole) {
    const Jacobian whole = jacobian_of(kCentral, deflection(-0.25, 0), deflection(0.25, 0), kCentral, deflection(0, -0.5), deflection(0, 0.5));
    const Jacobian beside = jacobian_of(stencil(false, true), deflection(0, 0), deflection(0.25, 0), stencil(true, false), deflection(0, -0.5),
                                        deflection(0, 0));
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
        const Jacobian j = jacobian_of(kCentral, deflection(v[0], v[1]), deflection(v[2], v[3]), kCentral, deflection(v[4], v[5]), deflection(v[6], v[7]));
        const double xm = (v[2] - v[0]) / 2, ym = (v[3] - v[1]) / 2, xn = (v[6] - v[4]) / 2, yn = (v[7] - v[5]) / 2;
        EXPECT_NEAR(j.x_by_m.to_double_rounded(), xm, kEntryError);
        EXPECT_NEAR(j.x_by_n.to_double_rounded(), xn, kEntryError);
        EXPECT_NEAR(j.y_by_m.to_double_rounded(), ym, kEntryError);
        EXPECT_NEAR(j.y_by_n.to_double_rounded(), yn, kEntryError);
        EXPECT_NEAR(frobenius_norm(j).to_double_rounded(), std::sqrt(xm * xm + ym * ym + xn * xn + yn * yn), kNormError);
    }
    EXPECT_LT(kNormError, std::ldexp(1.0, -12));
}

TEST(Jacobian, of_the_largest_jumps_stays_in_range) {
    const Stencil one_sided = stencil(true, false);
    const Jacobian j = jacobian_of(one_sided, deflection(-7, 7), deflection(7, -7), one_sided, deflection(7, 7), deflection(-7, -7));
    EXPECT_EQ(j.x_by_m.to_double_rounded(), 14.0);
    EXPECT_EQ(frobenius_norm(j).to_double_rounded(), 28.0);
}

}  // namespace
}  // namespace hord::algo
