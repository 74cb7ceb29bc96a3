// The decode of raw frames: geometry, arithmetic, limits, and the same bits on every machine.
#include "algo/frame/resample.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/decode_whole.h"

namespace hord::algo {
namespace {

// An upright grid: `pitch` px a lenslet, the first centre at (first, first).
LensletGrid upright(int columns, int rows, double pitch, double first) {
    LensletGrid grid;
    grid.columns = columns;
    grid.rows = rows;
    grid.width_px = static_cast<int>(pitch * columns);
    grid.height_px = static_cast<int>(pitch * rows);
    grid.model = GridModelKind::similarity;
    grid.parameters = {first, first, pitch, 0};
    return grid;
}

Frame noise(int width, int height, int bits) {
    Frame frame(width, height, bits);
    std::uint32_t state = 12345;
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            state = state * 1664525U + 1013904223U;
            frame.set(x, y, state >> (32U - static_cast<unsigned>(bits)));
        }
    }
    return frame;
}

TEST(Resample, an_aligned_frame_of_one_pixel_a_bin_is_copied) {
    for (const int bits : {8, 12, 16}) {
        const Frame raw = noise(45, 36, bits);
        const LensletGrid grid = upright(5, 4, 9, 4);
        const auto resampler = Resampler::create(grid, even_layout(grid, 9, 9));
        ASSERT_TRUE(resampler) << resampler.error().message();
        const auto decoded = test::decode_whole(*resampler, raw.view());
        int different = 0;
        // The last column and row of boxes need one pixel more than the frame has, of weight 0: they are dark.
        for (int y = 0; y < 35; ++y) {
            for (int x = 0; x < 44; ++x) different += decoded.view().sample(x, y) != raw.view().sample(x, y) ? 1 : 0;
        }
        EXPECT_EQ(different, 0) << bits;
    }
}

TEST(Resample, a_bin_is_the_mean_of_what_lies_under_it) {
    // Bins of 2 px on a grid that starts on whole pixels: plain means of 2 x 2.
    const Frame raw = noise(60, 60, 12);
    const LensletGrid grid = upright(5, 5, 12, 6.5);
    const auto resampler = Resampler::create(grid, even_layout(grid, 6, 6));
    ASSERT_TRUE(resampler);
    const auto decoded = test::decode_whole(*resampler, raw.view());
    const auto view = raw.view();
    for (int j = 0; j < 6; ++j) {
        for (int i = 0; i < 6; ++i) {
            // Lenslet (1, 2): its first bin covers pixels 13, 14 in x and 25, 26 in y.
            const int x = 13 + 2 * i;
            const int y = 25 + 2 * j;
            const std::uint32_t sum =
                view.sample(x, y) + view.sample(x + 1, y) + view.sample(x, y + 1) + view.sample(x + 1, y + 1);
            EXPECT_EQ(decoded.view().sample(6 + i, 12 + j), (sum + 2) / 4);
        }
    }
}

TEST(Resample, full_scale_stays_full_scale_and_black_stays_black) {
    for (const std::uint32_t level : {0U, 65535U}) {
        Frame raw(97, 97, 16);
        for (int y = 0; y < 97; ++y) {
            for (int x = 0; x < 97; ++x) raw.set(x, y, level);
        }
        LensletGrid grid = upright(4, 4, 17.3, 20.4);
        grid.width_px = grid.height_px = 97;
        grid.parameters = {20.4, 20.1, 17.3, 0.6};
        const auto resampler = Resampler::create(grid, even_layout(grid, 7, 9));
        ASSERT_TRUE(resampler) << resampler.error().message();
        const auto decoded = test::decode_whole(*resampler, raw.view());
        for (int y = 0; y < decoded.height_px(); ++y) {
            for (int x = 0; x < decoded.width_px(); ++x) ASSERT_EQ(decoded.view().sample(x, y), level);
        }
    }
}

TEST(Resample, a_ramp_is_read_at_the_bins_own_places) {
    // On a linear ramp the mean of a box is the ramp at its centre. Errors: the positions of lenslet and bin (1/64 px
    // each); the weights (1/256 for each of 4 pixels up to 1.5 px away and their rounding, together 0.025 px); light
    // that is assumed constant over a pixel (1/8 px over the box's width of 2.2 px); the rounding of samples.
    const double slope = 97;
    Frame raw(300, 300, 16);
    for (int y = 0; y < 300; ++y) {
        for (int x = 0; x < 300; ++x) raw.set(x, y, static_cast<std::uint32_t>(1000 + slope * x));
    }
    for (const Stagger stagger : {Stagger::none, Stagger::rows, Stagger::columns}) {
        LensletGrid grid = upright(9, 9, 20, 0);
        grid.kind = stagger == Stagger::none ? LatticeKind::square : LatticeKind::hexagonal;
        grid.stagger = stagger;
        grid.width_px = grid.height_px = 300;
        grid.model = GridModelKind::radial1;
        grid.origin_u = grid.origin_v = 4;
        grid.span = 4;
        grid.parameters = {150, 150, 80, -4, 4, 80, 0.002, -0.001, -0.01};
        grid.middle_x_px = grid.middle_y_px = 149.5;
        grid.radius_px = 150;
        const BinLayout layout = even_layout(grid, 9, 9);
        const auto resampler = Resampler::create(grid, layout);
        ASSERT_TRUE(resampler) << resampler.error().message();
        const auto decoded = test::decode_whole(*resampler, raw.view());
        const double tolerance = slope * (1.0 / 32 + 0.025 + 0.125 / 2.2) + 1;
        for (int n = 0; n < 9; ++n) {
            for (int m = 0; m < 9; ++m) {
                for (int i = 0; i < 9; ++i) {
                    const double x = grid.centre_px(m, n).x_px + (i - 4) * layout.box_x_px;
                    EXPECT_NEAR(decoded.view().sample(m * 9 + i, n * 9 + 4), 1000 + slope * x, tolerance);
                }
            }
        }
    }
}

TEST(Resample, bins_beyond_the_frame_hold_no_light) {
    Frame raw(90, 90, 8);
    for (int y = 0; y < 90; ++y) {
        for (int x = 0; x < 90; ++x) raw.set(x, y, 200);
    }
    LensletGrid grid = upright(4, 4, 30, 0);
    grid.width_px = grid.height_px = 90;
    const auto resampler = Resampler::create(grid, even_layout(grid, 5, 5));
    const auto decoded = test::decode_whole(*resampler, raw.view());
    EXPECT_EQ(decoded.view().sample(0, 0), 0U);    // half a lenslet left of the frame
    EXPECT_EQ(decoded.view().sample(7, 7), 200U);  // the middle of lenslet (1, 1)
    EXPECT_EQ(decoded.view().sample(19, 19), 0U);
}

TEST(Resample, the_same_bits_on_every_machine) {
    LensletGrid grid = upright(12, 11, 18.37, 0);
    grid.width_px = grid.height_px = 260;
    grid.model = GridModelKind::radial1;
    grid.origin_u = grid.origin_v = 5.5;
    grid.span = 6;
    grid.parameters = {129.3, 131.2, 110.1, -5.7, 5.9, 110.6, 0.002, -0.001, -0.004};
    grid.middle_x_px = grid.middle_y_px = 129.5;
    grid.radius_px = 130;
    const auto resampler = Resampler::create(grid, even_layout(grid, 9, 9));
    ASSERT_TRUE(resampler);
    const auto decoded = test::decode_whole(*resampler, noise(260, 260, 12).view());
    std::uint64_t hash = 14695981039346656037U;
    for (const std::byte byte : decoded.bytes()) hash = (hash ^ static_cast<std::uint64_t>(byte)) * 1099511628211U;
    EXPECT_EQ(hash, 2871495133730868134U);
}

// If the processor supports it, 8-bit samples are processed in whole rows of bins; the same samples in a deeper frame
// are processed one by one.
TEST(Resample, eight_bit_frames_have_the_bits_of_the_general_way) {
    const Frame narrow = noise(300, 280, 8);
    Frame deep(300, 280, 12);
    for (int y = 0; y < 280; ++y) {
        for (int x = 0; x < 300; ++x) deep.set(x, y, narrow.view().sample(x, y));
    }
    for (const double pitch : {4.6, 9.0, 9.4, 14.3, 16.1, 20.6}) {
        for (const auto& [bins_i, bins_j] : {std::pair{9, 9}, {8, 7}, {5, 12}, {15, 15}, {3, 4}}) {
            if (pitch / bins_i < 0.5 || pitch / bins_j < 0.5) continue;
            SCOPED_TRACE(::testing::Message() << pitch << " px, " << bins_i << "x" << bins_j);
            LensletGrid grid = upright(static_cast<int>(300 / pitch) + 2, static_cast<int>(280 / pitch) + 2, pitch,
                                       -3.3);  // beyond every rim
            grid.width_px = 300;
            grid.height_px = 280;
            grid.parameters[3] = 0.02 * pitch;
            const auto resampler = Resampler::create(grid, even_layout(grid, bins_i, bins_j));
            ASSERT_TRUE(resampler) << resampler.error().message();
            const Frame a = test::decode_whole(*resampler, narrow.view()),
                        b = test::decode_whole(*resampler, deep.view());
            for (int y = 0; y < a.height_px(); ++y) {
                for (int x = 0; x < a.width_px(); ++x)
                    ASSERT_EQ(a.view().sample(x, y), b.view().sample(x, y)) << x << "," << y;
            }
            const auto size = static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(bins_i * bins_j);
            std::vector<std::uint8_t> one(size), alone(static_cast<std::size_t>(bins_i * bins_j));
            std::vector<std::uint16_t> two(size);
            for (int n = 0; n < grid.rows; ++n) {
                resampler->decode_row_by_lenslet(narrow.view(), n, 0, grid.columns - 1, one.data());
                resampler->decode_row_by_lenslet(deep.view(), n, 0, grid.columns - 1, two.data());
                ASSERT_TRUE(std::ranges::equal(one, two)) << n;
                for (int m = 0; m < grid.columns; ++m) {
                    resampler->decode_lenslet(narrow.view(), m, n, alone.data(), bins_i);
                    ASSERT_TRUE(std::equal(alone.begin(), alone.end(), one.begin() + m * bins_i * bins_j))
                        << m << "," << n;
                }
            }
        }
    }
}

TEST(Resample, what_cannot_be_decoded_is_refused) {
    const LensletGrid grid = upright(5, 5, 9, 4);
    EXPECT_FALSE(Resampler::create(grid, even_layout(grid, 2, 9)));
    EXPECT_FALSE(Resampler::create(grid, even_layout(upright(4, 4, 0.9, 20), 9, 9)));
    LensletGrid broken = grid;
    broken.parameters.pop_back();
    EXPECT_FALSE(Resampler::create(broken, even_layout(grid, 9, 9)));
}

}  // namespace
}  // namespace hord::algo
