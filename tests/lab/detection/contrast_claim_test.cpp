// The contrast claim: at every place and seed at least 0.9 of the surest possible score, and at least twice the EMD
// gradient wherever the surest possible is.
#include <gtest/gtest.h>

#include "lab/detection/detection_statistics.h"

namespace hord::lab {
namespace {

constexpr PlaceContrast kFine{.m = 0, .n = 0, .seed = 1, .emd = 20, .score = 57, .surest = 60};

TEST(ContrastClaim, holds_if_every_place_is_fine_and_prints_least_median_and_most) {
    PlaceContrast better = kFine, best = kFine;
    better.score = 60, best.score = 66;
    const ContrastClaim claim = contrast_claim({best, kFine, better});
    EXPECT_TRUE(claim.holds());
    EXPECT_DOUBLE_EQ(claim.of_surest.least, 57.0 / 60);
    EXPECT_DOUBLE_EQ(claim.of_surest.median, 1);
    EXPECT_DOUBLE_EQ(claim.of_surest.most, 1.1);
    EXPECT_DOUBLE_EQ(claim.over_emd.least, 57.0 / 20);
    EXPECT_EQ(claim.beyond_reach, 0U);
}

TEST(ContrastClaim, one_place_of_one_seed_below_nine_tenths_breaks_it) {
    PlaceContrast low = kFine;
    low.seed = 3, low.m = 0.25, low.score = 53.9;
    const ContrastClaim claim = contrast_claim({kFine, kFine, low});
    EXPECT_FALSE(claim.holds());
    ASSERT_EQ(claim.below_surest.size(), 1U);
    EXPECT_EQ(claim.below_surest[0].seed, 3U);
    EXPECT_TRUE(claim.below_emd.empty());
    low.score = 54;  // exactly 0.9
    EXPECT_TRUE(contrast_claim({low}).holds());
}

TEST(ContrastClaim, twice_the_emd_gradient_is_asked_for_only_where_it_is_possible) {
    PlaceContrast place = kFine;
    place.emd = 29, place.score = 57;  // 60 is more than 58, 57 is not
    EXPECT_EQ(contrast_claim({place}).below_emd.size(), 1U);
    EXPECT_FALSE(contrast_claim({place}).holds());
    place.emd = 31;  // 60 is less than 62: out of reach
    EXPECT_TRUE(contrast_claim({place}).holds());
    EXPECT_EQ(contrast_claim({place}).beyond_reach, 1U);
    place.emd = -0.5, place.score = 57;  // below one sigma counts as one
    EXPECT_DOUBLE_EQ(contrast_claim({place}).over_emd.least, 57);
}

TEST(ContrastClaim, of_no_places_has_no_numbers) { EXPECT_EQ(contrast_claim({}).over_emd.most, 0); }

}  // namespace
}  // namespace hord::lab
