#include <gtest/gtest.h>

#include "algo/recipe/recipe.h"

namespace hord::algo {
namespace {

Recipe scaled_by(double factor) {
    Recipe recipe;
    recipe.reject_score = 6, recipe.grow_score = 3.5F, recipe.cluster_score = 9;
    scale_score_limits(recipe, factor);
    return recipe;
}

TEST(ScoreLimits, higher_ones_scale_together) {
    const Recipe recipe = scaled_by(2);
    EXPECT_FLOAT_EQ(recipe.reject_score, 12);
    EXPECT_FLOAT_EQ(recipe.grow_score, 7);
    EXPECT_FLOAT_EQ(recipe.cluster_score, 18);
}

TEST(ScoreLimits, lower_ones_do_not_grow_over_noise) {
    const Recipe recipe = scaled_by(0.75);
    EXPECT_FLOAT_EQ(recipe.reject_score, 4.5);
    EXPECT_FLOAT_EQ(recipe.grow_score, 3.5);
    EXPECT_FLOAT_EQ(recipe.cluster_score, 6.75);
}

TEST(ScoreLimits, grow_score_stays_at_most_the_reject_score) {
    const Recipe recipe = scaled_by(0.5);
    EXPECT_FLOAT_EQ(recipe.reject_score, 3);
    EXPECT_FLOAT_EQ(recipe.grow_score, 3);
}

}  // namespace
}  // namespace hord::algo
