#include "algo/features/deflection.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

// Derived in algo/features/deflection.h; the contract asks for 2^-12.
const double kDeflectionError = std::ldexp(1.0, -24);

// Decodes a frame of 3x3 lenslets with these masses.
Deflection mean_of(const std::vector<std::uint16_t>& mass, int i, int j) {
    const Extents e{3, 3, i, j};
    Frame frame(e.width_px(), e.height_px(), 16);
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) frame.set(x, y, mass[static_cast<std::size_t>(y % j * i + x % i)]);
    }
    HordRow row(e);
    decode_row(frame.view(), e, {0, 1, 1U << 16}, 1, row);
    std::vector<Deflection> out(3);
    mean_deflections(row, out);
    return out[1];
}

TEST(MeanDeflection, of_hand_written_hords) {
    EXPECT_EQ(mean_of({0, 0, 0, 0, 5, 0, 0, 0, 0}, 3, 3), (Deflection{}));  // the centre bin is zero deflection
    const Deflection corner = mean_of({0, 0, 7, 0, 0, 0, 0, 0, 0}, 3, 3);   // right and up
    EXPECT_EQ(corner.x.to_double_rounded(), 1.0);
    EXPECT_EQ(corner.y.to_double_rounded(), -1.0);
    const Deflection mixed = mean_of({0, 0, 0, 0, 3, 1, 0, 4, 0}, 3, 3);  // 1/8 right, 4/8 down
    EXPECT_EQ(mixed.x.to_double_rounded(), 0.125);
    EXPECT_EQ(mixed.y.to_double_rounded(), 0.5);
    const Deflection even = mean_of({1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}, 4, 3);  // even: zero lies between two bins
    EXPECT_EQ(even.x.to_double_rounded(), -1.5);
    EXPECT_EQ(even.y.to_double_rounded(), -1.0);
}

TEST(MeanDeflection, is_within_its_bound_of_double_for_every_geometry_and_bit_depth) {
    std::mt19937 random(3);
    double worst = 0;
    for (int round = 0; round < 20000; ++round) {
        const int i = 3 + static_cast<int>(random() % 13), j = 3 + static_cast<int>(random() % 13);
        const std::uint32_t full = (1U << (8 + random() % 9)) - 1;
        const unsigned lit = random() % 4 == 0 ? 100 : 10;  // per cent
        std::vector<std::uint16_t> mass(static_cast<std::size_t>(i * j));
        for (auto& a : mass) a = static_cast<std::uint16_t>(random() % 100 < lit ? random() % (full + 1) : 0);
        mass[random() % mass.size()] = static_cast<std::uint16_t>(full);
        double x = 0, y = 0, sum = 0;
        for (int k = 0; k < i * j; ++k) {
            const double a = mass[static_cast<std::size_t>(k)];
            x += a * (k % i - (i - 1) / 2.0);
            y += a * (k / i - (j - 1) / 2.0);
            sum += a;
        }
        const Deflection mean = mean_of(mass, i, j);
        worst = std::max(
            {worst, std::abs(mean.x.to_double_rounded() - x / sum), std::abs(mean.y.to_double_rounded() - y / sum)});
    }
    EXPECT_LE(worst, kDeflectionError);
    EXPECT_LT(kDeflectionError, std::ldexp(1.0, -12));
}

TEST(MeanDeflection, stays_within_its_bound_at_the_extremes) {
    for (const int dn : {1, 255, 65535}) {
        const auto value = static_cast<std::uint16_t>(dn);
        std::vector<std::uint16_t> one(225), all(225, value), two(225);
        one[224] = value;  // one lit bin in the far corner
        two[0] = 1;        // one photon against full scale across the range
        two[224] = value;
        EXPECT_NEAR(mean_of(one, 15, 15).x.to_double_rounded(), 7, kDeflectionError);
        EXPECT_NEAR(mean_of(all, 15, 15).y.to_double_rounded(), 0, kDeflectionError);
        EXPECT_NEAR(mean_of(two, 15, 15).x.to_double_rounded(), 7 * (value - 1.0) / (value + 1.0), kDeflectionError);
    }
}

TEST(MeanDeflection, of_a_mirrored_hord_is_exactly_negated) {
    std::mt19937 random(4);
    for (int round = 0; round < 2000; ++round) {
        std::vector<std::uint16_t> mass(81);
        for (auto& a : mass) a = static_cast<std::uint16_t>(random() % 256);
        const Deflection straight = mean_of(mass, 9, 9);
        std::reverse(mass.begin(), mass.end());
        const Deflection turned = mean_of(mass, 9, 9);
        EXPECT_EQ(turned.x.raw(), -straight.x.raw());
        EXPECT_EQ(turned.y.raw(), -straight.y.raw());
    }
}

TEST(MeanDeflection, of_dark_lenslets_is_zero) {
    const Extents e{4, 3, 3, 3};
    Frame frame(e.width_px(), e.height_px(), 8);
    frame.set(3 + 2, 1, 9);  // lenslet 1, bin (2, 1)
    HordRow row(e);
    decode_row(frame.view(), e, {0, 1, 255}, 0, row);
    std::vector<Deflection> out(4, Deflection{DeflectionQ::from_raw(1), DeflectionQ::from_raw(1)});
    mean_deflections(row, out);
    EXPECT_EQ(out[0], Deflection{});
    EXPECT_EQ(out[1].x.to_double_rounded(), 1.0);
    EXPECT_EQ(out[3], Deflection{});
}

}  // namespace
}  // namespace hord::algo
