#include "hal_sim/cell/production.h"

#include <gtest/gtest.h>

namespace hord::sim {
namespace {

ProductionOptions two_of_each() {
    ProductionOptions options;
    options.clean = line_lens(9, 9);
    options.seed = 5;
    options.good_parts = options.of_each_defect = 2;
    return options;
}

// Soaks and kept stores depend on it.
TEST(Production, more_kinds_leave_the_parts_of_the_others_as_they_are) {
    ProductionOptions options = two_of_each();
    const auto few = draw_production(options);
    options.defects.assign(kAllDefects.begin(), kAllDefects.end());
    const auto many = draw_production(options);
    ASSERT_TRUE(few && many);
    ASSERT_EQ(few->scenes.size(), 2U * (1 + kLightTakers.size()));
    ASSERT_EQ(many->scenes.size(), 2U * kPartClassNames.size());
    for (std::size_t k = 0; k < few->scenes.size(); ++k) {
        const Scene &a = few->scenes[k], &b = many->scenes[k];
        EXPECT_EQ(a.name, b.name);
        EXPECT_EQ(a.pose.x_mm, b.pose.x_mm);
        EXPECT_EQ(few->kinds[k].name, many->kinds[k].name);
        ASSERT_EQ(a.defects.size(), b.defects.size());
        if (const auto* bubble = a.defects.empty() ? nullptr : std::get_if<AirBubble>(a.defects.data())) {
            EXPECT_EQ(bubble->centre_mm.x, std::get<AirBubble>(b.defects[0]).centre_mm.x);
        }
    }
}

TEST(Production, of_every_kind_can_be_rendered_and_has_one_defect_a_bad_part) {
    for (const std::uint64_t seed : {1, 2, 3, 4, 5, 6, 7, 8}) {
        ProductionOptions options = two_of_each();
        options.seed = seed;
        options.defects.assign(kAllDefects.begin(), kAllDefects.end());
        const auto drawn = draw_production(options);
        ASSERT_TRUE(drawn);
        double share = 0;
        for (std::size_t k = 0; k < drawn->scenes.size(); ++k) {
            EXPECT_TRUE(problems(drawn->scenes[k]).empty()) << drawn->scenes[k].name;
            EXPECT_EQ(drawn->scenes[k].defects.size(), drawn->kinds[k].bad ? 1U : 0U) << drawn->scenes[k].name;
            share += drawn->kinds[k].share;
        }
        EXPECT_NEAR(share, 1, 1e-12);
    }
}

}  // namespace
}  // namespace hord::sim
