// A reference judged by parts that it was not learned from, and flaws painted into them.
#include "algo/good_parts/reference_check.h"

#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "tests/algo/good_parts/drawn_parts.h"

namespace hord::algo {
namespace {

using namespace testing;
using ::testing::HasSubstr;

CheckOptions options() {
    CheckOptions o;
    o.learning.levels = {6, 60, 4095};
    o.learning.electrons_per_dn = 1.0F, o.learning.read_dn = 2;
    o.recipe.dark_dn = 6, o.recipe.min_sum_dn = 60;
    return o;
}
Result<Frame> frame_of(std::size_t k) { return draw(placed_part(k + 1)); }
std::vector<std::size_t> each_its_own(std::size_t count) {
    std::vector<std::size_t> parts;
    for (std::size_t k = 0; k < count; ++k) parts.push_back(k);
    return parts;
}

TEST(ReferenceCheck, good_parts_pass_and_the_sizes_it_tells_are_found) {
    constexpr std::size_t kParts = 24;
    const auto check =
        check_reference(kDrawn, 12, kParts, frame_of, each_its_own(kParts), std::vector<bool>(kParts, true), options());
    ASSERT_TRUE(check) << check.error().message();
    EXPECT_EQ(check->not_checked, "");
    EXPECT_EQ(check->judged.size(), kParts);
    EXPECT_EQ(check->false_rejects.rejected, 0U);
    EXPECT_LT(check->false_rejects.bound(), most_rejected(0, kParts) + 1e-9);
    std::vector<double> together;
    for (const ReferenceCheck::Judged& part : check->judged) together.push_back(part.together);
    EXPECT_NEAR(check->pooled_score, predicted_light_tailed_limit(together, kAimedFalseRejects / 2), 1e-9);
    EXPECT_LT(check->pooled_score, limit_for(together, kAimedFalseRejects / 2));
    for (std::size_t kind = 0; kind < kPaintedFlaws.size(); ++kind) {
        const auto& flaw = check->flaws[kind];
        EXPECT_GE(flaw.trials, 48U);
        ASSERT_TRUE(flaw.curve.a90) << kPaintedFlaws[kind].name;
        EXPECT_GT(*flaw.curve.a90, kPaintedFlaws[kind].least) << kPaintedFlaws[kind].name;
    }
    // 1,000 electrons in the brightest bin, about 2,200 a lenslet: noise of 2 %. A reject score of 6 is 13 % of the
    // light: a disc of 0.2 lenslets radius within a lenslet, or of 0.4 where it lies in the corner of four.
    EXPECT_NEAR(*check->flaws[0].curve.a90, 0.3, 0.15);

    // Flaws of these sizes in other parts, judged by a reference that was learned from all.
    auto learned = learn_reference(kDrawn, 12, kParts, frame_of, options().learning);
    ASSERT_TRUE(learned);
    Recipe recipe = options().recipe;
    recipe.reference = std::make_shared<const Reference>(std::move(learned->reference));
    auto pipeline = Pipeline::create(kDrawn, 12, recipe);
    ASSERT_TRUE(pipeline);
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> place(5, 18), turn(0, 6.28);
    for (std::size_t kind = 0; kind < kPaintedFlaws.size(); ++kind) {
        constexpr int kTrials = 60;
        int found = 0;
        for (int k = 0; k < kTrials; ++k) {
            Frame frame = draw(placed_part(static_cast<std::uint64_t>(500 + k)));
            paint(frame, kDrawn, static_cast<PaintedFlaw>(kind), place(random), place(random),
                  *check->flaws[kind].curve.a90, turn(random), 0);
            const auto seen = pipeline->inspect(frame.view());
            ASSERT_TRUE(seen);
            found += seen->verdict == Verdict::reject ? 1 : 0;
        }
        // 90 % of 60 is 54; the size itself comes from 48 trials.
        EXPECT_GE(found, 42) << kPaintedFlaws[kind].name;
    }
}

TEST(ReferenceCheck, exposures_of_one_part_are_left_out_together_and_count_once) {
    constexpr std::size_t kFrames = 30;  // of ten parts
    std::vector<std::size_t> part_of;
    for (std::size_t k = 0; k < kFrames; ++k) part_of.push_back(k % 10);
    const auto exposure = [](std::size_t k) -> Result<Frame> {
        DrawnPart part = placed_part(k % 10);
        part.noise = 100 + k;
        return draw(part);
    };
    CheckOptions o = options();
    o.trials = 0;
    const auto check = check_reference(kDrawn, 12, kFrames, exposure, part_of, std::vector<bool>(kFrames, true), o);
    ASSERT_TRUE(check);
    EXPECT_EQ(check->judged.size(), kFrames);
    EXPECT_EQ(check->worst_scores.size(), 10U);
    EXPECT_EQ(check->false_rejects.parts, 10U);
}

TEST(ReferenceCheck, of_too_few_parts_says_how_many_it_takes) {
    const auto check = check_reference(kDrawn, 12, 9, frame_of, each_its_own(9), std::vector<bool>(9, true), options());
    ASSERT_TRUE(check);
    EXPECT_THAT(check->not_checked, HasSubstr("9 distinct parts are too few"));
    EXPECT_THAT(check->not_checked, HasSubstr("give at least 11"));
    EXPECT_TRUE(check->judged.empty());
}

TEST(ReferenceCheck, tells_nothing_of_sizes_that_were_not_tried) {
    const PaintedFlawKind& dimple = kind_of(PaintedFlaw::dimple);
    PodCurve curve;
    curve.a90 = 1.3e-17, curve.a90_95 = 2 * dimple.most;
    keep_to_tried(curve, dimple);
    EXPECT_EQ(curve.a90, dimple.least);
    EXPECT_FALSE(curve.a90_95);
}

TEST(ReferenceCheck, writes_numbers_without_exponents) {
    ReferenceCheck check;
    check.worst_scores = {0.5, 0.7};
    check.pooled_score = 187.3;
    ReferenceCheck::Found& dimples = check.flaws[static_cast<std::size_t>(PaintedFlaw::dimple)];
    dimples.trials = dimples.found = 96;
    dimples.curve.a90 = kind_of(PaintedFlaw::dimple).least;
    const CheckSentences told = describe(check, options().recipe, {});
    EXPECT_THAT(told.false_rejects.back(), HasSubstr("pooled_score 190, as hordctl tune would set it, 0.05 %"));
    ASSERT_EQ(told.flaws.size(), 1U);
    EXPECT_THAT(told.flaws[0],
                HasSubstr("Dimple: the smallest that was tried, deflection 0.02 bins, is found in nine of ten cases"));
}

}  // namespace
}  // namespace hord::algo
