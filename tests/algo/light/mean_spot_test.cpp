// Place, width and oneness of the mean spot.
#include "algo/light/mean_spot.h"

#include <cmath>
#include <numeric>

#include <gtest/gtest.h>

#include "tests/support/light_image.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

constexpr Extents kField{24, 24, 9, 9};
constexpr double kPixel = 1.0 / 12;  // variance of a bin

std::vector<std::uint32_t> all_of(const Extents& e) {
    std::vector<std::uint32_t> all(e.lenslets());
    std::iota(all.begin(), all.end(), 0U);
    return all;
}
MeanSpot spot_of(const LightImage& light, const Sensor& sensor = {}) {
    const Frame frame = exposed(light, sensor, 1);
    return mean_spot(frame.view(), light.extents, 3, all_of(light.extents));
}
LightImage still(double spread, double x = 0, double y = 0, const Extents& e = kField) {
    return spots(e, 200, spread, [=](int, int) { return Spot{x, y, 1}; });
}

// The faint light that is left out (kFaint) narrows a spot by up to 3 %.
TEST(MeanSpot, has_the_place_and_the_width_of_the_light) {
    for (const double spread : {0.5, 0.7, 0.9}) {
        for (const double x : {0.0, 0.3, -0.5, 1.2}) {
            const MeanSpot spot = spot_of(still(spread, x, -x / 2));
            ASSERT_TRUE(spot.measured);
            EXPECT_NEAR(spot.x, x, 0.02);
            EXPECT_NEAR(spot.y, -x / 2, 0.02);
            EXPECT_NEAR(spot.rms_x, std::sqrt(spread * spread + kPixel), 0.04);
            EXPECT_NEAR(spot.rms_y, std::sqrt(spread * spread + kPixel), 0.04);
            EXPECT_LT(spot.second_share, 0.02) << spread << " " << x;
        }
    }
}

TEST(MeanSpot, of_even_numbers_of_bins_is_one_spot_too) {
    for (const int bins : {4, 6, 8, 10, 14}) {
        const Extents e{24, 24, bins, bins};
        for (const double x : {0.0, 0.25, 0.5})
            EXPECT_LT(spot_of(still(0.6, x, 0, e)).second_share, 0.03) << bins << " " << x;
    }
}

TEST(MeanSpot, does_not_depend_on_pedestal_and_noise) {
    const MeanSpot quiet = spot_of(still(0.6, 0.2));
    for (const Sensor& sensor :
         {Sensor{8, 0}, Sensor{8, 2}, Sensor{0, 2}, Sensor{0, 5}, Sensor{20, 5}, Sensor{8, 2, 0.5}}) {
        const MeanSpot spot = spot_of(still(0.6, 0.2), sensor);
        EXPECT_NEAR(spot.x, quiet.x, 0.02);
        EXPECT_NEAR(spot.rms_x, quiet.rms_x, 0.05);
        EXPECT_LT(spot.second_share, 0.02);
    }
}

TEST(MeanSpot, is_not_one_spot_with_a_ghost_of_a_fifth) {
    for (const auto& [right, down] :
         {std::pair(2, 0), std::pair(2, 1), std::pair(3, 0), std::pair(3, -2), std::pair(0, 4)})
        EXPECT_GT(spot_of(with_ghost(still(0.5), 0.2, right, down)).second_share, 0.05) << right << " " << down;
    EXPECT_LT(spot_of(with_ghost(still(0.5), 0.02, 3, 0)).second_share, 0.05);
}

// The wider the spot, the more bins both share. From three bins on, nearly all of the ghost lies beyond the core; two
// bins away more than half does.
TEST(MeanSpot, counts_the_light_of_a_ghost_that_blends_with_a_wide_spot) {
    for (const double spread : {0.4, 0.6, 0.8}) {
        for (const double share : {0.06, 0.1}) {
            const double of_light = share / (1 + share);
            for (const auto& [right, down] : {std::pair(3, 0), std::pair(-3, 0), std::pair(0, 3), std::pair(3, -2)}) {
                const double seen = spot_of(with_ghost(still(spread), share, right, down)).second_share;
                EXPECT_NEAR(seen, of_light, 0.15 * of_light) << spread << " " << share << " " << right << " " << down;
            }
            const double near = spot_of(with_ghost(still(spread), share, 0, -2)).second_share;
            EXPECT_GT(near, of_light / 2) << spread << " " << share;
            EXPECT_LT(near, 1.15 * of_light) << spread << " " << share;
        }
    }
}

TEST(MeanSpot, is_two_spots_when_light_falls_between_two_lenslets) {
    EXPECT_NEAR(spot_of(still(0.5, 4.5)).second_share, 0, 0.2);  // cut off at the last bin, nothing beside it
    EXPECT_GT(spot_of(moved_px(still(0.5), 4, 0)).second_share, 0.1);
    EXPECT_GT(spot_of(moved_px(still(0.5), 4, 0)).rms_x, 2);
}

TEST(MeanSpot, moved_by_each_lenslets_own_deflection_is_as_narrow_as_without_a_part) {
    const LightImage light = spots(kField, 200, 0.5, [](int m, int n) {
        return Spot{0.2 * (m - 12), 0.1 * (n - 12), 1};
    });
    std::vector<Deflection> centres(kField.lenslets());
    for (int n = 0; n < kField.n; ++n) {
        for (int m = 0; m < kField.m; ++m) {
            centres[kField.index(m, n)] = {
                DeflectionQ::from_raw(static_cast<std::int64_t>(0.2 * (m - 12) * (1 << 24))),
                DeflectionQ::from_raw(static_cast<std::int64_t>(0.1 * (n - 12) * (1 << 24)))};
        }
    }
    const Frame frame = exposed(light, {}, 1);
    const MeanSpot moved = mean_spot(frame.view(), kField, 3, all_of(kField), centres),
                   as_it_is = mean_spot(frame.view(), kField, 3, all_of(kField));
    EXPECT_GT(as_it_is.rms_x, 1.2);
    EXPECT_NEAR(moved.rms_x, std::sqrt(0.25 + 2 * kPixel), 0.08);  // the rest of a rounding is even over a bin
    EXPECT_LT(moved.second_share, 0.03);
}

TEST(MeanSpot, without_light_is_not_measured) {
    const LightImage dark{kField,
                          std::vector<double>(static_cast<std::size_t>(kField.width_px() * kField.height_px()))};
    EXPECT_FALSE(spot_of(dark, {0, 0}).measured);
    EXPECT_FALSE(spot_of(dark, {100, 0, 1, false}).measured);
}

TEST(MeanSpot, without_focus_is_as_wide_as_even_light) {
    EXPECT_NEAR(rms_of_even_light(9), 2.582, 1e-3);
    EXPECT_NEAR(rms_of_even_light(3), 0.8165, 1e-3);
}

// One lenslet of 9 x 9 bins, and light in single bins of it.
struct Bin {
    int i, j;
    std::uint32_t dn;
};
MeanSpot of_bins(const std::vector<Bin>& bins, std::uint32_t dark = 0, const Extents& e = {1, 1, 9, 9}) {
    Frame frame(e.width_px(), e.height_px(), 8);
    for (const Bin& bin : bins) frame.set(bin.i, bin.j, bin.dn);
    const std::uint32_t lenslet = 0;
    return mean_spot(frame.view(), e, dark, {&lenslet, 1});
}

TEST(MeanSpot, tells_the_share_of_lit_bins) {
    EXPECT_NEAR(of_bins({{4, 4, 100}, {4, 5, 50}}).lit_share, 2.0 / 81, 1e-9);
    EXPECT_NEAR(of_bins({{4, 4, 100}, {4, 5, 50}}, 49).lit_share, 2.0 / 81, 1e-9);
    EXPECT_NEAR(of_bins({{4, 4, 100}, {4, 5, 50}}, 50).lit_share, 1.0 / 81, 1e-9);
}

TEST(MeanSpot, counts_what_no_way_without_a_climb_leads_to_as_a_second_spot) {
    EXPECT_NEAR(of_bins({{4, 4, 90}, {4, 6, 10}}).second_share, 0.1, 1e-6);  // a dark bin lies between
    EXPECT_NEAR(of_bins({{4, 4, 90}, {6, 4, 10}}).second_share, 0.1, 1e-6);
    EXPECT_NEAR(of_bins({{4, 4, 90}, {6, 6, 10}}).second_share, 0.1, 1e-6);
    for (const auto& [i, j] : {std::pair(2, 4), std::pair(4, 2), std::pair(2, 2), std::pair(2, 6), std::pair(6, 2)})
        EXPECT_NEAR(of_bins({{4, 4, 90}, {i, j, 10}}).second_share, 0.1, 1e-6) << i << " " << j;
    EXPECT_NEAR(of_bins({{4, 4, 80}, {1, 4, 10}, {8, 8, 10}}).second_share, 0.2, 1e-6);
    EXPECT_LT(of_bins({{4, 4, 90}, {4, 5, 10}}).second_share, 0.02);                     // its neighbour
    EXPECT_LT(of_bins({{4, 4, 90}, {5, 5, 10}}).second_share, 0.02);                     // over a corner
    EXPECT_LT(of_bins({{4, 4, 96}, {4, 3, 2}, {4, 5, 2}}).second_share, 1.0 / 12 / 16);  // copied_spot.h
}

// The core is 3 x 3 bins about the brightest one, and moves towards the light beside it.
TEST(MeanSpot, that_is_lopsided_counts_what_lies_beyond_its_core_on_one_side) {
    // Light that falls without a climb: 100, 40, 20, 20 DN, one bin further each.
    for (const int way : {1, -1}) {
        const double mean = (40.0 + 2 * 20 + 3 * 20) / 180;
        const MeanSpot right = of_bins({{4, 4, 100}, {4 + way, 4, 40}, {4 + 2 * way, 4, 20}, {4 + 3 * way, 4, 20}}),
                       down = of_bins({{4, 4, 100}, {4, 4 + way, 40}, {4, 4 + 2 * way, 20}, {4, 4 + 3 * way, 20}});
        EXPECT_NEAR(right.x, way * mean, 1e-9);
        EXPECT_NEAR(down.y, way * mean, 1e-9);
        EXPECT_EQ(right.y, 0);
        EXPECT_EQ(down.x, 0);
        EXPECT_NEAR(down.second_share, right.second_share, 1e-9);
        EXPECT_LT(right.second_share, 40.0 / 180);
        EXPECT_GT(right.second_share, 30.0 / 180);
    }
}

TEST(MeanSpot, that_is_not_measured_is_all_zero) {
    const MeanSpot none = of_bins({});
    EXPECT_FALSE(none.measured);
    for (const double value : {none.x, none.y, none.rms_x, none.rms_y, none.second_share, none.lit_share})
        EXPECT_EQ(value, 0);
}

}  // namespace
}  // namespace hord::algo
