// Properties of any light field: mirroring, exchange of rows and columns, exposure, geometry, noise.
#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord;
using namespace hord::algo::testing;

struct Seen {
    Verdict verdict;
    Reason reason;
    float score;
    std::vector<Defect> defects;
    std::vector<float> emd, frobenius, transmission;
    std::vector<std::uint8_t> mask;
};

Seen inspected(const Extents& e, const Frame& frame, const Recipe& recipe = {}) {
    auto pipeline = Pipeline::create(e, frame.bits(), recipe);
    EXPECT_TRUE(pipeline);
    const auto seen = pipeline->inspect(frame.view());
    EXPECT_TRUE(seen);
    return {seen->verdict,
            seen->reason,
            seen->score,
            {seen->defects.begin(), seen->defects.end()},
            {seen->emd.begin(), seen->emd.end()},
            {seen->frobenius.begin(), seen->frobenius.end()},
            {seen->transmission.begin(), seen->transmission.end()},
            {seen->mask.begin(), seen->mask.end()}};
}

// A noisy lens with a dark speck, a dim one, and a saturated lenslet.
Frame eventful(const Extents& e, std::uint64_t seed) {
    Frame frame = drawn(e, 8, 225, lens(e, 0.4 * std::min(e.m, e.n), 0.35 * std::min(e.i, e.j)));
    frame = specked(frame, e, 0.4 * e.m, 0.55 * e.n, 1.7, 0);
    frame = noisy(specked(frame, e, 0.6 * e.m, 0.4 * e.n, 1.2, 0.4), {20, 4, 1}, seed);
    frame.set((e.m / 2) * e.i + 1, (e.n / 2) * e.j + 1, 255);
    return frame;
}

const Extents kGeometries[] = {{41, 47, 9, 9}, {44, 36, 8, 10}, {40, 40, 5, 3}, {36, 40, 15, 14}};

// Every map, to the bit, and every verdict, for any number of threads.
TEST(Threads, do_not_change_the_answer) {
    for (const Extents& e : {Extents{41, 47, 9, 9}, Extents{40, 3, 5, 5}, Extents{33, 16, 9, 9}, Extents{33, 17, 8, 8},
                             Extents{21, 65, 4, 6}}) {
        SCOPED_TRACE(std::to_string(e.m) + "x" + std::to_string(e.n));
        const Frame frame = eventful(e, 13);
        auto alone = Pipeline::create(e, 8, {}, 1, MapSet::all);
        ASSERT_TRUE(alone);
        const auto expected = alone->inspect(frame.view());
        ASSERT_TRUE(expected);
        for (const int threads : {2, 3, 5}) {
            auto shared = Pipeline::create(e, 8, {}, threads, MapSet::all);
            ASSERT_TRUE(shared);
            for (int round = 0; round < 3; ++round) {
                const auto seen = shared->inspect(frame.view());
                ASSERT_TRUE(seen);
                EXPECT_EQ(seen->verdict, expected->verdict);
                EXPECT_EQ(seen->reason, expected->reason);
                EXPECT_EQ(seen->score, expected->score);
                EXPECT_EQ(seen->defects.size(), expected->defects.size());
                EXPECT_TRUE(std::ranges::equal(seen->mask, expected->mask));
                for (const auto map : {&Inspection::emd, &Inspection::frobenius, &Inspection::transmission,
                                       &Inspection::spectral, &Inspection::nuclear, &Inspection::anisotropy}) {
                    EXPECT_EQ((*seen.*map).size(), e.lenslets());
                    EXPECT_TRUE(std::ranges::equal(*seen.*map, *expected.*map));
                }
            }
        }
    }
    EXPECT_FALSE(Pipeline::create({33, 17, 9, 9}, 8, {}, 0));
}

TEST(Symmetry, exchanging_rows_and_columns_exchanges_the_maps_and_nothing_else) {
    for (const Extents& e : kGeometries) {
        SCOPED_TRACE(std::to_string(e.i) + "x" + std::to_string(e.j));
        const Frame frame = eventful(e, 11);
        const Seen straight = inspected(e, frame), turned = inspected({e.n, e.m, e.j, e.i}, transposed(frame));
        EXPECT_EQ(straight.verdict, Verdict::reject);
        EXPECT_EQ(turned.verdict, straight.verdict);
        EXPECT_EQ(turned.reason, straight.reason);
        EXPECT_NEAR(turned.score, straight.score, 1e-5F);
        EXPECT_EQ(turned.defects.size(), straight.defects.size());
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                const auto a = static_cast<std::size_t>(n * e.m + m), b = static_cast<std::size_t>(m * e.n + n);
                ASSERT_EQ(turned.mask[b], straight.mask[a]);
                ASSERT_NEAR(turned.emd[b], straight.emd[a], 1e-6F);     // the solver may choose another optimal plan
                ASSERT_EQ(turned.frobenius[b], straight.frobenius[a]);  // to the bit
                ASSERT_EQ(turned.transmission[b], straight.transmission[a]);
            }
        }
    }
}

TEST(Symmetry, mirroring_mirrors_the_maps_and_nothing_else) {
    for (const Extents& e : kGeometries) {
        SCOPED_TRACE(std::to_string(e.i) + "x" + std::to_string(e.j));
        const Frame frame = eventful(e, 12);
        const Seen straight = inspected(e, frame), turned = inspected(e, mirrored(frame));
        EXPECT_EQ(turned.verdict, straight.verdict);
        EXPECT_EQ(turned.reason, straight.reason);
        ASSERT_EQ(turned.defects.size(), straight.defects.size());
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                const auto a = static_cast<std::size_t>(n * e.m + m),
                           b = static_cast<std::size_t>(n * e.m + e.m - 1 - m);
                ASSERT_EQ(turned.mask[b], straight.mask[a]);
                ASSERT_NEAR(turned.emd[b], straight.emd[a], 1e-6F);
                ASSERT_EQ(turned.frobenius[b], straight.frobenius[a]);
                ASSERT_EQ(turned.transmission[b], straight.transmission[a]);
            }
        }
    }
}

// Once the dark level is subtracted, sixteen times the light is the same HORDs, exactly.
TEST(Exposure, does_not_change_the_maps_above_the_dark_level) {
    const Extents e{36, 36, 9, 9};
    const Frame frame = drawn(e, 16, 12000, lens(e, 13, 3));
    Frame darker(e.width_px(), e.height_px(), 16), brighter(e.width_px(), e.height_px(), 16);
    const std::uint32_t dark = kDarkDn8Bit << 8;
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) {
            const std::uint32_t light = frame.view().sample(x, y) / 4;
            darker.set(x, y, dark + light);
            brighter.set(x, y, dark + 16 * light);
        }
    }
    const Seen a = inspected(e, darker), b = inspected(e, brighter);
    EXPECT_EQ(a.verdict, Verdict::pass);
    EXPECT_EQ(b.verdict, Verdict::pass);
    EXPECT_EQ(a.mask, b.mask);
    for (std::size_t k = 0; k < a.emd.size(); ++k) {
        ASSERT_NEAR(a.emd[k], b.emd[k], 1e-6F);
        ASSERT_EQ(a.frobenius[k], b.frobenius[k]);
        ASSERT_EQ(a.transmission[k], b.transmission[k]);
    }
}

TEST(Exposure, from_a_quarter_to_nominal_gives_the_same_verdict_in_noise) {
    const Extents e{56, 56, 9, 9};
    const Frame good = drawn(e, 8, 240, lens(e, 22, 3.4));
    const Frame bad = specked(good, e, 30, 22, 1.5, 0.2);
    for (const double light : {0.25, 0.5, 1.0}) {
        for (std::uint64_t seed = 1; seed <= 4; ++seed) {
            EXPECT_EQ(inspected(e, noisy(good, {10, 2, light}, seed)).verdict, Verdict::pass)
                << light << " seed " << seed;
            const Seen seen = inspected(e, noisy(bad, {10, 2, light}, seed));
            ASSERT_EQ(seen.defects.size(), 1U) << light << " seed " << seed;
            EXPECT_NEAR(seen.defects[0].m, 30, 1);
            EXPECT_NEAR(seen.defects[0].n, 22, 1);
        }
    }
}

// The reason for the default limits (algo/recipe/recipe.h): a part that deflects light over the whole range of 9 bins
// within 40 lenslets passes.
TEST(DefaultLimits, pass_a_lens_over_the_whole_range_in_40_lenslets_and_refuse_one_twice_as_steep) {
    const Extents e{64, 64, 9, 9};
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        EXPECT_EQ(inspected(e, noisy(drawn(e, 8, 240, lens(e, 19.5, 3.8)), {10, 2, 1}, seed)).verdict, Verdict::pass)
            << seed;
        const Seen steep = inspected(e, noisy(drawn(e, 8, 240, lens(e, 9, 3.8)), {10, 2, 1}, seed));
        EXPECT_EQ(steep.verdict, Verdict::reject) << seed;
        EXPECT_EQ(steep.reason, Reason::deflection_gradient);
    }
}

// Odd, even and rectangular bins at 8 to 16 bits: a lens passes; with a speck or a step of its deflection it is
// rejected.
TEST(Geometry, of_any_bins_and_bit_depth_is_judged_alike) {
    for (const auto& [i, j] :
         {std::pair(3, 3), std::pair(4, 4), std::pair(3, 15), std::pair(7, 8), std::pair(10, 10), std::pair(15, 15)}) {
        for (const int bits : {8, 10, 12, 16}) {
            SCOPED_TRACE(std::to_string(i) + "x" + std::to_string(j) + " at " + std::to_string(bits));
            const Extents e{40, 38, i, j};
            const double rim_bins = std::min(0.3 * std::min(i, j), 3.0), full_bin = 0.9 * ((1 << bits) - 1);
            const Frame good = drawn(e, bits, full_bin, lens(e, 14, rim_bins));
            const Seen passed = inspected(e, good);
            EXPECT_EQ(passed.verdict, Verdict::pass) << name_of(passed.reason) << " " << passed.score;
            const Seen speck = inspected(e, specked(good, e, 17, 21, 1.5, 0));
            ASSERT_EQ(speck.defects.size(), 1U);
            EXPECT_EQ(speck.reason, Reason::absorption);
            EXPECT_NEAR(speck.defects[0].m, 17, 0.5);
            EXPECT_NEAR(speck.defects[0].n, 21, 0.5);
            const auto flat = lens(e, 14, rim_bins);
            const Frame dented = drawn(e, bits, full_bin, [&](int m, int n) {
                Spot s = flat(m, n);
                if (std::hypot(m - 22, n - 16) < 2.5) s.x -= s.x > 0 ? 0.9 : -0.9;
                return s;
            });
            const Seen dent = inspected(e, dented);
            ASSERT_EQ(dent.defects.size(), 1U) << "a dent of 0.9 bin";
            EXPECT_NEAR(dent.defects[0].m, 22, 1);
            EXPECT_NEAR(dent.defects[0].n, 16, 1);
        }
    }
}

// One lenslet that deflects its light shows as its four neighbours, one region around the true position.
TEST(Geometry, a_defect_of_one_lenslet_is_found_where_it_is) {
    const Extents e{30, 30, 9, 9};
    const Frame frame = drawn(e, 8, 240, [](int m, int n) -> Spot {
        return m == 13 && n == 17 ? Spot{2, -1, 1} : Spot{};
    });
    Recipe recipe;
    recipe.part_required = false;
    const Seen seen = inspected(e, frame, recipe);
    ASSERT_EQ(seen.defects.size(), 1U);
    EXPECT_EQ(seen.defects[0].m, 13);
    EXPECT_EQ(seen.defects[0].n, 17);
    EXPECT_EQ(seen.defects[0].area, 4U);
    EXPECT_EQ(seen.emd[17 * 30 + 13], 0);
}

}  // namespace
}  // namespace hord::algo
