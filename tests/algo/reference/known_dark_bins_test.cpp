// The dark level of a frame that has a reference: it follows pedestal and noise, and never light.
#include "algo/inspection/known_dark_bins.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "tests/algo/reference/good_parts.h"

namespace hord::algo {
namespace {

using namespace testing;

constexpr Extents kSpots{30, 28, 9, 9};

// Good parts have light in the 3x3 bins around the middle.
Reference spot_reference(int bits = 8, const Extents& e = kSpots) {
    Reference r;
    r.extents = e;
    r.bits = bits;
    r.light.assign(e.lenslets(), 300.0F * static_cast<float>(1U << static_cast<unsigned>(bits - 8)));
    r.mask.assign(e.lenslets(), kValid);
    r.shares.assign(e.lenslets() * r.stride(), 0);
    for (std::size_t k = 0; k < e.lenslets(); ++k) {
        for (int b = 0; b < 9; ++b) r.shares[k * r.stride() + r.place(e.i / 2 - 1 + b % 3, e.j / 2 - 1 + b / 3)] = 3640;
    }
    return r;
}

// Samples of a sensor that rounds and clips at 0. `light`: DN at pixel (x, y).
Frame exposed(double pedestal_dn, double noise_dn, const std::function<double(int, int)>& light, int bits = 8,
              const Extents& e = kSpots) {
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const double v = light(x, y) + pedestal_dn + noise_dn * normal(random);
            frame.set(x, y, static_cast<std::uint32_t>(std::clamp(std::lround(v), 0L, (1L << bits) - 1)));
        }
    }
    return frame;
}
double spot(int x, int y) { return std::abs(x % 9 - 4) <= 1 && std::abs(y % 9 - 4) <= 1 ? 33 : 0; }

std::uint32_t level_of(const Frame& frame, std::uint32_t lowest, std::uint32_t highest,
                       const Reference& reference = spot_reference()) {
    return KnownDarkBins(reference, DarkBinMeter(reference.extents, frame.bits()))
        .level_of(frame.view(), lowest, highest);
}

TEST(KnownDarkBins, give_the_level_that_one_reading_of_two_hundred_exceeds) {
    const auto level = [](double pedestal, double noise) { return level_of(exposed(pedestal, noise, spot), 0, 9); };
    EXPECT_EQ(level(0, 0), 0U);
    EXPECT_EQ(level(0, 0.15), 0U);   // 0.04 % exceed 0
    EXPECT_EQ(level(0.1, 0.2), 1U);  // 2.3 %
    EXPECT_EQ(level(0.5, 0.2), 1U);
    EXPECT_EQ(level(0, 0.4), 1U);
    EXPECT_EQ(level(0.5, 0.6), 2U);
    EXPECT_EQ(level(3, 0.8), 5U);
    EXPECT_EQ(level_of(exposed(3, 0.6, spot), 0, 2), 2U);
    EXPECT_EQ(level_of(exposed(0, 0.4, spot), 4, 6), 4U);
    EXPECT_NEAR(level_of(exposed(20, 10, spot, 12), 5, 99, spot_reference(12)), 20 + 2.58 * 10, 3);
}

// A read noise below 0.25 DN is not seen when a reference is learned: 0.6 % of its readings exceeded its level.
TEST(KnownDarkBins, of_a_quiet_sensor_let_through_what_they_did_when_it_was_learned) {
    Reference quiet = spot_reference();
    quiet.sensor.read_dn = 0;
    EXPECT_EQ(level_of(exposed(0, 0.2, spot), 0, 9, quiet), 0U);    // 0.6 %
    EXPECT_EQ(level_of(exposed(0.1, 0.2, spot), 0, 9, quiet), 1U);  // 2.3 %
}

TEST(KnownDarkBins, are_not_those_that_good_parts_light) {
    // Light where the reference has it and one or two bins from there, as haze over the whole field gives.
    const auto wide = [](int x, int y) { return std::abs(x % 9 - 4) <= 2 && std::abs(y % 9 - 4) <= 2 ? 33 : 0; };
    EXPECT_EQ(level_of(exposed(0, 0.1, wide), 0, 9), 0U);
    const auto haze = [](int x, int y) {
        return spot(x, y) + (std::abs(x % 9 - 4) <= 3 && std::abs(y % 9 - 4) <= 3 ? 2.0 : 0.0);
    };
    EXPECT_EQ(level_of(exposed(0, 0.1, haze), 0, 9), 0U);
    // Good parts light another bin two lenslets away: a part that lies aside may light it here.
    Reference moved = spot_reference();
    for (int n = 0; n < kSpots.n; ++n) {
        for (int m = 0; m < kSpots.m; m += 3)
            moved.shares[kSpots.index(m, n) * moved.stride() + moved.place(8, 0)] = 900;
    }
    const auto beside = [](int x, int y) { return x % 9 == 8 && y % 9 == 0 ? 8.0 : spot(x, y); };
    EXPECT_EQ(level_of(exposed(0, 0.1, beside), 0, 9, moved), 0U);
    EXPECT_EQ(level_of(exposed(0, 0.1, beside), 0, 9), 8U);
}

TEST(KnownDarkBins, that_a_flaw_lights_in_less_than_three_quarters_of_the_field_do_not_raise_the_level) {
    const auto flawed = [](double share) {
        return [=](int x, int y) { return spot(x, y) + (y < share * kSpots.height_px() ? 3.0 : 0.0); };
    };
    EXPECT_EQ(level_of(exposed(0.2, 0.2, flawed(0.25)), 0, 9), 1U);
    EXPECT_EQ(level_of(exposed(0.2, 0.2, flawed(0.5)), 0, 9), 1U);
    EXPECT_EQ(level_of(exposed(0.2, 0.2, flawed(0.7)), 0, 9), 1U);
    EXPECT_EQ(level_of(exposed(0.2, 0.2, flawed(1)), 0, 9), 4U);  // as a pedestal
}

TEST(KnownDarkBins, are_none_where_the_reference_does_not_know) {
    const auto any = [](const Reference& r) { return KnownDarkBins(r, DarkBinMeter(r.extents, r.bits)).any(); };
    EXPECT_TRUE(any(spot_reference()));
    EXPECT_FALSE(any(spot_reference(8, {30, 28, 5, 5})));  // light reaches all bins
    EXPECT_FALSE(any(spot_reference(8, {5, 5, 9, 9})));
    Reference dark = spot_reference();
    std::ranges::fill(dark.mask, kDark);
    EXPECT_FALSE(any(dark));
    EXPECT_EQ(level_of(exposed(2, 0.3, spot), 1, 9, dark), 1U);
    EXPECT_FALSE(KnownDarkBins().any());
}

// 8 bits, ten electrons a DN. A reference learned without a pedestal and with two electrons of read noise.
class GrownPedestal : public ::testing::Test {
  protected:
    static Frame seen_by(const Frame& wide, double pedestal_dn, double read_e, std::uint64_t seed) {
        std::mt19937_64 random(seed);
        std::normal_distribution<double> normal;
        Frame frame(wide.width_px(), wide.height_px(), 8);
        for (int y = 0; y < frame.height_px(); ++y) {
            for (int x = 0; x < frame.width_px(); ++x) {
                const double electrons = 10.0 * wide.view().sample(x, y) / 8,
                             v = (electrons + std::hypot(std::sqrt(electrons), read_e) * normal(random)) / 10;
                frame.set(x, y, static_cast<std::uint32_t>(std::clamp(std::lround(v + pedestal_dn), 0L, 255L)));
            }
        }
        return frame;
    }
};

TEST_F(GrownPedestal, rejects_no_good_part_and_hides_no_flaw) {
    LearnOptions options;
    options.levels = light_levels({}, 8);
    options.dark_from_noise = true;
    options.electrons_per_dn = 10;
    options.read_dn = 0;
    const auto all = learn_reference(
        kField, 8, 16, [&](std::size_t k) -> Result<Frame> { return seen_by(part(wobble(k)), 0, 2, k); }, options);
    ASSERT_TRUE(all) << all.error().message();
    ASSERT_EQ(all->reference.levels.dark, 0U);
    Recipe recipe;
    recipe.reference = std::make_shared<Reference>(all->reference);
    auto pipeline = Pipeline::create(kField, 8, recipe);
    ASSERT_TRUE(pipeline) << pipeline.error().message();
    const auto speck = [](int m, int n, Spot& s) {
        if (std::hypot(m - 24, n - 20) < 1.6) s.light *= 0.4;
    };
    const auto grey = [](int m, int n, Spot& s) {
        if (std::hypot(m - 18, n - 18) < 3) s.light *= 0.8;
    };
    std::uint64_t seed = 100;
    for (const auto& [pedestal, read_e] : {std::pair(0.0, 2.0),
                                           {0.1, 2.0},
                                           {0.2, 2.0},
                                           {0.3, 2.0},
                                           {0.5, 2.0},
                                           {0.6, 2.0},
                                           {1.0, 2.0},
                                           {0.0, 1.0},
                                           {0.0, 3.0},
                                           {0.0, 4.0},
                                           {0.0, 6.0},
                                           {0.5, 1.0},
                                           {0.3, 4.0},
                                           {0.5, 6.0}}) {
        const auto verdict = [&, pedestal = pedestal,
                              read_e = read_e](const std::function<void(int, int, Spot&)>& flaw) {
            ++seed;
            return pipeline->inspect(seen_by(part(wobble(seed), flaw), pedestal, read_e, seed).view())->verdict;
        };
        EXPECT_EQ(verdict([](int, int, Spot&) {}), Verdict::pass) << pedestal << " DN, " << read_e << " electrons";
        EXPECT_EQ(verdict(speck), Verdict::reject) << pedestal << " DN, " << read_e << " electrons";
        EXPECT_EQ(verdict(grey), Verdict::reject) << pedestal << " DN, " << read_e << " electrons";
    }
}

}  // namespace
}  // namespace hord::algo
