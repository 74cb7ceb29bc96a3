// The features that a recipe chooses: each has its own map, other features have none, and the results of the default
// choice do not change.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "algo/maps/feature_map.h"
#include "tests/support/counted_heap.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord;
using namespace hord::algo::testing;

constexpr std::array kCheap = {Feature::marginal, Feature::hellinger, Feature::chi2};

Recipe only(std::optional<Feature> gradient, bool slopes, bool light) {
    Recipe recipe;
    recipe.gradient = gradient;
    recipe.slopes = slopes;
    recipe.light = light;
    if (gradient && *gradient != Feature::emd) recipe.gradient_limit = 0.5F;
    return recipe;
}

Pipeline pipeline_for(const Extents& e, int bits, const Recipe& recipe, int threads = 1, MapSet maps = MapSet::judged) {
    auto made = Pipeline::create(e, bits, recipe, threads, maps);
    EXPECT_TRUE(made) << made.error().message();
    return std::move(*made);
}

// A noisy lens with an opaque hole, a dim spot and a saturated sample.
Frame eventful(const Extents& e, int bits) {
    Frame frame = drawn(e, 8, 225, lens(e, 0.4 * std::min(e.m, e.n), 0.35 * std::min(e.i, e.j)));
    frame = specked(frame, e, 0.4 * e.m, 0.55 * e.n, 1.7, 0);
    frame = noisy(specked(frame, e, 0.6 * e.m, 0.4 * e.n, 1.2, 0.4), {20, 4, 1}, 5);
    frame.set((e.m / 2) * e.i + 1, (e.n / 2) * e.j + 1, 255);
    return bits == 8 ? frame : at_bits(frame, bits);
}

const Extents kGeometries[] = {{41, 37, 9, 9}, {30, 3, 5, 7}, {17, 33, 8, 10}, {3, 20, 3, 15}};

// Integers only, so that no library's rounding matters: a lens with changing light, dark and bright regions, saturated
// samples.
Frame counted_frame(const Extents& e, std::uint32_t seed) {
    Frame frame(e.width_px(), e.height_px(), 8);
    std::uint32_t state = seed;
    const auto next = [&state] { return (state = state * 1664525U + 1013904223U) >> 24U; };
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const int x = m * (e.i - 2) / e.m, y = n * (e.j - 2) / e.n;
            const std::uint32_t light = next() < 8 ? 0 : next() < 8 ? 60 : 200;
            for (int k = 0; k < 9; ++k) {
                const int i = std::min(x + k % 3, e.i - 1), j = std::min(y + k / 3, e.j - 1);
                const bool hot = k == 0 && (7 * m + 13 * n) % 101 == 0;
                frame.set(m * e.i + i, n * e.j + j, hot ? 255 : light * (160 + next() % 64) / 256);
            }
        }
    }
    return frame;
}

std::uint64_t digest(const Inspection& seen) {
    std::uint64_t hash = 14695981039346656037U;
    const auto add = [&hash](std::uint32_t word) { hash = (hash ^ word) * 1099511628211U; };
    for (const Map map : {seen.emd, seen.frobenius, seen.transmission}) {
        for (const float value : map) add(std::bit_cast<std::uint32_t>(value));
    }
    for (const std::uint8_t bits : seen.mask) add(bits);
    add(static_cast<std::uint32_t>(seen.verdict));
    add(static_cast<std::uint32_t>(seen.reason));
    add(std::bit_cast<std::uint32_t>(seen.score));
    for (const Defect& d : seen.defects) {
        for (const float value : {d.m, d.n, d.peak}) add(std::bit_cast<std::uint32_t>(value));
        add(d.area);
        add(static_cast<std::uint32_t>(d.kind));
    }
    return hash;
}

// Expected values: results of the pipeline without a choice of features.
TEST(FeatureSets, the_usual_ones_give_the_bits_they_always_gave) {
    const struct {
        Extents extents;
        std::uint64_t digest;
    } cases[] = {{{40, 36, 9, 9}, 0xfe1a8e96891ef889U}, {{21, 30, 5, 7}, 0xfb54ac3b838c676cU}};
    for (const auto& [e, expected] : cases) {
        Recipe recipe;
        recipe.part_required = false;  // the part fills the field
        Pipeline pipeline = pipeline_for(e, 8, recipe);
        const Frame frame = counted_frame(e, 7);
        const auto seen = pipeline.inspect(frame.view());
        ASSERT_TRUE(seen);
        EXPECT_EQ(digest(*seen), expected) << std::hex << "0x" << digest(*seen);
    }
}

TEST(FeatureSets, each_is_the_feature_map_of_its_name_and_leaves_the_others_as_they_are) {
    for (const Extents& e : kGeometries) {
        for (const int bits : {8, 12}) {
            const Frame frame = eventful(e, bits);
            Pipeline usual = pipeline_for(e, bits, {}, 1, MapSet::all);
            const auto all = usual.inspect(frame.view());
            ASSERT_TRUE(all);
            for (const Feature feature : kCheap) {
                SCOPED_TRACE(std::string(name_of(feature)) + " " + std::to_string(e.i) + "x" + std::to_string(e.j) +
                             ", " + std::to_string(bits) + " bits");
                Pipeline pipeline = pipeline_for(e, bits, only(feature, true, true), 1, MapSet::all);
                const auto seen = pipeline.inspect(frame.view());
                ASSERT_TRUE(seen);
                auto mapper = FeatureMapper::create(e, bits, light_levels({}, bits), feature);
                const auto map = mapper->over_neighbours(frame.view());
                EXPECT_EQ(seen->compares, feature);
                EXPECT_TRUE(std::ranges::equal(seen->gradient, map->values));
                EXPECT_TRUE(std::ranges::equal(seen->mask, all->mask));
                for (const auto& [here, there] :
                     {std::pair(seen->frobenius, all->frobenius), std::pair(seen->transmission, all->transmission),
                      std::pair(seen->spectral, all->spectral), std::pair(seen->nuclear, all->nuclear),
                      std::pair(seen->anisotropy, all->anisotropy)}) {
                    EXPECT_FALSE(here.empty());
                    EXPECT_TRUE(std::ranges::equal(here, there));
                }
            }
        }
    }
}

TEST(FeatureSets, do_not_depend_on_the_number_of_threads) {
    const Extents e{33, 65, 9, 9};
    const Frame frame = eventful(e, 8);
    for (const Recipe& recipe : {only(Feature::chi2, true, true), only(Feature::marginal, false, true),
                                 only(std::nullopt, true, false), only(std::nullopt, false, true)}) {
        Pipeline alone = pipeline_for(e, 8, recipe);
        const auto one = alone.inspect(frame.view());
        for (const int threads : {2, 3}) {
            Pipeline shared = pipeline_for(e, 8, recipe, threads);
            const auto many = shared.inspect(frame.view());
            ASSERT_TRUE(many);
            EXPECT_EQ(many->score, one->score);
            EXPECT_EQ(many->defects.size(), one->defects.size());
            EXPECT_TRUE(std::ranges::equal(many->mask, one->mask));
            for (const auto& [here, there] :
                 {std::pair(many->gradient, one->gradient), std::pair(many->frobenius, one->frobenius),
                  std::pair(many->transmission, one->transmission)}) {
                EXPECT_TRUE(std::ranges::equal(here, there));
            }
        }
    }
}

TEST(FeatureSets, what_is_off_is_empty_and_judged_by_nobody) {
    const Extents e{40, 36, 9, 9};
    const Frame frame = eventful(e, 8);
    Pipeline usual = pipeline_for(e, 8, {});
    const auto all = usual.inspect(frame.view());
    const auto worst = [&](Map map, float limit) {  // of the lenslets that are judged
        float most = 0;
        for (std::size_t k = 0; k < map.size(); ++k) {
            if ((all->mask[k] & (kNoGradient | kNotJudged)) == 0) most = std::max(most, map[k] / limit);
        }
        return most;
    };
    float least_light = 1;
    for (std::size_t k = 0; k < all->mask.size(); ++k) {
        if ((all->mask[k] & (kNotJudged | kSaturated)) == 0) least_light = std::min(least_light, all->transmission[k]);
    }
    struct Case {
        Recipe recipe;
        bool emd, gradient, frobenius, transmission;
        float score;
        Reason reason;
    };
    Recipe emd = only(Feature::emd, false, false), slopes = only(std::nullopt, true, false);
    emd.emd_limit_bins = 0.3F;
    slopes.frobenius_limit_bins = 0.1F;
    Recipe chi2 = only(Feature::chi2, false, false);
    chi2.gradient_limit = 0.02F;
    const Case cases[] = {
        {emd, true, true, false, false, worst(all->emd, 0.3F), Reason::neighbours_disagree},
        {slopes, false, false, true, false, worst(all->frobenius, 0.1F), Reason::deflection_gradient},
        {only(std::nullopt, false, true), false, false, false, true,
         (1 - least_light) / (1 - Recipe{}.transmission_limit), Reason::absorption},
        {chi2, false, true, false, false, 0, Reason::neighbours_disagree},
    };
    for (const Case& c : cases) {
        Pipeline pipeline = pipeline_for(e, 8, c.recipe);
        const auto seen = pipeline.inspect(frame.view());
        ASSERT_TRUE(seen);
        EXPECT_EQ(seen->emd.empty(), !c.emd);
        EXPECT_EQ(seen->gradient.empty(), !c.gradient);
        EXPECT_EQ(seen->frobenius.empty(), !c.frobenius);
        EXPECT_EQ(seen->transmission.empty(), !c.transmission);
        EXPECT_TRUE(seen->spectral.empty());
        ASSERT_EQ(seen->verdict, Verdict::reject);
        EXPECT_EQ(seen->reason, c.reason);
        EXPECT_FLOAT_EQ(seen->score, c.score > 0 ? c.score : worst(seen->gradient, 0.02F));
        EXPECT_TRUE(std::ranges::equal(seen->mask, all->mask));
    }
}

TEST(FeatureSets, allocate_nothing_for_a_good_part) {
    const Extents e{40, 36, 9, 9};
    for (const Recipe& recipe : {only(Feature::chi2, true, true), only(Feature::hellinger, true, true),
                                 only(Feature::marginal, false, true), only(std::nullopt, true, false)}) {
        for (const auto& [bits, threads] : {std::pair(8, 1), std::pair(12, 2)}) {
            Recipe lenient = recipe;
            if (lenient.gradient) lenient.gradient_limit = 3;
            const Frame frame = drawn(e, bits, 0.9 * ((1 << bits) - 1), lens(e, 14, 2));
            Pipeline pipeline = pipeline_for(e, bits, lenient, threads, MapSet::all);
            const std::uint64_t before = hord::test::allocations;
            const auto seen = pipeline.inspect(frame.view());
            const std::uint64_t after = hord::test::allocations;
            ASSERT_TRUE(seen);
            EXPECT_EQ(seen->verdict, Verdict::pass);
            EXPECT_EQ(after - before, 0U);
        }
    }
}

TEST(FeatureSets, contradictions_are_named) {
    const Extents e{40, 36, 9, 9};
    const auto said = [&](const Recipe& recipe) {
        std::string lines;
        for (const std::string& line : problems(recipe, e)) lines += line + "\n";
        return lines;
    };
    EXPECT_EQ(said({}), "");
    for (const Feature feature : kCheap) EXPECT_EQ(said(only(feature, false, false)), "");
    for (const Feature feature : {Feature::centroid, Feature::sliced, Feature::bhattacharyya, Feature::emd_l1,
                                  Feature::jacobian_nuclear, Feature::transmission}) {
        EXPECT_NE(said(only(feature, true, true)).find("no part is judged by " + std::string(name_of(feature))),
                  std::string::npos);
    }
    Recipe recipe = only(Feature::chi2, true, true);
    recipe.gradient_limit = 0;
    EXPECT_NE(said(recipe).find("the limit of chi2 must be above 0"), std::string::npos);
    recipe = only(Feature::chi2, false, false);
    recipe.emd_limit_bins = 2;
    recipe.frobenius_limit_bins = 2;
    recipe.transmission_limit = 0.5F;
    for (const char* limit : {"emd_limit_bins", "frobenius_limit_bins", "transmission_limit"})
        EXPECT_NE(said(recipe).find(limit), std::string::npos) << limit;
    recipe = only(Feature::emd, true, true);
    recipe.gradient_limit = 1;
    EXPECT_NE(said(recipe).find("gradient_limit"), std::string::npos);
    EXPECT_NE(said(only(std::nullopt, false, false)).find("nothing would be judged"), std::string::npos);
    recipe = only(std::nullopt, false, true);
    recipe.transmission_limit = 0;
    EXPECT_NE(said(recipe).find("nothing would be judged"), std::string::npos);
}

}  // namespace
}  // namespace hord::algo
