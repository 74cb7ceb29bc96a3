#include "algo/maps/emd_anytime.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "algo/maps/feature_map.h"
#include "algo/recipe/recipe.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord;
using namespace hord::algo::testing;

LightLevels levels() { return light_levels({}, 8); }

Frame scene(const Extents& e, std::uint64_t seed) {
    const Frame frame =
        specked(drawn(e, 8, 240, lens(e, 0.4 * std::min(e.m, e.n), 3)), e, e.m / 2.0, e.n / 3.0, 2.5, 0);
    return noisy(frame, {4, 4, 1}, seed);
}

// A deadline: allows `count` pieces of work.
auto pieces(int count) {
    return [left = count]() mutable { return left-- > 0; };
}

const Extents kField{70, 75, 9, 9};  // three rounds of bounds

TEST(AnytimeEmd, brackets_every_lenslet_whenever_the_deadline_comes) {
    const GroundDistance grounds[] = {*GroundDistance::between_bins(9, 9),
                                      *GroundDistance::between_bins(9, 9, GroundNorm::manhattan),
                                      *GroundDistance::between_bins(9, 9, GroundNorm::squared_euclidean)};
    const Feature features[] = {Feature::emd, Feature::emd_l1, Feature::emd_sq};
    for (int g = 0; g < 3; ++g) {
        const Frame frame = scene(kField, 3);
        auto mapper = FeatureMapper::create(kField, 8, levels(), features[g]);
        const auto exact = mapper->over_neighbours(frame.view());
        auto anytime = AnytimeEmdMap::create(kField, 8, levels(), grounds[g]);
        ASSERT_TRUE(anytime);
        for (const int deadline : {0, 1, 2, 3, 4, 7, 12, 1000}) {
            SCOPED_TRACE(deadline);
            const auto map = anytime->start(frame.view(), pieces(deadline));
            ASSERT_TRUE(map);
            EXPECT_EQ(map->rows_bounded, std::min(deadline * AnytimeEmdMap::kRoundRows, kField.n));
            for (std::size_t k = 0; k < kField.lenslets(); ++k) {
                ASSERT_LE(map->lower[k], exact->values[k]);
                ASSERT_GE(map->upper[k], exact->values[k]);  // a judgement by `upper` misses nothing
                ASSERT_TRUE(std::isfinite(map->upper[k]));
            }
        }
    }
}

TEST(AnytimeEmd, refines_the_widest_first_and_becomes_exact) {
    const Frame frame = scene(kField, 4);
    const auto ground = *GroundDistance::between_bins(9, 9);
    auto anytime = AnytimeEmdMap::create(kField, 8, levels(), ground);
    auto map = *anytime->start(frame.view(), pieces(3));
    EXPECT_EQ(map.rows_bounded, kField.n);
    std::size_t open = map.open;
    EXPECT_GT(open, 4U * AnytimeEmdMap::kLensletsPerPiece);
    std::vector<float> width(kField.lenslets());
    while (open > 0) {
        for (std::size_t k = 0; k < width.size(); ++k) width[k] = map.upper[k] - map.lower[k];
        map = anytime->refine(pieces(1));
        EXPECT_EQ(map.open, open - std::min<std::size_t>(open, AnytimeEmdMap::kLensletsPerPiece));
        open = map.open;
        float narrowest_solved = INFINITY, widest_left = 0;
        for (std::size_t k = 0; k < width.size(); ++k) {
            const bool solved = width[k] > 0 && map.upper[k] == map.lower[k];
            if (solved) narrowest_solved = std::min(narrowest_solved, width[k]);
            if (map.upper[k] > map.lower[k]) widest_left = std::max(widest_left, width[k]);
        }
        ASSERT_GE(narrowest_solved, widest_left);
    }
    EXPECT_TRUE(map.exact(kField.n));
    auto mapper = FeatureMapper::create(kField, 8, levels(), Feature::emd);
    const auto exact = mapper->over_neighbours(frame.view());
    EXPECT_TRUE(std::ranges::equal(map.upper, exact->values));
    EXPECT_TRUE(std::ranges::equal(map.lower, exact->values));
    EXPECT_TRUE(std::ranges::equal(map.mask, exact->mask));
    EXPECT_EQ(anytime->refine(pieces(5)).open, 0U);
}

TEST(AnytimeEmd, does_not_depend_on_the_number_of_threads_nor_on_what_came_before) {
    const Frame frame = scene(kField, 5), other = scene(kField, 6);
    const auto ground = *GroundDistance::between_bins(9, 9);
    for (const int deadline : {1, 2, 4, 9}) {
        auto alone = AnytimeEmdMap::create(kField, 8, levels(), ground);
        const auto one = alone->start(frame.view(), pieces(deadline));
        for (const int threads : {2, 3}) {
            auto shared = AnytimeEmdMap::create(kField, 8, levels(), ground, threads);
            ASSERT_TRUE(shared->start(other.view(), pieces(6)));
            const auto map = shared->start(frame.view(), pieces(deadline));
            EXPECT_TRUE(std::ranges::equal(map->lower, one->lower));
            EXPECT_TRUE(std::ranges::equal(map->upper, one->upper));
            EXPECT_TRUE(std::ranges::equal(map->mask, one->mask));
            EXPECT_EQ(map->open, one->open);
        }
    }
}

}  // namespace
}  // namespace hord::algo
