// A verdict by bounds is that of the exact EMD; when a budget runs out, never a pass where the exact one rejects.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "tests/algo/inspection/judged_alike.h"
#include "tests/support/counted_heap.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace testing;

// A lens with noise; with a speck, a dent, fog, a pedestal with noise, dim light, holes; random light in every bin.
Frame any_frame(const Extents& e, std::mt19937_64& random) {
    const double radius = 0.4 * std::min(e.m, e.n), rim = 0.1 * pick(random, 0, 35) * std::min(e.i, e.j) / 9;
    const int kind = pick(random, 0, 9);
    const auto of_lens = lens(e, radius, rim);
    const double dent = 0.1 * pick(random, 0, 15), at_m = pick(random, 2, e.m - 3), at_n = pick(random, 2, e.n - 3);
    Frame frame = drawn(e, 8, 200, [&](int m, int n) {
        Spot s = of_lens(m, n);
        if (kind == 1 && std::hypot(m - at_m, n - at_n) < 2) s.x += dent;
        if (kind == 2) s.light = 0.3 + 0.7 * pick(random, 0, 1);
        return s;
    });
    if (kind == 3) frame = specked(frame, e, at_m, at_n, 1.5, 0.1 * pick(random, 0, 9));
    frame = noisy(frame, {static_cast<double>(pick(random, 1, 40)), 0.1 * pick(random, 0, 60), 1}, random());
    if (kind < 4) return frame;
    const int pedestal = pick(random, 0, 9), grey = pick(random, 1, 60);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            std::uint32_t dn = frame.view().sample(x, y);
            if (kind == 4) dn += static_cast<std::uint32_t>(pedestal);
            if (kind == 5) dn += static_cast<std::uint32_t>(pedestal + pick(random, 0, 2));
            if (kind == 6) dn = static_cast<std::uint32_t>(pick(random, 0, grey));
            if (kind == 7 && (x / e.i * 7 + y / e.j * 13) % 11 == 0) dn = pedestal > 5 ? 0 : 255;  // holes
            if (kind == 8 && pick(random, 0, 30) == 0) dn = static_cast<std::uint32_t>(pick(random, 0, 254));
            frame.set(x, y, std::min(dn, kind == 7 ? 255U : 254U));
        }
    }
    return frame;
}

// Limits near, at, and just beside values of the exact map; any choice of features.
Recipe any_recipe(const Inspection& exact, std::mt19937_64& random) {
    Recipe recipe;
    recipe.slopes = pick(random, 0, 2) > 0;
    recipe.light = pick(random, 0, 2) > 0;
    recipe.min_area = static_cast<std::uint32_t>(pick(random, 0, 3) == 0 ? pick(random, 2, 6) : 1);
    if (recipe.slopes && pick(random, 0, 1) == 0)
        recipe.frobenius_limit_bins = 0.1F * static_cast<float>(pick(random, 1, 20));
    const int choice = pick(random, 0, 4);
    float most = 0;
    for (std::size_t k = 0; k < exact.mask.size(); ++k) {
        if ((exact.mask[k] & (kNoGradient | kNotJudged)) == 0) most = std::max(most, exact.emd[k]);
    }
    const float value = choice == 0 ? 1.0F : choice < 3 ? exact.emd[random() % exact.emd.size()] : most;
    recipe.emd_limit_bins = value > 0.01F ? value : 1.0F;
    if (pick(random, 0, 2) == 0)
        recipe.emd_limit_bins = std::nextafter(recipe.emd_limit_bins, pick(random, 0, 1) == 0 ? 0.0F : 20.0F);
    return recipe;
}

void expect_equal(const Inspection& seen, const Inspection& exact) {
    ASSERT_NO_FATAL_FAILURE(expect_same_verdict(seen, exact));
    ASSERT_TRUE(std::ranges::equal(seen.mask, exact.mask));
    ASSERT_TRUE(std::ranges::equal(seen.sums, exact.sums));
    ASSERT_TRUE(std::ranges::equal(seen.frobenius, exact.frobenius));
    ASSERT_TRUE(std::ranges::equal(seen.transmission, exact.transmission));
}

// A million lenslets. A million frames: verdicts_by_bounds_test.cpp.
TEST(BoundedTime, verdicts_by_bounds_are_those_of_the_exact_map) {
    std::mt19937_64 random(51);
    std::size_t decided = 0, judged = 0, rejected = 0, passed = 0, bounds_only = 0, cut_short = 0;
    const Extents all[] = {{26, 24, 9, 9}, {30, 20, 5, 7},  {24, 28, 8, 8},
                           {20, 20, 3, 3}, {17, 19, 15, 4}, {22, 22, 7, 12}};
    for (int round = 0; round < 1900; ++round) {
        SCOPED_TRACE("round " + std::to_string(round));
        const Extents& e = all[random() % std::size(all)];
        const Frame frame = any_frame(e, random);
        Pipeline first = pipeline_for(e, 8, {}, MapSet::exact);
        const Recipe recipe = any_recipe(*first.inspect(frame.view()), random);
        Pipeline exactly = pipeline_for(e, 8, recipe, MapSet::exact),
                 judging = pipeline_for(e, 8, recipe, MapSet::judged);
        const auto exact = exactly.inspect(frame.view());
        ASSERT_FALSE(exact->bounded);
        const auto seen = judging.inspect(frame.view(), nullptr, kUnlimited);
        ASSERT_FALSE(seen->bounded);
        ASSERT_NO_FATAL_FAILURE(expect_equal(*seen, *exact));
        for (std::size_t k = 0; k < e.lenslets(); ++k) {
            if ((seen->mask[k] & (kNoGradient | kNotJudged)) != 0 || exact->verdict == Verdict::unfit) {
                ASSERT_EQ(seen->gradient[k], 0) << k;
                continue;
            }
            ++judged;
            ASSERT_GE(seen->gradient[k], exact->gradient[k]) << k;
            bounds_only += seen->gradient[k] != exact->gradient[k] ? 1 : 0;
            ASSERT_EQ(seen->gradient[k] / recipe.emd_limit_bins >= 1, exact->gradient[k] / recipe.emd_limit_bins >= 1);
        }
        decided += e.lenslets();
        (exact->verdict == Verdict::pass ? passed : rejected) += 1;
        for (const std::int64_t work : {0, 3'000, 30'000}) {
            const auto hasty = judging.inspect(frame.view(), nullptr, {0, work, 0});
            if (!hasty->bounded) {
                ASSERT_NO_FATAL_FAILURE(expect_equal(*hasty, *exact));
                continue;
            }
            ++cut_short;
            ASSERT_FALSE(hasty->verdict == Verdict::pass && exact->verdict != Verdict::pass);
            ASSERT_EQ(hasty->verdict == Verdict::unfit, exact->verdict == Verdict::unfit);
            ASSERT_GE(hasty->score, exact->score);
            ASSERT_FALSE(hasty->out_of_time);
        }
    }
    EXPECT_GT(decided, 900'000U);
    EXPECT_GT(bounds_only, judged / 8);  // else nothing was saved
    EXPECT_GT(rejected, 300U);
    EXPECT_GT(passed, 300U);
    EXPECT_GT(cut_short, 300U);
}

TEST(BoundedTime, results_do_not_depend_on_the_number_of_threads) {
    std::mt19937_64 random(52);
    const Extents e{60, 50, 9, 9};
    for (int round = 0; round < 12; ++round) {
        const Frame frame = any_frame(e, random);
        for (const InspectionLimits& limits : {InspectionLimits{}, kUnlimited, InspectionLimits{0, 200'000, 0}}) {
            Pipeline alone = pipeline_for(e, 8, {}, MapSet::judged);
            const auto expected = alone.inspect(frame.view(), nullptr, limits);
            for (const int threads : {2, 5}) {
                Pipeline shared = pipeline_for(e, 8, {}, MapSet::judged, threads);
                const auto seen = shared.inspect(frame.view(), nullptr, limits);
                ASSERT_NO_FATAL_FAILURE(expect_equal(*seen, *expected));
                ASSERT_EQ(seen->bounded, expected->bounded);
                ASSERT_TRUE(std::ranges::equal(seen->gradient, expected->gradient));  // where bounds are left, too
            }
        }
    }
}

// Noise in half of the bins: every lenslet is above its limit by its bound, most are not exactly. The other bins are
// dark, so that the dark level stays.
Frame noise(const Extents& e) {
    std::mt19937_64 random(53);
    Frame frame(e.width_px(), e.height_px(), 8);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const auto light = static_cast<std::uint32_t>(random() % 200);
            frame.set(x, y, random() % 2 == 0 ? 0 : 20 + light);
        }
    }
    return frame;
}

TEST(BoundedTime, work_has_a_limit_and_the_result_says_that_it_was_reached) {
    const Extents e{80, 80, 9, 9};
    const Frame frame = noise(e);
    Pipeline pipeline = pipeline_for(e, 8, unchecked(), MapSet::judged);
    const auto seen = pipeline.inspect(frame.view());
    EXPECT_TRUE(seen->bounded);
    EXPECT_FALSE(seen->out_of_time);
    EXPECT_EQ(seen->verdict, Verdict::reject);
    const std::vector<float> limited(seen->gradient.begin(), seen->gradient.end());
    const auto none = pipeline.inspect(frame.view(), nullptr, {0, 0, 0});
    std::size_t solved = 0;
    for (std::size_t k = 0; k < limited.size(); ++k) solved += none->gradient[k] != limited[k] ? 1 : 0;
    EXPECT_GT(solved, 3U);
    EXPECT_LT(solved, 100U);  // of 6400
    const auto unlimited = pipeline.inspect(frame.view(), nullptr, kUnlimited);
    EXPECT_FALSE(unlimited->bounded);
}

// A lenslet takes about 20,000 units here. One is solved as long as any work is left: the second one.
TEST(BoundedTime, no_lenslet_is_solved_that_the_work_left_does_not_pay_for_except_one) {
    const Extents e{21, 21, 9, 9};
    const Frame frame = noise(e);
    Pipeline pipeline = pipeline_for(e, 8, unchecked(), MapSet::judged);
    const auto gradients = [&](std::int64_t work) {
        const auto seen = pipeline.inspect(frame.view(), nullptr, {0, work, 0});
        EXPECT_TRUE(seen->bounded);
        return std::vector<float>(seen->gradient.begin(), seen->gradient.end());
    };
    const std::vector<float> none = gradients(0), some = gradients(25'000);
    std::size_t solved = 0;
    for (std::size_t k = 0; k < none.size(); ++k) solved += none[k] != some[k] ? 1 : 0;
    EXPECT_EQ(solved, 2U);
}

// Also where lenslets are solved; not in the search for defects, which allocates.
TEST(BoundedTime, nothing_is_allocated_for_a_good_part) {
    const Extents e{40, 36, 9, 9};
    const Frame frame = drawn(e, 8, 230, lens(e, 14, 2));
    for (const int threads : {1, 2}) {
        Recipe recipe;
        recipe.slopes = false;  // else no lenslet need be solved
        Pipeline pipeline = pipeline_for(e, 8, recipe, MapSet::judged, threads);
        const auto none = pipeline.inspect(frame.view(), nullptr, {0, 0, 0});
        EXPECT_TRUE(none->bounded);
        EXPECT_EQ(hord::test::allocated_by([&] {
                      const auto seen = pipeline.inspect(frame.view(), nullptr, kUnlimited);
                      EXPECT_TRUE(seen && seen->verdict == Verdict::pass && !seen->bounded);
                  }),
                  0U);
    }
}

std::int64_t ticks = 0;
std::int64_t next_tick() { return ticks += 1'000'000; }

TEST(BoundedTime, time_has_a_limit_by_the_callers_clock) {
    const Extents e{40, 40, 9, 9};
    const Frame frame = noise(e);
    Pipeline pipeline = pipeline_for(e, 8, unchecked(), MapSet::judged);
    ticks = 0;
    const auto late = pipeline.inspect(frame.view(), next_tick, {1'000'000'000, 0, 1});
    EXPECT_TRUE(late->bounded);
    EXPECT_TRUE(late->out_of_time);
    EXPECT_EQ(late->verdict, Verdict::reject);
    const auto in_time = pipeline.inspect(frame.view(), next_tick, {1'000'000'000, 0, std::int64_t{1} << 60});
    EXPECT_FALSE(in_time->bounded);
    EXPECT_FALSE(in_time->out_of_time);
    // Without a clock there is no limit of time; the exact map knows none.
    EXPECT_FALSE(pipeline.inspect(frame.view(), nullptr, {1'000'000'000, 0, 1})->bounded);
    EXPECT_FALSE(pipeline_for(e, 8, unchecked(), MapSet::exact).inspect(frame.view(), next_tick, {0, 0, 1})->bounded);
}

}  // namespace
}  // namespace hord::algo
