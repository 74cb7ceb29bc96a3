// After set-up nothing allocates: this program counts the heap allocations of all threads. Workspaces stay small.
#include <random>

#include <gtest/gtest.h>
#include <malloc.h>

#include "algo/features/distance.h"
#include "algo/frame/grid_decoder.h"
#include "algo/maps/feature_map.h"
#include "algo/recipe/recipe.h"
#include "tests/support/counted_heap.h"

namespace hord::algo {
namespace {

using hord::test::allocated_by;

// Dark, sparse, blobs, dense and saturated lenslets.
Frame any_frame(const Extents& e, int bits, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    const std::uint32_t full = (1U << bits) - 1;
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const auto kind = random() % 8;
            for (int k = 0; k < e.bins(); ++k) {
                const bool lit = kind >= 6 || (kind >= 1 && random() % static_cast<unsigned>(e.bins()) < 8);
                frame.set(m * e.i + k % e.i, n * e.j + k / e.i,
                          lit ? static_cast<std::uint32_t>(random() % (full + (kind == 7 ? 1 : 0))) : 0);
            }
        }
    }
    return frame;
}

LightLevels levels(int bits) { return light_levels({}, bits); }

TEST(Allocation, is_counted_here) {
    EXPECT_EQ(allocated_by([] { ::operator delete(::operator new(8)); }), 1U);
    EXPECT_GT(allocated_by([] { std::vector<int> v(100); }), 0U);
}

TEST(Allocation, no_distance_kernel_allocates) {
    const Extents e{8, 8, 9, 9};
    const Frame frame = any_frame(e, 12, 1);
    std::vector<HordRow> rows;
    for (int n = 0; n < e.n; ++n) decode_row(frame.view(), e, {1, 1, 4096}, n, rows.emplace_back(e));
    for (std::size_t f = 0; is_distance(static_cast<Feature>(f)); ++f) {
        auto distance = Distance::create(static_cast<Feature>(f), 9, 9);
        std::vector<double> out(64);
        EXPECT_EQ(allocated_by([&] {
                      for (std::size_t k = 1; k < 64; ++k) {
                          const Hord a = rows[(k - 1) / 8].hord(static_cast<int>((k - 1) % 8)),
                                     b = rows[k / 8].hord(static_cast<int>(k % 8));
                          out[0] += (*distance)(a, b);
                          distance->submit(a, b, &out[k]);
                      }
                      distance->finish();
                  }),
                  0U)
            << name_of(static_cast<Feature>(f));
    }
}

TEST(Allocation, no_map_allocates_after_set_up) {
    for (const Extents& e : {Extents{40, 35, 9, 9}, Extents{20, 21, 15, 4}}) {
        for (const int bits : {8, 16}) {
            const Frame frame = any_frame(e, bits, 2), reference = any_frame(e, bits, 3);
            for (const int threads : {1, 2}) {
                for (std::size_t f = 0; f < static_cast<std::size_t>(Feature::transmission); ++f) {
                    const auto feature = static_cast<Feature>(f);
                    auto mapper = FeatureMapper::create(e, bits, levels(bits), feature, {.threads = threads});
                    EXPECT_EQ(allocated_by([&] { EXPECT_TRUE(mapper->over_neighbours(frame.view())); }), 0U)
                        << name_of(feature);
                    if (is_distance(feature)) {
                        EXPECT_EQ(allocated_by([&] { EXPECT_TRUE(mapper->against(frame.view(), reference.view())); }),
                                  0U)
                            << name_of(feature);
                    }
                }
            }
        }
    }
}

// Frame and outputs aside: 16 MiB at 555x555 lenslets of 9x9 bins, with two threads.
TEST(Workspace, of_every_map_is_below_16_mib_at_paper_size) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "the heap of a sanitizer does not say how much it holds";
#endif
    constexpr double kMebi = 1024.0 * 1024.0;
    const Extents e{555, 555, 9, 9};
    const auto held = [] {
        const auto info = mallinfo2();
        return static_cast<double>(info.uordblks + info.hblkhd);
    };
    const auto expect_small = [&](const std::string& what, double outputs, auto make) {
        const double before = held();
        const auto made = make();
        ASSERT_TRUE(made) << what;
        const double mebi = (held() - before - outputs) / kMebi;
        EXPECT_LT(mebi, 16) << what;
        EXPECT_GT(mebi, 0.05) << what << ": nothing was measured";
    };
    const auto lenslets = static_cast<double>(e.lenslets());
    for (std::size_t f = 0; f < static_cast<std::size_t>(Feature::transmission); ++f) {
        const auto feature = static_cast<Feature>(f);
        expect_small(std::string(name_of(feature)), lenslets * (sizeof(float) + 1),
                     [&] { return FeatureMapper::create(e, 16, levels(16), feature, {.threads = 2}); });
    }
}

TEST(Allocation, decoding_a_raw_frame_into_one_that_is_there) {
    LensletGrid grid;
    grid.columns = grid.rows = 40;
    grid.width_px = grid.height_px = 400;
    grid.origin_u = grid.origin_v = 19.5;
    for (const double turn : {0.0, 0.8}) {  // decoded on its own lattice, and on an upright one
        grid.parameters = {199.5, 199.5, 14, turn};
        for (const int bits : {8, 12}) {
            auto decoder = GridDecoder::create(grid, std::nullopt, 9, 9);
            ASSERT_TRUE(decoder);
            Frame decoded = decoder->frame(bits);
            const Frame raw(400, 400, bits);
            EXPECT_EQ(allocated_by([&] { ASSERT_TRUE(decoder->decode(raw.view(), decoded)); }), 0U);
        }
    }
}

}  // namespace
}  // namespace hord::algo
