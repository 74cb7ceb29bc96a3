// The detection experiment's report: the claim about the cut is decided as the criterion says, and the page repeats the
// command line.
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "lab/detection/detection.h"
#include "tests/lab/support/folder.h"

namespace hord::lab {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Json place(double m, double n, std::uint64_t seed, double score) {
    const Json each{{"emd", {1.0}}, {"even", {1.0}}, {"z-score", {score}}, {"surest", {60.0}}};
    return {{"scene", "cut beside"}, {"seed", seed},     {"radius", 3.0},   {"shots", 1}, {"unfit", 0},
            {"each", each},          {"averaged", each}, {"beside", {m, n}}};
}

DetectionResults all_places(double score_at_one_place) {
    DetectionResults results;
    results.contrast = Json::array();
    for (std::uint64_t seed = 1; seed <= kContrastSeeds; ++seed) {
        for (int k = 0; k < 16; ++k)
            results.contrast.push_back(
                place(0.25 * (k % 4), 0.25 * (k / 4), seed, seed == 2 && k == 5 ? score_at_one_place : 58));
    }
    return results;
}

const Claim* claim_about_places(const ExperimentReport& report) {
    for (const Claim& claim : report.claims) {
        if (claim.text.starts_with("the cut at 16 places")) return &claim;
    }
    return nullptr;
}

TEST(DetectionReport, one_low_place_of_48_breaks_the_claim_and_is_shown) {
    const test::Folder folder;
    ExperimentOptions options;
    options.out = folder.path();
    options.quick = true;
    const auto fine = report_detection(all_places(55), options);
    ASSERT_TRUE(fine);
    const Claim* claim = claim_about_places(*fine);
    ASSERT_NE(claim, nullptr);
    EXPECT_EQ(claim->holds, true);
    EXPECT_THAT(claim->evidence, HasSubstr("0.92 at the least, 0.97 at the median, 0.97 at the most"));
    EXPECT_THAT(fine->text, HasSubstr("`hord-lab experiment detection --out DIR --seed 1 --quick`"));
    EXPECT_THAT(fine->text, Not(HasSubstr("{{")));

    const auto low = report_detection(all_places(53), options);
    ASSERT_TRUE(low);
    ASSERT_NE(claim_about_places(*low), nullptr);
    EXPECT_EQ(claim_about_places(*low)->holds, false);
    EXPECT_FALSE(low->as_expected());  // exit status 1
    EXPECT_THAT(low->text, HasSubstr("too low at 1 of 48"));
    EXPECT_THAT(low->text, HasSubstr("| 0.25, 0.25 | 2 | 1.0 | 53.0 | 53.0x | 60.0 | 0.88 **no** |"));
}

TEST(DetectionReport, fewer_places_are_not_finished) {
    const test::Folder folder;
    ExperimentOptions options;
    options.out = folder.path();
    DetectionResults results = all_places(58);
    results.contrast.erase(results.contrast.begin());
    const auto report = report_detection(results, options);
    ASSERT_TRUE(report);
    ASSERT_NE(claim_about_places(*report), nullptr);
    EXPECT_FALSE(claim_about_places(*report)->holds);
}

TEST(DetectionReport, tuned_limits_are_told_with_the_command_line) {
    const test::Folder folder;
    ExperimentOptions options;
    options.out = folder.path();
    options.tuned_limits = true;
    DetectionResults results = all_places(58);
    results.factor = 0.8, results.tuned_on = 4000;
    const auto report = report_detection(results, options);
    ASSERT_TRUE(report);
    EXPECT_THAT(report->text, HasSubstr("--seed 1 --tuned-limits`"));
    EXPECT_THAT(report->text, HasSubstr("The limits are not the recipe's (--tuned-limits)"));
    EXPECT_THAT(report->text, HasSubstr("reject_score 4.8"));
}

}  // namespace
}  // namespace hord::lab
