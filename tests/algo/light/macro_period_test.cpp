// The period of macro-pixels, with parts of any deflection, and in frames that have none.
#include "algo/light/macro_period.h"

#include <random>

#include <gtest/gtest.h>

#include "tests/support/odd_frames.h"

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

}  // namespace
}  // namespace hord::algo
