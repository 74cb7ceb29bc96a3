// A pipeline that decodes raw frames itself, row by row and band by band, gives what it gives for the decoded frame.
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/grid_decoder.h"
#include "algo/inspection/pipeline.h"
#include "algo/reference/reference_learner.h"

namespace hord::algo {
namespace {

constexpr int kSide = 620, kBins = 9;
constexpr double kPitch = 9.2;

LensletGrid lattice(bool hexagonal) {
    LensletGrid grid;
    grid.kind = hexagonal ? LatticeKind::hexagonal : LatticeKind::square;
    grid.stagger = hexagonal ? Stagger::rows : Stagger::none;
    grid.columns = 68, grid.rows = hexagonal ? 80 : 68;
    grid.origin_u = 0.5 * (grid.columns - 1);
    grid.origin_v = 0.5 * (grid.rows - 1) * (hexagonal ? kHalfSqrt3 : 1);
    grid.width_px = grid.height_px = kSide;
    const double turn = hexagonal ? 0.05 : 0.001;
    grid.parameters = {0.5 * kSide, 0.5 * kSide - 0.3, kPitch * std::cos(turn), kPitch * std::sin(turn)};
    return grid;
}

// A lens in free light, a spot of light behind each lenslet, with noise; `defect`: a disc that deflects more.
Frame drawn(const LensletGrid& grid, int bits, std::uint64_t seed, bool defect) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> noise(0, 0.6);
    const double scale = 1 << (bits - 8), radius = 24;
    std::vector<double> light(std::size_t{kSide} * kSide);
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const PixelPoint at = grid.centre_px(m, n);
            double x = (at.x_px - 0.5 * kSide) / kPitch, y = (at.y_px - 0.5 * kSide) / kPitch;
            const double bend = std::hypot(x, y) < radius ? 3.2 / radius : 0;
            const double flaw = defect && std::hypot(x - 6, y + 5) < 2 ? 1.3 : 0;
            x = at.x_px + bend * x + flaw, y = at.y_px + bend * y;
            for (int py = std::max(0, static_cast<int>(y) - 3); py < std::min(kSide, static_cast<int>(y) + 4); ++py) {
                for (int px = std::max(0, static_cast<int>(x) - 3); px < std::min(kSide, static_cast<int>(x) + 4); ++px)
                    light[static_cast<std::size_t>(py * kSide + px)] +=
                        200 * std::exp(-((px - x) * (px - x) + (py - y) * (py - y)) / 0.72);
            }
        }
    }
    Frame frame(kSide, kSide, bits);
    for (int py = 0; py < kSide; ++py) {
        for (int px = 0; px < kSide; ++px) {
            const double dn = scale * (light[static_cast<std::size_t>(py * kSide + px)] + noise(random));
            frame.set(px, py, static_cast<std::uint32_t>(std::clamp(std::lround(dn), 0L, 254L << (bits - 8))));
        }
    }
    return frame;
}

std::shared_ptr<const Reference> learned(GridDecoder& decoder, const LensletGrid& grid, int bits) {
    std::vector<Frame> parts;
    for (std::uint64_t k = 0; k < Reference::kMinParts; ++k)
        parts.push_back(*decoder.decode(drawn(grid, bits, 50 + k, false).view()));
    LearnOptions options;
    options.levels = light_levels({}, bits);
    auto reference = learn_reference(
        decoder.extents(), bits, parts.size(), [&](std::size_t k) -> Result<Frame> { return parts[k]; }, options);
    return reference ? std::make_shared<const Reference>(std::move(reference->reference)) : nullptr;
}

template <class Map>
bool same(const Map& a, const Map& b) {
    return std::ranges::equal(a, b);
}

void expect_same(const Inspection& a, const Inspection& b) {
    EXPECT_EQ(a.verdict, b.verdict);
    EXPECT_EQ(a.reason, b.reason);
    EXPECT_EQ(a.score, b.score);
    EXPECT_EQ(a.dark_dn, b.dark_dn);
    EXPECT_EQ(a.bounded, b.bounded);
    ASSERT_EQ(a.defects.size(), b.defects.size());
    for (std::size_t k = 0; k < a.defects.size(); ++k) EXPECT_EQ(a.defects[k].peak, b.defects[k].peak);
    EXPECT_TRUE(same(a.gradient, b.gradient));
    EXPECT_TRUE(same(a.frobenius, b.frobenius));
    EXPECT_TRUE(same(a.transmission, b.transmission));
    EXPECT_TRUE(same(a.spectral, b.spectral));
    EXPECT_TRUE(same(a.anisotropy, b.anisotropy));
    EXPECT_TRUE(same(a.z_score, b.z_score));
    EXPECT_TRUE(same(a.mask, b.mask));
    EXPECT_TRUE(same(a.sums, b.sums));
    for (int y = 0; y < a.macro_pixels.height_px; ++y) {
        for (int x = 0; x < a.macro_pixels.width_px; ++x)
            ASSERT_EQ(a.macro_pixels.sample(x, y), b.macro_pixels.sample(x, y)) << x << "," << y;
    }
}

struct Case {
    bool hexagonal;
    int bits;
    bool with_reference;
};
class RawFrames : public ::testing::TestWithParam<Case> {};

TEST_P(RawFrames, are_judged_as_the_decoded_frame_by_any_number_of_threads) {
    const auto [hexagonal, bits, with_reference] = GetParam();
    const LensletGrid grid = lattice(hexagonal);
    auto decoder = GridDecoder::create(grid, std::nullopt, kBins, kBins);
    ASSERT_TRUE(decoder) << decoder.error().message();
    ASSERT_EQ(decoder->regrids(), hexagonal);
    Recipe recipe;
    if (with_reference) {
        recipe.reference = learned(*decoder, grid, bits);
        ASSERT_NE(recipe.reference, nullptr);
    }
    for (const MapSet maps : {MapSet::judged, MapSet::all}) {
        auto by_frame = Pipeline::create(decoder->extents(), bits, recipe, 1, maps);
        ASSERT_TRUE(by_frame) << by_frame.error().message();
        for (int threads = 1; threads <= 3; ++threads) {
            auto by_rows = Pipeline::create(*decoder, bits, recipe, threads, maps);
            ASSERT_TRUE(by_rows) << by_rows.error().message();
            for (std::uint64_t seed = 1; seed <= 4; ++seed) {
                SCOPED_TRACE(::testing::Message() << threads << " threads, frame " << seed);
                const Frame raw = drawn(grid, bits, seed, seed % 2 == 0);
                const Frame decoded = *decoder->decode(raw.view());
                const auto wanted = by_frame->inspect(decoded.view()), got = by_rows->inspect(raw.view());
                ASSERT_TRUE(wanted && got);
                expect_same(*wanted, *got);
                EXPECT_NE(wanted->verdict, Verdict::unfit);
                EXPECT_TRUE(seed % 2 != 0 || wanted->verdict == Verdict::reject);
            }
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Lattices, RawFrames,
                         ::testing::Values(Case{false, 8, false}, Case{true, 8, false}, Case{false, 12, true},
                                           Case{true, 8, true}));

TEST(RawFrame, of_another_size_or_depth_is_refused) {
    const LensletGrid grid = lattice(false);
    const auto decoder = GridDecoder::create(grid, std::nullopt, kBins, kBins);
    ASSERT_TRUE(decoder);
    auto pipeline = Pipeline::create(*decoder, 8, {});
    ASSERT_TRUE(pipeline);
    EXPECT_TRUE(pipeline->inspect(Frame(kSide, kSide, 8).view()));
    EXPECT_FALSE(pipeline->inspect(Frame(kSide, kSide, 10).view()));
    EXPECT_FALSE(pipeline->inspect(Frame(kSide, kSide - 1, 8).view()));
    EXPECT_FALSE(pipeline->inspect(decoder->frame(8).view()));
}

}  // namespace
}  // namespace hord::algo
