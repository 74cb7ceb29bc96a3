// From any lattice to a square one: geometry, arithmetic, and the same bits on every machine.
#include "algo/frame/regrid.h"

#include <cmath>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/decode_whole.h"

namespace hord::algo {
namespace {

// A rotated, sheared, distorted lattice over a 400 x 380 px frame.
LensletGrid lattice(Stagger stagger, int parity = 0) {
    LensletGrid grid;
    grid.kind = stagger == Stagger::none ? LatticeKind::square : LatticeKind::hexagonal;
    grid.stagger = stagger;
    grid.parity = parity;
    grid.columns = stagger == Stagger::columns ? 34 : 30;
    grid.rows = stagger == Stagger::rows ? 34 : 30;
    grid.width_px = 400;
    grid.height_px = 380;
    grid.origin_u = 0.5 * (grid.columns - 1) * (stagger == Stagger::columns ? 0.8660254037844386 : 1);
    grid.origin_v = 0.5 * (grid.rows - 1) * (stagger == Stagger::rows ? 0.8660254037844386 : 1);
    grid.span = 14;
    grid.model = GridModelKind::radial1;
    grid.parameters = {199.3, 190.2, 14 * 16.4, -14 * 0.9, 14 * 0.8, 14 * 16.5, 0.002, -0.001, 0.004};
    grid.middle_x_px = 199.5;
    grid.middle_y_px = 189.5;
    grid.radius_px = 200;
    return grid;
}

Frame filled(int width, int height, int bits, const std::function<double(double, double)>& light) {
    Frame frame(width, height, bits);
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) frame.set(x, y, static_cast<std::uint32_t>(std::lround(light(x, y))));
    }
    return frame;
}

class Regrid : public ::testing::TestWithParam<std::pair<Stagger, int>> {};

TEST_P(Regrid, a_level_stays_the_same_level_wherever_there_are_lenslets) {
    const LensletGrid grid = lattice(GetParam().first, GetParam().second);
    auto regridder = Regridder::create(grid, even_layout(grid, 7, 5));
    ASSERT_TRUE(regridder) << regridder.error().message();
    const auto decoded =
        test::decode_whole(*regridder, filled(400, 380, 16, [](double, double) { return 65535; }).view());
    const Extents& e = regridder->extents();
    for (int n = 2; n < e.n - 2; ++n) {
        for (int m = 2; m < e.m - 2; ++m) {
            for (int j = 0; j < 5; ++j) {
                for (int i = 0; i < 7; ++i)
                    ASSERT_EQ(decoded.view().sample(m * 7 + i, n * 5 + j), 65535U) << m << "," << n;
            }
        }
    }
}

TEST_P(Regrid, light_that_rises_along_the_sensor_rises_along_the_square_lattice) {
    // Interpolation of a ramp is exact. Errors are those of positions and weights as in resample_test, and 1/512 of the
    // ramp's step between lenslets for each of four weights.
    const double slope_x = 60, slope_y = 45;
    const LensletGrid grid = lattice(GetParam().first, GetParam().second);
    const BinLayout layout = even_layout(grid, 5, 5);
    auto regridder = Regridder::create(grid, layout);
    ASSERT_TRUE(regridder);
    const auto decoded = test::decode_whole(
        *regridder, filled(400, 380, 16, [&](double x, double y) { return 2000 + slope_x * x + slope_y * y; }).view());
    const double tolerance =
        (slope_x + slope_y) * (1.0 / 32 + 0.025 + 0.125 / layout.box_x_px + 4.0 / 512 * 17 / 2) + 1;
    const Extents& e = regridder->extents();
    for (int n = 2; n < e.n - 2; ++n) {
        for (int m = 2; m < e.m - 2; ++m) {
            const double x = regridder->first_px().x_px + m * regridder->pitch_px();
            const double y = regridder->first_px().y_px + n * regridder->pitch_px();
            EXPECT_NEAR(decoded.view().sample(m * 5 + 2, n * 5 + 2), 2000 + slope_x * x + slope_y * y, tolerance)
                << m << "," << n;
            EXPECT_NEAR(decoded.view().sample(m * 5 + 4, n * 5 + 2),
                        2000 + slope_x * (x + 2 * layout.box_x_px) + slope_y * y, tolerance);
        }
    }
}

TEST_P(Regrid, rows_in_any_order_are_those_of_the_whole_frame) {
    const LensletGrid grid = lattice(GetParam().first, GetParam().second);
    auto regridder = Regridder::create(grid, even_layout(grid, 9, 9));
    ASSERT_TRUE(regridder);
    std::uint32_t state = 1;
    const Frame raw =
        filled(400, 380, 8, [&](double, double) { return (state = state * 1664525U + 1013904223U) >> 24U; });
    const auto whole = test::decode_whole(*regridder, raw.view());
    const Extents& e = regridder->extents();
    std::vector<std::uint8_t> row(static_cast<std::size_t>(e.width_px() * e.j));
    std::uint8_t alone[81];
    regridder->begin_frame();
    for (const int n : {e.n - 1, 0, e.n / 2, 1}) {
        regridder->decode_row(raw.view(), n, row.data(), e.width_px());
        for (int m = 0; m < e.m; ++m) {
            regridder->decode_lenslet(raw.view(), m, n, alone, 9);
            for (int k = 0; k < 81; ++k)
                ASSERT_EQ(alone[k], whole.view().sample(m * 9 + k % 9, n * 9 + k / 9)) << m << "," << n;
        }
        for (int j = 0; j < e.j; ++j) {
            for (int x = 0; x < e.width_px(); ++x)
                ASSERT_EQ(row[static_cast<std::size_t>(j * e.width_px() + x)], whole.view().sample(x, n * e.j + j));
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Lattices, Regrid,
                         ::testing::Values(std::pair(Stagger::none, 0), std::pair(Stagger::rows, 0),
                                           std::pair(Stagger::rows, 1), std::pair(Stagger::columns, 0),
                                           std::pair(Stagger::columns, 1)));

TEST(RegridBits, are_the_same_on_every_machine) {
    // FNV-1a over the decoded samples of a noise frame. Another value means that frames are decoded differently and
    // existing limits may no longer fit.
    const LensletGrid grid = lattice(Stagger::rows, 1);
    auto regridder = Regridder::create(grid, even_layout(grid, 9, 9));
    ASSERT_TRUE(regridder);
    std::uint32_t state = 7;
    const auto decoded = test::decode_whole(*regridder, filled(400, 380, 12, [&](double, double) {
                                                            return (state = state * 1664525U + 1013904223U) >> 20U;
                                                        }).view());
    std::uint64_t hash = 14695981039346656037U;
    for (int y = 0; y < decoded.height_px(); ++y) {
        for (int x = 0; x < decoded.width_px(); ++x) hash = (hash ^ decoded.view().sample(x, y)) * 1099511628211U;
    }
    EXPECT_EQ(hash, 3741898740600764857U);
}

// 8-bit samples are interpolated in 16-bit arithmetic, deeper ones in 32-bit.
TEST(RegridBits, of_eight_bit_frames_are_those_of_the_same_samples_in_a_deeper_frame) {
    for (const Stagger stagger : {Stagger::none, Stagger::rows, Stagger::columns}) {
        const LensletGrid grid = lattice(stagger);
        auto regridder = Regridder::create(grid, even_layout(grid, 9, 7));
        ASSERT_TRUE(regridder);
        std::uint32_t state = 9;
        std::vector<std::uint32_t> samples(400 * 380);
        for (std::uint32_t& sample : samples) sample = (state = state * 1664525U + 1013904223U) >> 24U;
        const auto light = [&](double x, double y) {
            return samples[static_cast<std::size_t>(y) * 400 + static_cast<std::size_t>(x)];
        };
        const auto narrow = test::decode_whole(*regridder, filled(400, 380, 8, light).view()),
                   deep = test::decode_whole(*regridder, filled(400, 380, 12, light).view());
        for (int y = 0; y < narrow.height_px(); ++y) {
            for (int x = 0; x < narrow.width_px(); ++x)
                ASSERT_EQ(narrow.view().sample(x, y), deep.view().sample(x, y)) << x << "," << y;
        }
    }
}

TEST(RegridBits, places_without_lenslets_have_no_light) {
    LensletGrid grid = lattice(Stagger::rows);
    grid.columns = 12;  // the right half of the frame has none
    auto regridder = Regridder::create(grid, even_layout(grid, 5, 5));
    ASSERT_TRUE(regridder) << regridder.error().message();
    const auto decoded = test::decode_whole(*regridder, filled(400, 380, 8, [](double, double) { return 200; }).view());
    const Extents& e = regridder->extents();
    EXPECT_EQ(decoded.view().sample(5 * (e.m - 2), 5 * e.n / 2), 0U);
}

}  // namespace
}  // namespace hord::algo
