// Pedestal and noise of a frame's dark bins, and the dark level that follows.
#include "algo/light/dark_bins.h"

#include <cmath>
#include <functional>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/light_image.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

constexpr Extents kField{40, 36, 9, 9};
constexpr LightLevels kLevels{3, 16, 255};

DarkBins measured(const Frame& frame, const Extents& e = kField) {
    DarkBinMeter meter(e, frame.bits());
    return meter.measure(frame.view());
}

Frame spots_on(double pedestal_dn, double noise_dn, std::uint64_t seed, int bits = 8, const Extents& e = kField) {
    const LightImage light = spots(e, 200, 0.5, lens(e, 14, 2));
    return exposed(light, {pedestal_dn, noise_dn}, seed, bits);
}

// The quantiles of the 80 % darkest bins are those of the 89 % that are dark, and the spots' outermost light is among
// them: a tenth of the noise is the error of both.
TEST(DarkBins, are_the_pedestal_and_its_noise) {
    for (const double pedestal : {5.0, 8.3, 20.0, 100.0}) {
        for (const double noise : {0.5, 1.0, 2.0}) {
            const DarkBins dark = measured(spots_on(pedestal, noise, 1));
            EXPECT_TRUE(dark.measured);
            EXPECT_FALSE(dark.at_zero);
            EXPECT_NEAR(dark.pedestal_dn, pedestal, 0.15 * noise + 0.1);
            EXPECT_NEAR(dark.noise_dn, std::hypot(noise, 0.29), 0.15 * noise + 0.05);
        }
    }
}

// A spot covers 4 x 4 bins, or fewer where there are fewer.
TEST(DarkBins, are_all_but_those_of_one_spot) {
    EXPECT_DOUBLE_EQ(share_of_dark_bins({30, 30, 9, 9}), 1 - 16.0 / 81);
    EXPECT_DOUBLE_EQ(share_of_dark_bins({30, 30, 3, 15}), 1 - 12.0 / 45);
    EXPECT_DOUBLE_EQ(share_of_dark_bins({30, 30, 15, 3}), 1 - 12.0 / 45);
    EXPECT_DOUBLE_EQ(share_of_dark_bins({30, 30, 3, 3}), 0);
}

TEST(DarkBins, at_16_bits_are_as_at_8) {
    const DarkBins dark = measured(spots_on(5, 1, 2, 16));
    EXPECT_NEAR(dark.pedestal_dn / 257, 5, 0.2);
    EXPECT_NEAR(dark.noise_dn / 257, 1, 0.2);
}

TEST(DarkBins, noise_that_the_sensor_clips_is_measured_above_the_pedestal) {
    const DarkBins dark = measured(spots_on(1, 2, 3));
    EXPECT_NEAR(dark.pedestal_dn, 1, 0.3);
    EXPECT_NEAR(dark.noise_dn, 2, 0.6);
}

// The promise that results of frames without a pedestal do not change, if their noise is usual.
TEST(DarkBins, at_zero_leave_the_level_as_it_was) {
    for (const double noise : {0.0, 0.6, 2.0}) {
        const FrameLevels levels = levels_above_dark_bins(kLevels, measured(spots_on(0, noise, 4)), 8);
        EXPECT_EQ(levels.levels.dark, kLevels.dark);
        EXPECT_TRUE(levels.pedestal_allowed && levels.noise_allowed);
    }
}

// Nobody chose the level: noise above it would be light.
TEST(DarkBins, raise_a_level_by_default_three_sigma_above_the_pedestal) {
    for (const double noise : {2.0, 3.0, 4.0, 5.0}) {
        const FrameLevels levels =
            levels_above_dark_bins(kLevels, measured(spots_on(0, noise, 4)), 8, DarkLevel::by_default);
        EXPECT_NEAR(levels.levels.dark, 3 * noise + 0.8, 0.4 * noise);
        EXPECT_TRUE(levels.pedestal_allowed && levels.noise_allowed);
        EXPECT_EQ(levels.wanted_dn, levels.levels.dark);
    }
    for (const auto& [pedestal, noise] : {std::pair(0.0, 0.0), std::pair(0.0, 1.0), std::pair(3.0, 0.0)}) {
        const DarkBins dark = measured(spots_on(pedestal, noise, 4));
        EXPECT_EQ(levels_above_dark_bins(kLevels, dark, 8, DarkLevel::by_default).levels.dark, kLevels.dark);
    }
}

TEST(DarkBins, whose_noise_is_clipped_at_zero_show_it_above_zero) {
    for (const int bits : {8, 12, 16}) {
        const double scale = ((1 << bits) - 1) / 255.0;
        for (const double noise : {1.0, 2.0, 4.0, 6.0}) {
            const DarkBins dark = measured(spots_on(0, noise, 4, bits));
            EXPECT_FALSE(dark.at_zero);
            EXPECT_LE(dark.pedestal_dn, 0.5);
            EXPECT_NEAR(dark.noise_dn / scale, noise, 0.15 * noise) << bits << " bits";
        }
    }
    EXPECT_NEAR(levels_above_dark_bins(kLevels, measured(spots_on(0, 5, 4)), 8).levels.dark, 15, 2);
    EXPECT_FALSE(levels_above_dark_bins(kLevels, measured(spots_on(0, 8, 4)), 8).noise_allowed);
}

// Noise of 1.1 to 8 DN at 12 bits is far less than a step of the full scale's 256th part, in which faint light lies,
// too.
TEST(DarkBins, of_a_quiet_sensor_without_pedestal_show_its_noise) {
    for (const int bits : {12, 16}) {
        const double scale = ((1 << bits) - 1) / 255.0;
        for (const double noise : {0.07, 0.1, 0.2, 0.5}) {
            const DarkBins dark = measured(spots_on(0, noise, 4, bits));
            EXPECT_FALSE(dark.at_zero);
            EXPECT_NEAR(dark.noise_dn / scale, noise, 0.15 * noise) << bits << " bits";
        }
    }
}

// Light that is spread thinly is no noise: its samples above 0 have another shape, or too few zeros beside them.
TEST(DarkBins, at_zero_beside_thin_light_leave_the_level_as_it_was) {
    Frame frame = spots_on(0, 0, 4);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            if ((x * 7 + y * 5) % 4 == 0) frame.set(x, y, std::max(frame.view().sample(x, y), 4U + (x + y) % 5));
        }
    }
    const DarkBins dark = measured(frame);
    EXPECT_TRUE(dark.at_zero);
    EXPECT_EQ(levels_above_dark_bins(kLevels, dark, 8).levels.dark, kLevels.dark);
}

TEST(DarkBins, that_the_level_clears_leave_it_as_it_was) {
    for (const auto& [pedestal, noise] : {std::pair(1.0, 0.3), std::pair(2.0, 0.3), std::pair(3.0, 0.0)})
        EXPECT_EQ(levels_above_dark_bins(kLevels, measured(spots_on(pedestal, noise, 5)), 8).levels.dark, 3U);
    // Somebody may have set the level two sigma above the pedestal, to see faint scattering.
    const LightLevels faint{48, 60, 4095};
    const LightImage light = spots(kField, 200, 0.5, lens(kField, 14, 2));
    EXPECT_EQ(levels_above_dark_bins(faint, measured(exposed(light, {40 * 255.0 / 4095, 4 * 255.0 / 4095}, 6, 12)), 128)
                  .levels.dark,
              48U);
}

TEST(DarkBins, raise_the_level_three_sigma_above_the_pedestal_and_no_further_than_allowed) {
    const auto levels = [](double pedestal, double noise) {
        return levels_above_dark_bins(kLevels, measured(spots_on(pedestal, noise, 7)), 8);
    };
    const FrameLevels raised = levels(6, 1);
    EXPECT_TRUE(raised.pedestal_allowed && raised.noise_allowed);
    EXPECT_NEAR(raised.levels.dark, 9.5, 0.5);
    EXPECT_EQ(raised.levels.min_sum, kLevels.min_sum);
    EXPECT_TRUE(levels(11, 0.3).pedestal_allowed);
    EXPECT_FALSE(levels(12, 0.3).pedestal_allowed);
    const FrameLevels noisy = levels(10, 4);
    EXPECT_TRUE(noisy.pedestal_allowed);
    EXPECT_FALSE(noisy.noise_allowed);
    EXPECT_EQ(noisy.levels.dark, 3U + 2 * 8);
}

TEST(DarkBins, are_not_measured_where_a_spot_may_cover_nearly_all) {
    for (const Extents& e : {Extents{30, 30, 3, 3}, Extents{30, 30, 4, 4}, Extents{30, 30, 4, 5}})
        EXPECT_FALSE(measured(spots_on(5, 1, 8, 8, e), e).measured);
    EXPECT_TRUE(measured(spots_on(5, 1, 8, 8, {30, 30, 5, 5}), {30, 30, 5, 5}).measured);
    EXPECT_TRUE(measured(spots_on(5, 1, 8, 8, {30, 30, 3, 15}), {30, 30, 3, 15}).measured);
}

// What follows from measured dark bins, just within and just beyond each limit: level 3 DN, rise 8 DN.
TEST(DarkBins, raise_the_level_within_limits) {
    const auto levels = [](double pedestal, double noise, double upper) {
        return levels_above_dark_bins(
            kLevels,
            {.measured = true, .pedestal_dn = pedestal, .noise_dn = noise, .upper_dn = upper, .at_zero = false}, 8);
    };
    EXPECT_EQ(levels(2, 1, 3.5).levels.dark, 3U);
    EXPECT_EQ(levels(2, 1, 3.51).levels.dark, 5U);
    EXPECT_EQ(levels(2, 1.01, 3.51).levels.dark, 6U);
    EXPECT_EQ(levels(0.2, 0.3, 4).levels.dark, 3U);  // never below the given level
    EXPECT_TRUE(levels(11.5, 1, 13).pedestal_allowed);
    EXPECT_FALSE(levels(11.51, 1, 13).pedestal_allowed);
    EXPECT_TRUE(levels(10, 3, 15).noise_allowed);
    EXPECT_EQ(levels(10, 3, 15).levels.dark, 19U);
    EXPECT_FALSE(levels(10, 3.01, 15).noise_allowed);
    EXPECT_EQ(levels(10, 3.01, 15).levels.dark, 19U);
    EXPECT_EQ(levels(10, 3.01, 15).levels.saturated, kLevels.saturated);
    EXPECT_EQ(levels_above_dark_bins(kLevels, {.pedestal_dn = 9, .upper_dn = 12, .at_zero = false}, 8).levels.dark, 3U);
    EXPECT_EQ(levels_above_dark_bins(kLevels, {.measured = true, .pedestal_dn = 9, .upper_dn = 12}, 8).levels.dark, 3U);
}

// A frame of 24 x 24 lenslets of 9 x 9 bins in which value v has `share(v)` of the samples of the 65 dark bins; the
// other 16 bins read 200 DN at 8 bits.
Frame of_distribution(int bits, const std::function<double(int)>& share) {
    const Extents e{24, 24, 9, 9};
    Frame frame(e.width_px(), e.height_px(), bits);
    const int values = 1 << bits;
    const double samples = 65.0 * static_cast<double>(e.lenslets());
    double wanted = share(0) * samples, dark = 0;
    int v = 0;
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const bool lit = x % 9 < 4 && y % 9 < 4;
            for (; !lit && dark >= wanted && v + 1 < values; wanted += share(v) * samples) ++v;
            dark += lit ? 0 : 1;
            frame.set(x, y, lit ? 200U << (bits - 8) : static_cast<std::uint32_t>(v));
        }
    }
    return frame;
}
// The share of value v of normal noise about 0 that the sensor rounds, and clips at 0. `zeros`: times as many zeros.
std::function<double(int)> clipped(double sigma, double zeros = 1) {
    const auto below = [=](double v) { return 0.5 * std::erfc(-v / sigma / std::sqrt(2.0)); };
    const double rest = below(0.5), of_zeros = zeros * rest / (zeros * rest + 1 - rest),
                 scale = (1 - of_zeros) / (1 - rest);
    return [=](int v) { return v == 0 ? of_zeros : scale * (below(v + 0.5) - below(v - 0.5)); };
}

TEST(DarkBins, clipped_at_zero_show_the_width_of_their_upper_half) {
    for (const double sigma : {1.5, 2.0, 3.0, 5.0, 9.0})
        EXPECT_NEAR(measured(of_distribution(8, clipped(sigma)), {24, 24, 9, 9}).noise_dn, sigma, 0.02 * sigma);
    for (const double sigma : {32.0, 60.0})
        EXPECT_NEAR(measured(of_distribution(12, clipped(sigma)), {24, 24, 9, 9}).noise_dn, sigma, 0.02 * sigma);
}

TEST(DarkBins, clipped_at_zero_have_as_many_zeros_as_their_noise_clips) {
    for (const auto& [zeros, known] : {std::pair(1.4, true), std::pair(1.6, false), std::pair(1 / 1.4, true)})
        EXPECT_EQ(measured(of_distribution(8, clipped(3, zeros)), {24, 24, 9, 9}).at_zero, !known) << zeros;
    for (const auto& [zeros, known] : {std::pair(1 / 1.3, true), std::pair(1 / 1.7, false)})
        EXPECT_EQ(measured(of_distribution(8, clipped(1.2, zeros)), {24, 24, 9, 9}).at_zero, !known) << zeros;
    // An even tail falls to half nowhere.
    EXPECT_TRUE(
        measured(of_distribution(8, [](int v) { return v == 0  ? 0.7
                                                    : v <= 190 ? 0.3 / 190
                                                               : 0; }), {24, 24, 9, 9})
            .at_zero);
    // No sample at 1 DN: nothing is known of the noise.
    EXPECT_TRUE(measured(of_distribution(8, [](int v) { return v == 0 ? 0.6
                                                            : v == 2  ? 0.3
                                                            : v == 3  ? 0.1
                                                                      : 0; }),
                         {24, 24, 9, 9})
                    .at_zero);
}

TEST(DarkBins, have_quantiles_within_a_step_of_the_samples) {
    // 40 % read 10, 60 % read 11: the median lies a sixth into 11.
    const DarkBins dark =
        measured(of_distribution(8, [](int v) { return v == 10 ? 0.4
                                                    : v == 11  ? 0.6
                                                               : 0; }), {24, 24, 9, 9});
    EXPECT_NEAR(dark.pedestal_dn, 10.5 + 0.1 / 0.6, 0.01);
    EXPECT_NEAR(dark.noise_dn, 10.5 + 0.1 / 0.6 - (9.5 + 0.158655 / 0.4), 0.01);
    EXPECT_NEAR(dark.upper_dn, 10.5 + (14.0 / 15 - 0.4) / 0.6, 0.01);
}

// Samples above the full scale, as a driver may hand them over, count as the full scale.
TEST(DarkBins, above_the_full_scale_are_the_full_scale) {
    const Extents e{24, 24, 9, 9};
    const std::vector<std::uint16_t> samples(static_cast<std::size_t>(e.width_px() * e.height_px()), 65535);
    const FrameView frame{reinterpret_cast<const std::byte*>(samples.data()), e.width_px(), e.height_px(),
                          2 * e.width_px(), 12};
    DarkBinMeter meter(e, 12);
    const DarkBins dark = meter.measure(frame);
    const double dark_share = share_of_dark_bins(e);
    EXPECT_NEAR(dark.pedestal_dn, 4094.5 + dark_share / 2, 1e-6);
    EXPECT_NEAR(dark.noise_dn, dark_share * (0.5 - 0.158655), 1e-6);
}

}  // namespace
}  // namespace hord::algo
