#include "tests/support/emd_threshold/emd_threshold.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>
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

// Blobs, two lobes, wide spots and specks, in noise; `kind` chooses.
Frame any_frame(const Extents& e, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(-1, 1);
    const double a = unit(random), b = unit(random), c = unit(random);
    Frame frame = drawn(e, 8, 240, [&](int m, int n) -> Spot {
        return {2.5 * std::sin(0.11 * m * a + 2 * b) * std::cos(0.07 * n) + (m % 17 == 0 ? 1 : 0),
                2.5 * std::cos(0.09 * n * c + 0.05 * m), 1};
    });
    if (seed % 3 == 1) {  // a second lobe: the frame again, shifted by some lenslets
        const Frame other = shifted(frame, e, 9, 5);
        for (int y = 0; y < frame.height_px(); ++y) {
            for (int x = 0; x < frame.width_px(); ++x)
                frame.set(x, y, (frame.view().sample(x, y) + other.view().sample(x, y)) / 2);
        }
    }
    frame = specked(frame, e, e.m / 2.0, e.n / 2.0, 2.2, 0);
    return noisy(frame, {seed % 4 == 2 ? 1.0 : 20.0, seed % 4 == 3 ? 15.0 : 3.0, 1}, seed);
}

struct Ground {
    Feature feature;
    GroundDistance ground;
    Distance::Options options;
};

std::vector<Ground> grounds(int i, int j) {
    return {{Feature::emd, *GroundDistance::between_bins(i, j), {}},
            {Feature::emd_l1, *GroundDistance::between_bins(i, j, GroundNorm::manhattan), {}},
            {Feature::emd_sq, *GroundDistance::between_bins(i, j, GroundNorm::squared_euclidean), {}},
            {Feature::emd, *GroundDistance::between_bins(i, j, GroundNorm::euclidean, 2.0), {.threshold = 2.0}}};
}

// Critical limits: values of the map, the floats next to one, and limits below and above all values.
std::vector<float> hard_limits(std::span<const float> values, std::mt19937_64& random) {
    std::vector<float> limits{0, -1, INFINITY, 0.5F, 1};
    for (int k = 0; k < 3; ++k) {
        const float value = values[random() % values.size()];
        limits.insert(limits.end(), {value, std::nextafter(value, INFINITY), std::nextafter(value, 0.0F)});
    }
    return limits;
}

// Two million pairs, more than half for the Euclidean ground; with HORD_LONG_TESTS twenty times as many.
TEST(EmdThresholdMap, are_those_of_the_exact_map_for_every_lenslet) {
    const int rounds = std::getenv("HORD_LONG_TESTS") != nullptr ? 60 : 3;
    std::mt19937_64 random(3);
    std::uint64_t decided = 0;
    for (const Extents& e : {Extents{120, 110, 9, 9}, Extents{60, 50, 8, 5}}) {
        for (const Ground& g : grounds(e.i, e.j)) {
            auto mapper = FeatureMapper::create(e, 8, levels(), g.feature, {.distance = g.options});
            auto decisions = EmdThresholdMap::create(e, 8, levels(), g.ground);
            ASSERT_TRUE(decisions);
            const bool euclidean = g.feature == Feature::emd && g.options.threshold == GroundDistance::kNoThreshold;
            for (int round = 0; round < (euclidean ? rounds : rounds / 3); ++round) {
                const Frame frame = any_frame(e, static_cast<std::uint64_t>(round + static_cast<int>(g.feature)));
                const auto exact = mapper->over_neighbours(frame.view());
                for (const float limit : hard_limits(exact->values, random)) {
                    const auto map = decisions->decide(frame.view(), limit);
                    ASSERT_TRUE(map);
                    ASSERT_TRUE(std::ranges::equal(map->mask, exact->mask));
                    for (std::size_t k = 0; k < e.lenslets(); ++k) {
                        const bool has_value = (exact->mask[k] & kNoGradient) == 0;
                        ASSERT_EQ(map->at_or_above[k] != 0, has_value && exact->values[k] >= limit)
                            << "limit " << limit << " lenslet " << k << " round " << round;
                    }
                    decided += map->pairs;
                }
            }
        }
    }
    EXPECT_GT(decided, 2'000'000U);
}

TEST(EmdThresholdMap, take_few_solves_and_do_not_depend_on_the_number_of_threads) {
    const Extents e{90, 80, 9, 9};
    const Frame frame = any_frame(e, 0);
    const auto ground = *GroundDistance::between_bins(9, 9);
    auto alone = EmdThresholdMap::create(e, 8, levels(), ground);
    const auto one = alone->decide(frame.view(), 0.8F);
    EXPECT_LT(one->solved, one->pairs / 10);
    EXPECT_GT(std::ranges::count(one->at_or_above, 1), 100);
    for (const int threads : {2, 3}) {
        auto shared = EmdThresholdMap::create(e, 8, levels(), ground, threads);
        const auto map = shared->decide(frame.view(), 0.8F);
        EXPECT_TRUE(std::ranges::equal(map->at_or_above, one->at_or_above));
        EXPECT_TRUE(std::ranges::equal(map->mask, one->mask));
        EXPECT_EQ(map->solved, one->solved);
    }
}

TEST(EmdThresholdMap, refuse_what_cannot_be) {
    const auto ground = *GroundDistance::between_bins(9, 9);
    EXPECT_FALSE(EmdThresholdMap::create({20, 20, 9, 8}, 8, levels(), ground));
    EXPECT_FALSE(EmdThresholdMap::create({20, 20, 9, 9}, 17, levels(), ground));
    EXPECT_FALSE(EmdThresholdMap::create({20, 20, 9, 9}, 8, levels(), ground, 0));
    auto decisions = EmdThresholdMap::create({20, 20, 9, 9}, 8, levels(), ground);
    EXPECT_FALSE(decisions->decide(Frame(180, 180, 8).view(), std::nanf("")));
    EXPECT_FALSE(decisions->decide(Frame(180, 171, 8).view(), 1));
}

}  // namespace
}  // namespace hord::algo
