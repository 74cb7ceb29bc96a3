// Bounds of false rejects against values known in closed form, and against draws whose truth is known.
#include "algo/good_parts/false_rejects.h"

#include <cmath>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::algo {
namespace {

using ::testing::HasSubstr;

TEST(FalseRejects, any_is_the_rule_of_three_and_clopper_pearson) {
    EXPECT_EQ(most_rejected(0, 0), 1);
    EXPECT_EQ(most_rejected(5, 5), 1);
    EXPECT_NEAR(most_rejected(0, 59), 0.0495, 1e-4);  // 1 - 0.05^(1/59)
    EXPECT_NEAR(most_rejected(0, 3000), 3.0 / 3000, 1e-5);
    EXPECT_NEAR(most_rejected(1, 10), 0.3942, 1e-4);  // one-sided Clopper-Pearson, from tables
    EXPECT_NEAR(most_rejected(2, 60), 0.1012, 2e-4);
}

TEST(FalseRejects, parts_needed_are_the_fewest) {
    EXPECT_EQ(parts_needed(0, 3e-3), 998U);
    EXPECT_EQ(parts_needed(0, 1e-3), 2995U);
    for (const std::size_t rejected : {0U, 1U, 3U}) {
        const std::size_t needed = parts_needed(rejected, 0.01);
        EXPECT_LE(most_rejected(rejected, needed), 0.01);
        EXPECT_GT(most_rejected(rejected, needed - 1), 0.01);
    }
}

// Draws worst scores of n parts, sets the limit, and counts in how many of 100 draws the bound that is told holds.
template <class Draw, class Above>
int held(std::size_t parts, double share, const Draw& draw, const Above& above) {
    int count = 0;
    for (std::uint64_t seed = 1; seed <= 100; ++seed) {
        std::mt19937_64 random(seed);
        std::vector<double> scores;
        for (std::size_t k = 0; k < parts; ++k) scores.push_back(draw(random));
        const double limit = limit_for(scores, share);
        count += above(limit) <= false_rejects_at(scores, limit).tail.value_or(1) ? 1 : 0;
    }
    return count;
}

TEST(FalseRejects, the_tail_bound_holds_in_95_of_100_draws_that_follow_it) {
    std::uniform_real_distribution<double> uniform(1e-12, 1 - 1e-12);
    const auto gumbel = [&](auto& random) { return 0.6 - 0.08 * std::log(-std::log(uniform(random))); };
    const auto above_gumbel = [](double x) { return -std::expm1(-std::exp(-(x - 0.6) / 0.08)); };
    // A heavier tail: the logarithm is Gumbel.
    const auto heavy = [&](auto& random) { return 0.5 * std::exp(-0.15 * std::log(-std::log(uniform(random)))); };
    const auto above_heavy = [](double x) { return -std::expm1(-std::exp(-std::log(x / 0.5) / 0.15)); };
    // Half-normal: no Gumbel distribution at all, with a lighter tail.
    std::normal_distribution<double> normal;
    const auto half = [&](auto& random) { return 0.4 + 0.1 * std::abs(normal(random)); };
    const auto above_half = [](double x) { return std::erfc((x - 0.4) / 0.1 / std::sqrt(2.0)); };
    constexpr int kLeast = 95;  // the bound is computed with 98 %
    for (const std::size_t parts : {20U, 60U}) {
        EXPECT_GE(held(parts, 1e-3, gumbel, above_gumbel), kLeast) << parts;
        EXPECT_GE(held(parts, 1e-3, heavy, above_heavy), kLeast) << parts;
        EXPECT_GE(held(parts, 1e-3, half, above_half), kLeast) << parts;
    }
}

// 0.1 % in the mean over the draws, the error of 60 parts included; a limit by the fitted quantile rejects more.
TEST(FalseRejects, a_predicted_limit_is_exceeded_by_the_share_in_the_mean) {
    std::uniform_real_distribution<double> uniform(1e-12, 1 - 1e-12);
    for (const std::size_t parts : {20U, 60U}) {
        double share = 0, plugged = 0;
        constexpr int kDraws = 300;
        for (std::uint64_t seed = 1; seed <= kDraws; ++seed) {
            std::mt19937_64 random(seed);
            std::vector<double> scores;
            double mean = 0, square = 0;
            for (std::size_t k = 0; k < parts; ++k) {
                const double log = -0.15 * std::log(-std::log(uniform(random)));
                scores.push_back(0.5 * std::exp(log));
                mean += log / static_cast<double>(parts), square += log * log / static_cast<double>(parts);
            }
            const auto above = [](double limit) { return -std::expm1(-std::exp(-std::log(limit / 0.5) / 0.15)); };
            share += above(predicted_limit(scores, 1e-3)) / kDraws;
            plugged += above(0.5 * std::exp(mean + 4.936 * std::sqrt(square - mean * mean))) / kDraws;
        }
        EXPECT_NEAR(share, 1e-3, 2e-4) << parts;
        EXPECT_GT(plugged, 1.3 * share) << parts;
    }
}

TEST(FalseRejects, a_predicted_limit_is_above_the_highest_score_and_falls_with_more_parts) {
    EXPECT_EQ(predicted_limit({}, 1e-3), 0);
    const std::vector<double> one = {0.7};
    EXPECT_NEAR(predicted_limit(one, 1e-3), 0.707, 1e-9);
    std::vector<double> scores;
    double last = 1e9;
    std::mt19937_64 random(5);
    for (const std::size_t parts : {8U, 60U, 1000U}) {
        while (scores.size() < parts) scores.push_back(0.5 + 0.01 * static_cast<double>(random() % 10));
        const double limit = predicted_limit(scores, 1e-3);
        EXPECT_GT(limit, 0.59);
        EXPECT_LT(limit, last);
        last = limit;
    }
}

TEST(FalseRejects, more_parts_give_a_smaller_bound_at_the_same_limit) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform(1e-12, 1 - 1e-12);
    std::vector<double> scores;
    double last = 1;
    for (const std::size_t parts : {15U, 60U, 240U}) {
        while (scores.size() < parts) scores.push_back(0.4 - 0.05 * std::log(-std::log(uniform(random))));
        const FalseRejects r = false_rejects_at(scores, 1);
        EXPECT_EQ(r.parts, parts);
        EXPECT_EQ(r.rejected, 0U);
        ASSERT_TRUE(r.tail);
        EXPECT_LT(*r.tail, r.any);
        EXPECT_LT(r.bound(), last);
        last = r.bound();
    }
}

TEST(FalseRejects, scores_that_no_tail_explains_are_told_so) {
    std::vector<double> scores(60, 0.5);
    for (std::size_t k = 0; k < scores.size(); ++k) scores[k] += 1e-3 * static_cast<double>(k % 7);
    scores.back() = 0.95;  // one part in sixty is far away from all others
    const FalseRejects r = false_rejects_at(scores, 1);
    EXPECT_FALSE(r.tail);
    EXPECT_EQ(r.bound(), r.any);
    EXPECT_THAT(describe(r), HasSubstr("no distribution says more"));
}

TEST(FalseRejects, text_says_the_bound_its_assumption_and_how_many_more_parts) {
    std::vector<double> scores;
    for (int k = 0; k < 60; ++k) scores.push_back(0.5 + 0.002 * k);
    const std::string text = describe(false_rejects_at(scores, 1));
    EXPECT_THAT(text, HasSubstr("from 60 distinct good parts, none of them rejected"));
    EXPECT_THAT(text, HasSubstr("If their worst scores or the logarithms of these follow a Gumbel distribution"));
    EXPECT_THAT(text, HasSubstr("at most 4.9 %"));
    EXPECT_THAT(text, HasSubstr("0.3 % takes 938 more parts, 0.1 % 2935 more, none of them rejected."));
    scores[0] = 1.2;
    EXPECT_THAT(describe(false_rejects_at(scores, 1)), HasSubstr("1 of them rejected"));
}

}  // namespace
}  // namespace hord::algo
