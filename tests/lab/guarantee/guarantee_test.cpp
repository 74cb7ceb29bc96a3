// The drawn families, and the bound with one seed of each.
#include "lab/guarantee/guarantee.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "lab/guarantee/drawn_families.h"

namespace hord::lab {
namespace {

bool same(const Frame& a, const Frame& b) { return std::ranges::equal(a.bytes(), b.bytes()); }

TEST(DrawnFamilies, parts_of_a_seed_repeat_and_others_differ) {
    for (std::size_t family = 0; family < drawn_families().size(); ++family) {
        const Frame one = draw_good_part(family, 1, 1, 0);
        EXPECT_TRUE(same(one, draw_good_part(family, 1, 1, 0)));
        EXPECT_FALSE(same(one, draw_good_part(family, 1, 1, 0, 1)));
        EXPECT_FALSE(same(one, draw_good_part(family, 1, 1, 1)));
        EXPECT_FALSE(same(one, draw_good_part(family, 1, 2, 0)));
        EXPECT_FALSE(same(one, draw_good_part(family, 2, 1, 0)));
    }
}

TEST(Guarantee, tells_a_bound_for_every_family_and_counts_repeated_exposures_once) {
    int recognised = 0;
    for (std::size_t family = 0; family < drawn_families().size(); ++family) {
        const auto told = bounds_of(family, 7, 20);
        ASSERT_TRUE(told) << drawn_families()[family] << ": " << told.error().message();
        for (const auto* one : {&told->learned, &told->tuned}) {
            EXPECT_GT(one->bound, 0) << drawn_families()[family];
            EXPECT_LE(one->bound, 1) << drawn_families()[family];
        }
        // A wedge that fills the field, and a strip whose spots repeat every ten bins instead of nine, are judged, too.
        EXPECT_LE(told->learned.measured, 0.5) << drawn_families()[family];
        // Without an assumption 60 parts prove 4.9 %.
        EXPECT_LE(told->tuned.bound, 0.06) << drawn_families()[family];
        EXPECT_LE(told->counted, std::size_t{kTunedParts} + kTunedAgain) << drawn_families()[family];
        // Plates that lie alike by chance differ by no more than noise.
        EXPECT_GE(told->counted, std::size_t{kTunedParts} - 15) << drawn_families()[family];
        recognised += told->counted <= std::size_t{kTunedParts} + 3 ? 1 : 0;
    }
    // Where many parts lie nearly alike (plate, wedge, flat strip), a few repeated exposures may hide among them.
    EXPECT_GE(recognised, 6);
}

}  // namespace
}  // namespace hord::lab
