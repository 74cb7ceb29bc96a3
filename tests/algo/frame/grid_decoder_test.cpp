// One decoder for every lattice: choice of the path, equality with that path, refusals.
#include "algo/frame/grid_decoder.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/decode_whole.h"

namespace hord::algo {
namespace {

// A rotated square lattice of 20 x 18 lenslets of 16 px about the middle of a frame of its size.
LensletGrid lattice(double turn_rad) {
    LensletGrid grid;
    grid.columns = 20;
    grid.rows = 18;
    grid.width_px = 320;
    grid.height_px = 288;
    grid.origin_u = 9.5;
    grid.origin_v = 8.5;
    grid.model = GridModelKind::similarity;
    grid.parameters = {159.5, 143.5, 16 * std::cos(turn_rad), 16 * std::sin(turn_rad)};
    return grid;
}

Frame noise(int width, int height, int bits) {
    Frame frame(width, height, bits);
    std::uint32_t state = 4711;
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x)
            frame.set(x, y, (state = state * 1664525U + 1013904223U) >> (32U - static_cast<unsigned>(bits)));
    }
    return frame;
}

bool same(const Frame& a, const Frame& b) { return std::ranges::equal(a.bytes(), b.bytes()); }

TEST(GridDecoder, an_upright_square_lattice_is_read_lenslet_by_lenslet) {
    for (const int bits : {8, 12, 16}) {
        const LensletGrid grid = lattice(0);
        auto decoder = GridDecoder::create(grid, std::nullopt, 8, 8);
        ASSERT_TRUE(decoder) << decoder.error().message();
        EXPECT_FALSE(decoder->regrids());
        EXPECT_EQ(decoder->extents(), (Extents{20, 18, 8, 8}));
        const Frame raw = noise(320, 288, bits);
        const auto resampler = Resampler::create(grid, even_layout(grid, 8, 8));
        EXPECT_TRUE(same(*decoder->decode(raw.view()), test::decode_whole(*resampler, raw.view()))) << bits;
    }
}

// Rotated by a third of a degree, a corner of each outer column leaves the frame; the columns are dropped.
TEST(GridDecoder, lenslets_outside_the_frame_are_left_out_with_their_column) {
    LensletGrid grid = lattice(0);
    grid.columns = 22;
    grid.origin_u += 1;  // one more on either side, outside
    auto decoder = GridDecoder::create(grid, std::nullopt, 8, 8);
    ASSERT_TRUE(decoder);
    EXPECT_FALSE(decoder->regrids());
    EXPECT_EQ(decoder->extents(), (Extents{20, 18, 8, 8}));
    const Frame raw = noise(320, 288, 8);
    auto whole = GridDecoder::create(lattice(0), std::nullopt, 8, 8);
    EXPECT_TRUE(same(*decoder->decode(raw.view()), *whole->decode(raw.view())));
}

TEST(GridDecoder, a_turned_or_hexagonal_lattice_is_read_onto_an_upright_one) {
    LensletGrid hexagonal = lattice(0);
    hexagonal.kind = LatticeKind::hexagonal;
    hexagonal.stagger = Stagger::rows;
    for (LensletGrid grid : {lattice(0.3), hexagonal}) {
        grid.columns += 16;
        grid.rows += 16;
        grid.origin_u += 8;
        grid.origin_v += 8;
        auto decoder = GridDecoder::create(grid, std::nullopt, 9, 7);
        ASSERT_TRUE(decoder) << decoder.error().message();
        EXPECT_TRUE(decoder->regrids());
        const Frame raw = noise(320, 288, 12);
        auto regridder = Regridder::create(grid, even_layout(grid, 9, 7));
        const Frame wanted = test::decode_whole(*regridder, raw.view());
        Frame out = decoder->frame(12);
        for (int again = 0; again < 2; ++again) {  // the second result must not depend on the first
            ASSERT_TRUE(decoder->decode(noise(320, 288, 12).view(), out));
            EXPECT_TRUE(same(out, wanted));
            ASSERT_TRUE(decoder->decode(Frame(320, 288, 12).view(), out));
        }
    }
}

TEST(GridDecoder, single_lenslets_are_read_where_they_are) {
    LensletGrid grid = lattice(0);
    grid.columns = 22;  // one more on either side, outside
    grid.origin_u += 1;
    grid.shifts_px.assign(22 * 18, {});
    grid.shifts_px[5 * 22 + 7] = {1, -2};
    auto decoder = GridDecoder::create(grid, std::nullopt, 8, 8);
    ASSERT_TRUE(decoder) << decoder.error().message();
    LensletGrid moved = lattice(0);
    moved.parameters[0] += 1;
    moved.parameters[1] -= 2;
    auto all_moved = GridDecoder::create(moved, std::nullopt, 8, 8);
    auto none_moved = GridDecoder::create(lattice(0), std::nullopt, 8, 8);
    const Frame raw = noise(320, 288, 8);
    const Frame seen = *decoder->decode(raw.view()), wanted = *all_moved->decode(raw.view()),
                before = *none_moved->decode(raw.view());
    for (int y = 0; y < seen.height_px(); ++y) {
        for (int x = 0; x < seen.width_px(); ++x) {
            const bool its_own = x / 8 == 6 && y / 8 == 5;
            ASSERT_EQ(seen.view().sample(x, y), (its_own ? wanted : before).view().sample(x, y)) << x << "," << y;
        }
    }
}

TEST(GridDecoder, a_bin_is_known_in_pixels_and_with_a_direction_map_in_radians) {
    EXPECT_DOUBLE_EQ(GridDecoder::create(lattice(0), std::nullopt, 8, 8)->bin_px(), 2);
    EXPECT_EQ(GridDecoder::create(lattice(0), std::nullopt, 8, 8)->bin_rad(), 0);
    DirectionMap map;
    map.parameters = {0, 0, 4, 0};
    map.span_rad = 0.02;  // 200 px a radian
    EXPECT_NEAR(GridDecoder::create(lattice(0), map, 8, 8)->bin_rad(), 0.01, 1e-12);
}

TEST(GridDecoder, frames_of_another_sensor_and_impossible_bins_are_refused) {
    auto decoder = GridDecoder::create(lattice(0), std::nullopt, 8, 8);
    Frame out = decoder->frame(8);
    const auto other = decoder->decode(noise(320, 280, 8).view(), out);
    ASSERT_FALSE(other);
    EXPECT_NE(other.error().what.find("320x280"), std::string::npos);
    EXPECT_FALSE(decoder->decode(noise(320, 288, 12).view(), out));  // into a frame of another depth
    FrameView narrow = out.view();
    const Frame raw = noise(320, 288, 8);
    narrow = raw.view();
    narrow.stride_bytes = 100;
    EXPECT_FALSE(decoder->decode(narrow, out));
    EXPECT_FALSE(GridDecoder::create(lattice(0), std::nullopt, 8, 40));
    LensletGrid broken = lattice(0);
    broken.parameters.pop_back();
    EXPECT_FALSE(GridDecoder::create(broken, std::nullopt, 8, 8));
}

}  // namespace
}  // namespace hord::algo
