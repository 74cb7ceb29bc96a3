// The period of macro-pixels, with parts of any deflection, and in frames that have none.
#include "algo/light/macro_period.h"

#include <functional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/light_image.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

Frame of(const Extents& e, double rim_bins, double radius_share) {
    return exposed(spots(e, 200, 0.6, lens(e, radius_share * std::min(e.m, e.n), rim_bins)), {}, 1);
}
MacroPeriod found(const Frame& frame, const Extents& read_as) { return MacroPeriodFinder(read_as).find(frame.view()); }

TEST(MacroPeriod, of_every_number_of_bins_is_found_and_expected) {
    for (int bins = 3; bins <= kMaxBins; ++bins) {
        const Extents e{60, 48, bins, bins};
        const MacroPeriod period = found(of(e, 0.25 * bins, 0.35), e);
        EXPECT_TRUE(period.expected) << bins;
        EXPECT_EQ(std::pair(period.x, period.y), std::pair(bins, bins));
    }
}

TEST(MacroPeriod, of_rectangular_ones_is_found_along_each_axis) {
    const Extents e{60, 48, 5, 8};
    const MacroPeriod period = found(of(e, 1, 0.35), e);
    EXPECT_TRUE(period.expected);
    EXPECT_EQ(std::pair(period.x, period.y), std::pair(5, 8));
}

TEST(MacroPeriod, of_another_geometry_contradicts_and_is_named) {
    for (const auto& [real, said] :
         {std::pair(3, 9), std::pair(9, 3), std::pair(5, 9), std::pair(9, 5), std::pair(9, 15), std::pair(15, 9),
          std::pair(5, 15), std::pair(15, 5), std::pair(3, 15)}) {
        for (const double rim : {0.0, 0.25}) {
            const Extents e{90, 90, real, real}, read_as{90 * real / said, 90 * real / said, said, said};
            if (90 * real % said != 0) continue;
            const MacroPeriod period = found(of(e, rim * real, 0.4), read_as);
            EXPECT_FALSE(period.expected) << real << " read as " << said;
            EXPECT_EQ(std::pair(period.x, period.y), std::pair(real, real));
        }
    }
}

// A part that fills the field and uses most of the bins: no other period is claimed.
TEST(MacroPeriod, of_a_part_that_fills_the_field_is_never_contradicted) {
    for (int bins = 3; bins <= kMaxBins; ++bins) {
        for (const double radius : {0.5, 0.7, 1.0, 2.0}) {
            for (const double rim : {0.1, 0.2, 0.3, 0.4}) {
                const Extents e{44, 40, bins, bins};
                EXPECT_TRUE(found(of(e, rim * bins, radius), e).expected) << bins << " " << radius << " " << rim;
            }
        }
    }
}

TEST(MacroPeriod, is_not_claimed_of_fog_noise_ramps_and_darkness) {
    const Extents e{40, 40, 9, 9};
    std::mt19937_64 random(1);
    for (int kind = 0; kind < 4; ++kind) {
        Frame frame(e.width_px(), e.height_px(), 8);
        for (int y = 0; y < frame.height_px(); ++y) {
            for (int x = 0; x < frame.width_px(); ++x) {
                const auto any = static_cast<std::uint32_t>(random() % 100);
                frame.set(x, y,
                          kind == 0       ? 0
                              : kind == 1 ? 120
                              : kind == 2 ? any
                                          : static_cast<std::uint32_t>((x + y) / 4));
            }
        }
        const MacroPeriod period = found(frame, e);
        EXPECT_TRUE(period.expected);
        EXPECT_EQ(std::pair(period.x, period.y), std::pair(0, 0)) << kind;
    }
}

TEST(MacroPeriod, is_not_looked_for_in_fields_of_three_lenslets) {
    const Extents e{3, 3, 3, 3};
    EXPECT_EQ(found(of(e, 0, 0), e).x, 0);
}

// One line of samples: `of(k)` DN each.
int period(std::size_t samples, int expected, const std::function<int(int)>& of) {
    std::vector<std::uint32_t> profile(samples);
    for (std::size_t k = 0; k < samples; ++k) profile[k] = static_cast<std::uint32_t>(of(static_cast<int>(k)));
    return period_of(profile, expected);
}
std::function<int(int)> every(int period, int amplitude = 100) {
    return [=](int k) { return k % period == 1 ? amplitude : 0; };
}

TEST(PeriodOf, a_profile_is_the_expected_one_unless_another_explains_much_more) {
    for (int real = 2; real <= kMaxBins; ++real) {
        EXPECT_EQ(period(120, real, every(real)), real);
        EXPECT_EQ(period(120, real % 7 == 0 ? 9 : 7, every(real)), real);
    }
    // A divisor of the expected period explains all that it does; a multiple explains it, too.
    EXPECT_EQ(period(120, 14, every(7)), 7);
    EXPECT_EQ(period(120, 3, every(9)), 9);
    // Both periods, the expected one weaker: it stays as long as it explains 0.3 of the best.
    const auto both = [](int of_nine) { return [=](int k) { return every(5, 100)(k) + every(9, of_nine)(k); }; };
    EXPECT_EQ(period(180, 9, both(100)), 9);
    EXPECT_EQ(period(180, 9, both(30)), 5);
}

TEST(PeriodOf, a_profile_is_looked_for_in_windows_of_sixty_samples_and_in_four_periods) {
    EXPECT_EQ(period(36, 9, every(9)), 9);
    EXPECT_EQ(period(35, 9, every(9)), 0);
    EXPECT_EQ(period(60, 15, every(15)), 15);
    EXPECT_EQ(period(59, 15, every(15)), 0);
    EXPECT_EQ(period(600, 16, every(16)), 0);  // longer than any macro-pixel
    EXPECT_EQ(period(600, 9, every(16)), 0);
    // What is left after the last whole window is not read; every whole one is.
    const auto from = [](int first) { return [=](int k) { return k < first ? every(9, 10)(k) : every(5, 1000)(k); }; };
    EXPECT_EQ(period(119, 9, from(60)), 9);
    EXPECT_EQ(period(120, 9, from(60)), 5);
    EXPECT_EQ(period(60, 5, [](int k) { return k == 0 ? 0 : every(9)(k); }), 9);
}

TEST(PeriodOf, nothing_is_none) {
    EXPECT_EQ(period(120, 9, [](int) { return 0; }), 0);
    EXPECT_EQ(period(120, 9, [](int) { return 7; }), 0);
    EXPECT_EQ(period(120, 9, [](int k) { return k; }), 0);
    EXPECT_EQ(period(120, 9, [](int k) { return k == 50 ? 100 : 0; }), 0);
    // At least half of the variance: a period on top of as much of something else.
    std::mt19937 random(3);
    std::vector<int> noise(600);
    for (int& v : noise) v = static_cast<int>(random() % 100);
    const auto on_noise = [&](int amplitude) {
        return [&noise, amplitude](int k) { return every(9, amplitude)(k) + noise[static_cast<std::size_t>(k)]; };
    };
    EXPECT_EQ(period(600, 9, on_noise(160)), 9);
    EXPECT_EQ(period(600, 9, on_noise(40)), 0);
}

// A long period has more means to fit: without its degrees of freedom one window of noise would have a period in 20.
TEST(PeriodOf, noise_in_one_window_is_none_however_long_the_period_may_be) {
    std::mt19937 random(5);
    for (int draw = 0; draw < 300; ++draw) {
        std::vector<int> noise(60);
        for (int& v : noise) v = static_cast<int>(random() % 100);
        EXPECT_EQ(period(60, 9, [&](int k) { return noise[static_cast<std::size_t>(k)]; }), 0) << draw;
    }
}

// Each axis is read in bands over the whole field: light in one corner of it is enough.
TEST(MacroPeriod, is_found_wherever_in_the_field_the_light_is) {
    const Extents e{90, 90, 5, 5}, read_as{50, 50, 9, 9};
    for (const auto& [left, top] : {std::pair(0, 0), std::pair(60, 0), std::pair(0, 60), std::pair(60, 60)}) {
        const LightImage light = spots(e, 200, 0.6, [left = left, top = top](int m, int n) {
            return Spot{0, 0, m >= left && m < left + 30 && n >= top && n < top + 30 ? 1.0 : 0.0};
        });
        const MacroPeriod period = found(exposed(light, {}, 1), read_as);
        EXPECT_EQ(std::pair(period.x, period.y), std::pair(5, 5)) << left << " " << top;
    }
}

// One axis alone contradicts; 12 bits; the finder is used again.
TEST(MacroPeriod, of_one_axis_is_enough_to_contradict) {
    const Extents read_as{50, 50, 9, 9};
    MacroPeriodFinder finder(read_as);
    const auto find = [&](const Extents& real) {
        return finder.find(exposed(spots(real, 200, 0.6, [](int, int) { return Spot{}; }), {}, 1).view());
    };
    for (int again = 0; again < 2; ++again) {
        EXPECT_EQ(find({90, 50, 5, 9}).x, 5);
        EXPECT_FALSE(find({90, 50, 5, 9}).expected);
        EXPECT_EQ(find({50, 90, 9, 5}).y, 5);
        EXPECT_FALSE(find({50, 90, 9, 5}).expected);
        EXPECT_TRUE(find(read_as).expected);
        EXPECT_EQ(finder.find(Frame(450, 450, 8).view()).x, 0);
    }
    const Frame deep = exposed(spots({90, 50, 5, 9}, 200, 0.6, [](int, int) { return Spot{}; }), {}, 1, 12);
    EXPECT_EQ(finder.find(deep.view()).x, 5);
    EXPECT_EQ(finder.find(deep.view()).y, 9);
}

}  // namespace
}  // namespace hord::algo
