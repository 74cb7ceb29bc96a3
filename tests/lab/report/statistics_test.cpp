// ROC areas, thresholds and POD curves against values worked out by hand or known in closed form.
#include "lab/report/statistics.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "hal_sim/optics/scene/noise.h"

namespace hord::lab {
namespace {

TEST(Detection, area_counts_pairs_in_the_right_order_and_ties_half) {
    // good 1, 2, 3; bad 2, 4: of six pairs 2 > 1, 2 = 2, 2 < 3, 4 > 1, 4 > 2, 4 > 3.
    const ScoredPlace scores[] = {{1, 0, false}, {2, 0, false}, {3, 0, false}, {2, 0, true}, {4, 0, true}};
    EXPECT_DOUBLE_EQ(detection_of(scores, 0, 0, 1).auc.value, 4.5 / 6);
}

TEST(Detection, threshold_keeps_the_false_positives_and_never_cuts_a_tie) {
    std::vector<ScoredPlace> scores;
    for (int k = 0; k < 10; ++k) scores.push_back({static_cast<float>(k), 0, false});
    for (const float bad : {9.5F, 9.0F, 8.5F, 3.0F}) scores.push_back({bad, 0, true});
    const auto none = detection_of(scores, 0.0, 0, 1);  // only 9.5 is above every good score
    EXPECT_DOUBLE_EQ(none.tpr.value, 0.25);
    EXPECT_FLOAT_EQ(none.threshold, 9.0F);
    const auto one = detection_of(scores, 0.1, 0, 1);  // the good 9 may count, and with it the bad 9 and 8.5
    EXPECT_DOUBLE_EQ(one.tpr.value, 0.75);
    EXPECT_FLOAT_EQ(one.threshold, 8.0F);
}

TEST(Detection, without_both_kinds_there_is_nothing_to_say) {
    const ScoredPlace only_good[] = {{1, 0, false}, {2, 1, false}};
    EXPECT_EQ(detection_of(only_good, 0.1, 10, 1).auc.high, 0);
    EXPECT_EQ(detection_of({}, 0.1, 10, 1).auc.value, 0);
}

TEST(Detection, a_difference_of_areas_is_of_the_same_draws) {
    // b is a with two pairs exchanged: of six pairs, a has all in order, b four.
    const ScoredPlace a[] = {{1, 0, false}, {2, 1, false}, {3, 2, false}, {4, 3, true}, {5, 4, true}};
    const ScoredPlace b[] = {{1, 0, false}, {2, 1, false}, {4.5F, 2, false}, {4, 3, true}, {1.5F, 4, true}};
    EXPECT_DOUBLE_EQ(auc_difference(a, b, 0, 1).value, 1 - 3.0 / 6);
    // Compared with itself the difference is zero in every draw.
    const Estimate none = auc_difference(b, b, 200, 1);
    EXPECT_EQ(none.value, 0);
    EXPECT_EQ(none.low, 0);
    EXPECT_EQ(none.high, 0);
    // A monotone function of the scores keeps the area: the difference is 0 in every draw, although each area alone has
    // an interval.
    std::vector<ScoredPlace> cubed(std::begin(b), std::end(b));
    for (ScoredPlace& s : cubed) s.score = s.score * s.score * s.score;
    EXPECT_EQ(auc_difference(b, cubed, 200, 1).high, 0);
    EXPECT_GT(detection_of(b, 0, 200, 1).auc.high, detection_of(b, 0, 200, 1).auc.low);
}

TEST(Limit, is_the_gumbel_quantile_and_never_below_what_was_seen) {
    EXPECT_EQ(gumbel_limit({}, 1e-3), 0);
    const double same[] = {2, 2, 2};
    EXPECT_NEAR(gumbel_limit(same, 1e-3), 2, 1e-4);
    // Quantiles of a Gumbel distribution of location 3 and scale 0.5, evenly spread: the fit finds it.
    std::vector<double> good;
    for (int k = 0; k < 20'000; ++k) good.push_back(3 - 0.5 * std::log(-std::log((k + 0.5) / 20'000)));
    EXPECT_NEAR(gumbel_limit(good, 1e-2), std::max(good.back(), 3 - 0.5 * std::log(-std::log(1 - 1e-2))), 0.02);
    EXPECT_EQ(gumbel_limit(good, 1e-2), good.back());
    good.resize(19'900);  // the highest 1 % is missing
    EXPECT_NEAR(gumbel_limit(good, 1e-3), 3 - 0.5 * std::log(-std::log(1 - 1e-3)), 0.3);
    EXPECT_GT(gumbel_limit(good, 1e-3), good.back());
}

// A part at the value passes at the station: a severity of 1 rejects, and floats hold the limits and 1 - transmission.
TEST(Limit, of_three_digits_passes_a_part_at_the_value_in_single_precision) {
    EXPECT_EQ(limit_above(0), 0);
    EXPECT_NEAR(limit_above(0.02942), 0.0295, 1e-12);
    EXPECT_NEAR(limit_above(0.0295), 0.0296, 1e-12);
    for (int digits = 100; digits < 1000; ++digits) {
        for (const double unit : {1e-5, 1e-4, 1e-3, 1e-2}) {
            const double value = digits * unit, limit = limit_above(value);
            EXPECT_GT(static_cast<float>(limit), static_cast<float>(value));
            EXPECT_LE(limit, value * 1.0101);
            if (limit >= 1) continue;
            EXPECT_LT((1 - static_cast<float>(1 - value)) / (1 - static_cast<float>(1 - limit)), 1) << value;
        }
    }
}

// Normal scores, the bad ones shifted by d: the area is Phi(d / sqrt 2).
std::vector<ScoredPlace> normal_scores(std::uint64_t seed, double shift, int parts, int each) {
    std::vector<ScoredPlace> scores;
    sim::Noise draw(seed, 0);
    for (int part = 0; part < parts; ++part) {
        for (int k = 0; k < each; ++k) {
            const bool bad = k % 2 == 0;
            scores.push_back(
                {static_cast<float>(draw.normal() + (bad ? shift : 0)), static_cast<std::uint32_t>(part), bad});
        }
    }
    return scores;
}

TEST(Detection, intervals_hold_the_truth_as_often_as_they_say) {
    const double truth = 0.5 * std::erfc(-1 / std::sqrt(2.0));  // Phi(1): shifted by sqrt 2
    constexpr int kTrials = 200;
    int held = 0;
    for (int trial = 0; trial < kTrials; ++trial) {
        const auto found =
            detection_of(normal_scores(static_cast<std::uint64_t>(trial), std::sqrt(2.0), 40, 10), 0.1, 200, 7);
        if (found.auc.low <= truth && truth <= found.auc.high) ++held;
    }
    // 95 % of 200: binomial standard deviation 3.1; the percentile bootstrap of 40 parts is known to hold a little less
    // often.
    EXPECT_GE(held, 176);
}

TEST(Detection, places_of_one_part_widen_the_interval) {
    auto many_parts = normal_scores(1, 1.0, 200, 10);
    auto few_parts = many_parts;
    for (ScoredPlace& s : few_parts) s.part /= 20;
    // The same scores in ten parts, equal within a part: the interval must be wider than for independent scores.
    for (ScoredPlace& s : few_parts) s.score += static_cast<float>(s.part % 2) * (s.bad ? 1.0F : 0.0F);
    for (ScoredPlace& s : many_parts) s.score += static_cast<float>(s.part / 20 % 2) * (s.bad ? 1.0F : 0.0F);
    const auto wide = detection_of(few_parts, 0.1, 300, 3).auc, narrow = detection_of(many_parts, 0.1, 300, 3).auc;
    EXPECT_DOUBLE_EQ(wide.value, narrow.value);
    EXPECT_GT(wide.high - wide.low, 1.5 * (narrow.high - narrow.low));
}

TEST(PodCurve, finds_the_curve_that_drew_the_trials) {
    const double b1 = 6, b0 = -b1 * std::log(0.4);  // a50 = 0.4
    std::vector<DetectionTrial> tried;
    sim::Noise draw(5, 0);
    for (int k = 0; k < 4000; ++k) {
        const double size = 0.1 * std::exp(draw.uniform() * std::log(20.0));
        tried.push_back({size, draw.uniform() < 1 / (1 + std::exp(-b0 - b1 * std::log(size)))});
    }
    const PodCurve curve = pod_curve(tried);
    ASSERT_TRUE(curve.a50 && curve.a90 && curve.a90_95);
    EXPECT_NEAR(*curve.a50, 0.4, 0.02);
    EXPECT_NEAR(*curve.a90, 0.4 * std::exp(std::log(9.0) / b1), 0.03);
    EXPECT_GT(*curve.a90_95, *curve.a90);
    EXPECT_LT(*curve.a90_95, 1.1 * *curve.a90);
    EXPECT_NEAR(curve.at(*curve.a90), 0.9, 1e-9);
}

TEST(PodCurve, stays_finite_where_hits_and_misses_are_separated) {
    std::vector<DetectionTrial> tried;
    for (int k = 1; k <= 40; ++k) tried.push_back({0.05 * k, k > 20});
    const PodCurve curve = pod_curve(tried);
    ASSERT_TRUE(curve.a90);
    EXPECT_GT(*curve.a90, 1.0);
    EXPECT_LT(*curve.a90, 1.3);
}

TEST(PodCurve, says_nothing_where_size_does_not_help) {
    std::vector<DetectionTrial> tried;
    for (int k = 1; k <= 40; ++k) tried.push_back({0.05 * k, false});
    EXPECT_FALSE(pod_curve(tried).a90_95);
    for (std::size_t k = 0; k < tried.size(); ++k) tried[k].found = k % 2 == 0;
    EXPECT_FALSE(pod_curve(tried).a90_95);
    EXPECT_FALSE(pod_curve({}).a90);
}

// Samples at the inverse tail function of a distribution, at the middles of equal shares.
template <class Inverse>
std::vector<double> drawn_evenly(int count, const Inverse& exceeded_by) {
    std::vector<double> values;
    for (int k = 0; k < count; ++k) values.push_back(exceeded_by((k + 0.5) / count));
    return values;
}

TEST(TailLimit, goes_beyond_the_values_as_their_tail_does) {
    // Exponential: a share p exceeds -ln p. Pareto of shape 0.2: p to the power of -0.2.
    EXPECT_NEAR(tail_limit(drawn_evenly(2000, [](double p) { return -std::log(p); }), 1e-5), -std::log(1e-5), 0.3);
    EXPECT_NEAR(tail_limit(drawn_evenly(2000, [](double p) { return std::pow(p, -0.2); }), 1e-5), 10, 0.7);
}

TEST(TailLimit, does_not_believe_in_an_end) {
    // Uniform up to 1: the limit still lies above 1, because the fit assumes no end of the tail.
    EXPECT_GT(tail_limit(drawn_evenly(2000, [](double p) { return 1 - p; }), 1e-5), 1.1);
}

TEST(TailLimit, is_never_below_the_largest_value) {
    std::vector<double> values = drawn_evenly(200, [](double p) { return -std::log(p); });
    values.push_back(50);
    EXPECT_GE(tail_limit(values, 0.01), 50);
    EXPECT_DOUBLE_EQ(tail_limit({3, 3, 3, 3, 3}, 1e-3), 3);
    EXPECT_DOUBLE_EQ(tail_limit({1, 2}, 1e-3), 2);
    EXPECT_DOUBLE_EQ(tail_limit({}, 1e-3), 0);
}

TEST(Quantile, is_linear_between_neighbours) {
    EXPECT_DOUBLE_EQ(quantile({3, 1, 2}, 0.5), 2);
    EXPECT_DOUBLE_EQ(quantile({0, 10}, 0.25), 2.5);
    EXPECT_DOUBLE_EQ(quantile({}, 0.5), 0);
}

}  // namespace
}  // namespace hord::lab
