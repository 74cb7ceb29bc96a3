#include "algo/maps/feature_map.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/features/stencil.h"
#include "algo/inspection/pipeline.h"
#include "algo/soa/soa_distances.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord;
using namespace hord::algo::testing;

// A noisy lens with an opaque hole, a dim spot and a saturated sample.
Frame eventful(const Extents& e, int bits, std::uint64_t seed) {
    Frame frame = drawn(e, 8, 225, lens(e, 0.4 * std::min(e.m, e.n), 0.35 * std::min(e.i, e.j)));
    frame = specked(frame, e, 0.4 * e.m, 0.55 * e.n, 1.7, 0);
    frame = noisy(specked(frame, e, 0.6 * e.m, 0.4 * e.n, 1.2, 0.4), {20, 4, 1}, seed);
    frame.set((e.m / 2) * e.i + 1, (e.n / 2) * e.j + 1, 255);
    return bits == 8 ? frame : at_bits(frame, bits);
}

// The largest difference between a map and the float of algo/features/distance.h: 0, except for the features of
// algo/soa/soa_distances.h.
float tolerance(Feature feature) { return SoaDistances::covers(feature) ? 6e-5F : 0.0F; }

LightLevels levels(int bits) { return light_levels({}, bits); }

// Every HORD of a frame, decoded one by one.
struct Field {
    Field(const Extents& extents, const Frame& frame)
        : e(extents), masses(e.lenslets() * static_cast<std::size_t>(e.bins())) {
        const LightLevels l = levels(frame.bits());
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                const auto k = static_cast<std::size_t>(n * e.m + m) * static_cast<std::size_t>(e.bins());
                Hord h{masses.data() + k, 0};
                bool hot = false;
                for (int b = 0; b < e.bins(); ++b) {
                    const std::uint32_t sample = frame.view().sample(m * e.i + b % e.i, n * e.j + b / e.i);
                    h.sum += masses[k + static_cast<std::size_t>(b)] =
                        static_cast<std::uint16_t>(sample - std::min(sample, l.dark));
                    hot = hot || sample >= l.saturated;
                }
                if (hot || h.sum < l.min_sum) h.sum = 0;
                hords.push_back(h);
            }
        }
    }
    [[nodiscard]] Hord at(int m, int n) const { return hords[static_cast<std::size_t>(n * e.m + m)]; }
    Extents e;
    std::vector<std::uint16_t> masses;
    std::vector<Hord> hords;
};

const Extents kGeometries[] = {{41, 37, 9, 9}, {30, 3, 5, 7}, {17, 33, 8, 10}, {3, 20, 3, 15}, {19, 18, 15, 15}};

// The definition, lenslet by lenslet, from the distance of two HORDs.
TEST(FeatureMap, over_neighbours_is_the_norm_of_the_two_distances_the_stencil_names) {
    for (const Extents& e : kGeometries) {
        for (const int bits : {8, 12}) {
            const Frame frame = eventful(e, bits, 5);
            const Field field(e, frame);
            for (std::size_t f = 0; is_distance(static_cast<Feature>(f)); ++f) {
                const auto feature = static_cast<Feature>(f);
                SCOPED_TRACE(std::string(name_of(feature)) + " " + std::to_string(e.i) + "x" + std::to_string(e.j));
                auto distance = Distance::create(feature, e.i, e.j);
                auto mapper = FeatureMapper::create(e, bits, levels(bits), feature);
                ASSERT_TRUE(mapper);
                const auto map = mapper->over_neighbours(frame.view());
                ASSERT_TRUE(map);
                for (int n = 0; n < e.n; ++n) {
                    for (int m = 0; m < e.m; ++m) {
                        const auto k = static_cast<std::size_t>(n * e.m + m);
                        double right = 0;
                        bool has_value = false;
                        if (field.at(m, n).sum > 0 && m > 0 && n > 0 && m < e.m - 1 && n < e.n - 1) {
                            const Stencil across = stencil(field.at(m - 1, n).sum > 0, field.at(m + 1, n).sum > 0);
                            const Stencil down = stencil(field.at(m, n - 1).sum > 0, field.at(m, n + 1).sum > 0);
                            has_value = across.valid() && down.valid();
                            if (has_value) {
                                const double x = across.weight() *
                                    (*distance)(field.at(m + across.before, n), field.at(m + across.after, n));
                                const double y = down.weight() *
                                    (*distance)(field.at(m, n + down.before), field.at(m, n + down.after));
                                right = std::sqrt(x * x + y * y);
                            }
                        }
                        ASSERT_EQ((map->mask[k] & kNoGradient) == 0, has_value) << m << ", " << n;
                        ASSERT_NEAR(map->values[k], static_cast<float>(right), tolerance(feature)) << m << ", " << n;
                    }
                }
            }
        }
    }
}

TEST(FeatureMap, against_a_reference_is_the_distance_at_the_same_place) {
    const Extents e{23, 20, 9, 8};
    const Frame frame = eventful(e, 8, 6), reference = eventful(e, 8, 7);
    const Field field(e, frame), wanted(e, reference);
    for (std::size_t f = 0; is_distance(static_cast<Feature>(f)); ++f) {
        const auto feature = static_cast<Feature>(f);
        SCOPED_TRACE(std::string(name_of(feature)));
        auto distance = Distance::create(feature, e.i, e.j);
        auto mapper = FeatureMapper::create(e, 8, levels(8), feature);
        const auto map = mapper->against(frame.view(), reference.view());
        ASSERT_TRUE(map);
        std::size_t compared = 0;
        for (std::size_t k = 0; k < e.lenslets(); ++k) {
            const bool both = field.hords[k].sum > 0 && wanted.hords[k].sum > 0;
            compared += both ? 1U : 0U;
            ASSERT_EQ((map->mask[k] & kNoGradient) == 0, both);
            ASSERT_NEAR(map->values[k], both ? static_cast<float>((*distance)(field.hords[k], wanted.hords[k])) : 0.0F,
                        tolerance(feature));
        }
        EXPECT_GT(compared, e.lenslets() / 2);
        const auto itself = mapper->against(frame.view(), frame.view());
        EXPECT_LT(*std::ranges::max_element(itself->values), 1e-7F);
    }
}

// A defect is visible against a reference although the smooth lens has a gradient everywhere.
TEST(FeatureMap, against_a_reference_shows_what_changed_and_where) {
    const Extents e{31, 31, 9, 9};
    const Frame good = drawn(e, 8, 240, lens(e, 12, 3));
    const auto flat = lens(e, 12, 3);
    const Frame bad = drawn(e, 8, 240, [&](int m, int n) {
        Spot s = flat(m, n);
        if (m == 12 && n == 17) s.x += 0.5;
        return s;
    });
    for (const Feature feature :
         {Feature::emd, Feature::chi2, Feature::hellinger, Feature::centroid, Feature::marginal}) {
        auto mapper = FeatureMapper::create(e, 8, levels(8), feature);
        const auto map = mapper->against(bad.view(), good.view());
        for (std::size_t k = 0; k < e.lenslets(); ++k)
            ASSERT_EQ(map->values[k] > 0.05F, k == 17 * 31 + 12) << name_of(feature);
    }
}

TEST(FeatureMap, of_the_jacobian_and_the_emd_is_the_pipelines) {
    for (const Extents& e : kGeometries) {
        const Frame frame = eventful(e, 8, 8);
        auto pipeline = Pipeline::create(e, 8, {}, 1, MapSet::all);
        const auto seen = pipeline->inspect(frame.view());
        for (const auto& [feature, map] :
             {std::pair(Feature::emd, seen->emd), std::pair(Feature::jacobian_frobenius, seen->frobenius),
              std::pair(Feature::jacobian_spectral, seen->spectral),
              std::pair(Feature::jacobian_nuclear, seen->nuclear), std::pair(Feature::anisotropy, seen->anisotropy)}) {
            auto mapper = FeatureMapper::create(e, 8, levels(8), feature);
            EXPECT_TRUE(std::ranges::equal(mapper->over_neighbours(frame.view())->values, map)) << name_of(feature);
        }
    }
}

TEST(FeatureMap, does_not_depend_on_the_number_of_threads) {
    const Extents e{33, 65, 9, 9};
    const Frame frame = eventful(e, 8, 9), reference = eventful(e, 8, 10);
    for (std::size_t f = 0; f < static_cast<std::size_t>(Feature::transmission); ++f) {
        const auto feature = static_cast<Feature>(f);
        auto alone = FeatureMapper::create(e, 8, levels(8), feature);
        const auto one = alone->over_neighbours(frame.view());
        const std::vector<float> values(one->values.begin(), one->values.end());
        const std::vector<std::uint8_t> mask(one->mask.begin(), one->mask.end());
        const std::uint64_t at_limit = one->at_limit;
        std::vector<float> referred;
        if (is_distance(feature)) {
            const auto map = alone->against(frame.view(), reference.view());
            referred.assign(map->values.begin(), map->values.end());
        }
        for (const int threads : {2, 3}) {
            auto shared = FeatureMapper::create(e, 8, levels(8), feature, {.threads = threads});
            const auto map = shared->over_neighbours(frame.view());
            EXPECT_TRUE(std::ranges::equal(map->values, values)) << name_of(feature);
            EXPECT_TRUE(std::ranges::equal(map->mask, mask));
            EXPECT_EQ(map->at_limit, at_limit);
            if (!referred.empty()) {
                EXPECT_TRUE(std::ranges::equal(shared->against(frame.view(), reference.view())->values, referred));
            }
        }
    }
}

// To the bit: dense and sparse, 8 to 16 bits, every geometry.
TEST(FeatureMap, does_not_depend_on_the_instruction_set) {
    for (const Extents& e : kGeometries) {
        for (const int bits : {8, 16}) {
            const Frame frame = eventful(e, bits, 14), reference = eventful(e, bits, 15);
            for (std::size_t f = 0; f < static_cast<std::size_t>(Feature::transmission); ++f) {
                const auto feature = static_cast<Feature>(f);
                auto portable = FeatureMapper::create(e, bits, levels(bits), feature, {.isa = Isa::portable});
                const auto one = portable->over_neighbours(frame.view());
                const std::vector<float> values(one->values.begin(), one->values.end());
                for (const Isa isa : {Isa::avx2, Isa::avx512}) {
                    auto wide = FeatureMapper::create(e, bits, levels(bits), feature, {.isa = isa});
                    ASSERT_EQ(wide.has_value(), has(isa));
                    if (!wide) continue;
                    EXPECT_TRUE(std::ranges::equal(wide->over_neighbours(frame.view())->values, values))
                        << name_of(feature);
                    if (!is_distance(feature)) continue;
                    const auto a = wide->against(frame.view(), reference.view());
                    const std::vector<float> referred(a->values.begin(), a->values.end());
                    EXPECT_TRUE(std::ranges::equal(portable->against(frame.view(), reference.view())->values, referred))
                        << name_of(feature);
                }
            }
        }
    }
}

TEST(FeatureMap, flags_the_lenslets_whose_value_is_a_limit) {
    const Extents e{9, 8, 9, 9};
    const Frame frame = drawn(e, 8, 240, [](int m, int) {
        return Spot{m < 5 ? -3.0 : 3.0, 0, 1};
    });  // disjoint from column 4 to 6
    auto mapper = FeatureMapper::create(e, 8, levels(8), Feature::bhattacharyya);
    const auto map = mapper->over_neighbours(frame.view());
    EXPECT_EQ(map->at_limit, 2U * 6U);  // beside the step, on either side; the border has no gradient
    for (std::size_t k = 0; k < e.lenslets(); ++k) {
        EXPECT_EQ((map->mask[k] & kAtLimit) != 0, map->values[k] == static_cast<float>(kBhattacharyyaLimit));
    }
    EXPECT_EQ(mapper->over_neighbours(drawn(e, 8, 240, [](int, int) { return Spot{}; }).view())->at_limit, 0U);
}

TEST(FeatureMap, measures_ground_distances_along_a_direction_map) {
    const Extents e{12, 11, 5, 4};
    const Frame frame = eventful(e, 8, 11);
    std::vector<Direction> directions;
    for (int k = 0; k < 20; ++k) directions.push_back({3.0 * (k % 5), 3.0 * (k / 5)});  // three pitches per bin
    for (const Feature feature :
         {Feature::emd, Feature::emd_l1, Feature::centroid, Feature::marginal, Feature::sliced}) {
        auto plain = FeatureMapper::create(e, 8, levels(8), feature),
             stretched = FeatureMapper::create(e, 8, levels(8), feature, {.distance = {.directions = directions}});
        ASSERT_TRUE(stretched);
        const auto a = plain->over_neighbours(frame.view()), b = stretched->over_neighbours(frame.view());
        for (std::size_t k = 0; k < e.lenslets(); ++k)
            ASSERT_NEAR(b->values[k], 3 * a->values[k], 1e-5F) << name_of(feature);
    }
}

TEST(FeatureMap, refuses_what_it_cannot_compare) {
    const Extents e{12, 11, 5, 4};
    EXPECT_FALSE(FeatureMapper::create(e, 8, levels(8), Feature::transmission));
    EXPECT_FALSE(FeatureMapper::create({2, 11, 5, 4}, 8, levels(8), Feature::chi2));
    EXPECT_FALSE(FeatureMapper::create(e, 7, levels(8), Feature::chi2));
    EXPECT_FALSE(FeatureMapper::create(e, 8, levels(8), Feature::chi2, {.threads = 0}));
    EXPECT_FALSE(FeatureMapper::create(e, 8, levels(8), Feature::emd, {.distance = {.threshold = -1}}));
    auto slope = FeatureMapper::create(e, 8, levels(8), Feature::anisotropy);
    const Frame frame = eventful(e, 8, 1), other = eventful({11, 12, 5, 4}, 8, 1);
    EXPECT_TRUE(slope->over_neighbours(frame.view()));
    EXPECT_FALSE(slope->over_neighbours(other.view()));
    EXPECT_FALSE(slope->against(frame.view(), frame.view()));
    auto chi2 = FeatureMapper::create(e, 8, levels(8), Feature::chi2);
    EXPECT_FALSE(chi2->against(frame.view(), other.view()));
}

}  // namespace
}  // namespace hord::algo
