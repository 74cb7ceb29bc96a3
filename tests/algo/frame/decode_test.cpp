#include "algo/frame/decode.h"

#include <cstring>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

// 3x3 lenslets of 3x3 bins: sample (x, y) is 10 * y + x, so every mass identifies its sample.
Frame numbered(int bits) {
    Frame frame(9, 9, bits);
    for (int y = 0; y < 9; ++y) {
        for (int x = 0; x < 9; ++x) frame.set(x, y, static_cast<std::uint32_t>(10 * y + x));
    }
    return frame;
}

constexpr Extents kSmall{3, 3, 3, 3};

TEST(Decode, takes_the_bins_of_a_lenslet_from_its_macro_pixel) {
    for (const int bits : {8, 12, 16}) {
        const Frame frame = numbered(bits);
        HordRow row(kSmall);
        decode_row(frame.view(), kSmall, {0, 1, 255}, 1, row);  // lenslet row 1: image rows 3 to 5
        const Hord hord = row.hord(2);                          // image columns 6 to 8
        const std::uint16_t expected[] = {36, 37, 38, 46, 47, 48, 56, 57, 58};
        EXPECT_EQ(0, std::memcmp(hord.mass, expected, sizeof expected));
        EXPECT_EQ(hord.sum, 423U);
        EXPECT_TRUE(row.has_hord(2));
    }
}

TEST(Decode, subtracts_the_dark_level_and_never_goes_below_zero) {
    const Frame frame = numbered(8);
    HordRow row(kSmall);
    decode_row(frame.view(), kSmall, {11, 1, 255}, 0, row);
    const std::uint16_t expected[] = {0, 0, 0, 0, 0, 1, 9, 10, 11};  // samples 0 1 2, 10 11 12, 20 21 22
    EXPECT_EQ(0, std::memcmp(row.hord(0).mass, expected, sizeof expected));
    EXPECT_EQ(row.hord(0).sum, 31U);
}

TEST(Decode, masks_dark_and_saturated_lenslets_at_their_exact_limits) {
    const Frame frame = numbered(8);
    HordRow row(kSmall);
    decode_row(frame.view(), kSmall, {0, 100, 25}, 0, row);  // sums 99, 126, 153; peaks 22, 25, 28
    EXPECT_EQ(row.mask()[0], kDark);
    EXPECT_EQ(row.mask()[1], kSaturated);
    EXPECT_EQ(row.mask()[2], kSaturated);
    decode_row(frame.view(), kSmall, {0, 99, 26}, 0, row);
    EXPECT_EQ(row.mask()[0], kValid);
    EXPECT_EQ(row.mask()[1], kValid);
    EXPECT_EQ(row.mask()[2], kSaturated);
}

TEST(Decode, a_lenslet_may_be_saturated_and_dark_after_subtraction) {
    Frame frame(9, 9, 8);
    frame.set(0, 0, 200);
    HordRow row(kSmall);
    decode_row(frame.view(), kSmall, {190, 50, 200}, 0, row);
    EXPECT_EQ(row.mask()[0], kDark | kSaturated);
    EXPECT_EQ(row.mask()[1], kDark);
}

TEST(Decode, follows_padded_rows_and_rows_that_run_backwards) {
    const Frame frame = numbered(12);
    std::vector<std::uint16_t> padded(9 * 16, 4095);
    for (int y = 0; y < 9; ++y) {
        for (int x = 0; x < 9; ++x)
            padded[static_cast<std::size_t>((8 - y) * 16 + x)] = static_cast<std::uint16_t>(frame.view().sample(x, y));
    }
    const FrameView upside_down{reinterpret_cast<const std::byte*>(padded.data() + 8 * 16), 9, 9, -32, 12};
    HordRow straight(kSmall), backwards(kSmall);
    for (int n = 0; n < 3; ++n) {
        decode_row(frame.view(), kSmall, {2, 1, 4095}, n, straight);
        decode_row(upside_down, kSmall, {2, 1, 4095}, n, backwards);
        for (int m = 0; m < 3; ++m) {
            EXPECT_EQ(0, std::memcmp(straight.hord(m).mass, backwards.hord(m).mass, 9 * sizeof(std::uint16_t)));
            EXPECT_EQ(straight.mask()[static_cast<std::size_t>(m)], backwards.mask()[static_cast<std::size_t>(m)]);
        }
    }
}

// Masses as defined, sums and moments exact.
void expect_definition(const Frame& frame, const Extents& e, const LightLevels& levels, int n, Isa isa) {
    SCOPED_TRACE(static_cast<int>(isa));
    HordRow row(e);
    decode_row(frame.view(), e, levels, n, row, isa);
    for (int m = 0; m < e.m; ++m) {
        std::int64_t sum = 0, moment_x = 0, moment_y = 0;
        bool is_saturated = false;
        for (int k = 0; k < e.bins(); ++k) {
            const std::uint32_t sample = frame.view().sample(m * e.i + k % e.i, n * e.j + k / e.i);
            const std::uint32_t mass = sample > levels.dark ? sample - levels.dark : 0;
            ASSERT_EQ(row.hord(m).mass[k], mass);
            sum += mass;
            is_saturated = is_saturated || sample >= levels.saturated;
            moment_x += std::int64_t{2 * (k % e.i) - (e.i - 1)} * mass;
            moment_y += std::int64_t{2 * (k / e.i) - (e.j - 1)} * mass;
        }
        const auto at = static_cast<std::size_t>(m);
        ASSERT_EQ(row.hord(m).sum, sum);
        ASSERT_EQ(row.moments_x()[at], moment_x);
        ASSERT_EQ(row.moments_y()[at], moment_y);
        ASSERT_EQ(row.mask()[at], is_saturated ? kSaturated : kValid);
    }
}

std::vector<Isa> isas_here() {
    std::vector<Isa> isas;
    for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
        if (has(isa)) isas.push_back(isa);
    }
    return isas;
}

// Every number of bins, odd, even and rectangular, 8 to 16 bits: masses as defined, sums exact, by every instruction
// set.
TEST(Decode, holds_for_every_number_of_bins_and_every_bit_depth) {
    std::mt19937 random(2);
    const std::vector<Isa> isas = isas_here();
    for (int i = kMinBins; i <= kMaxBins; ++i) {
        for (const int j : {3, 4, 5, 7, 8, 9, 12, 14, 15}) {
            for (const int bits : {8, 10, 12, 16}) {
                const Extents e{5, 3, i, j};
                Frame frame(e.width_px(), e.height_px(), bits);
                for (int y = 0; y < e.height_px(); ++y) {
                    for (int x = 0; x < e.width_px(); ++x)
                        frame.set(x, y, static_cast<std::uint32_t>(random()) & frame.view().full_scale());
                }
                const std::uint32_t dark = frame.view().full_scale() / 7,
                                    saturated = frame.view().full_scale() - static_cast<std::uint32_t>(i);
                for (const Isa isa : isas) {
                    for (int n = 0; n < e.n; ++n) expect_definition(frame, e, {dark, 1, saturated}, n, isa);
                }
            }
        }
    }
}

TEST(Decode, a_lenslet_is_not_touched_by_its_neighbours_light) {
    const Extents e{4, 3, 3, 3};
    Frame frame(e.width_px(), e.height_px(), 8);
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) frame.set(x, y, x / 3 % 2 == 0 ? 255 : 1);
    }
    HordRow row(e);
    for (int n = 0; n < 3; ++n) {
        decode_row(frame.view(), e, {0, 1, 255}, n, row);
        for (const int m : {1, 3}) {
            EXPECT_TRUE(row.has_hord(m));
            EXPECT_EQ(row.hord(m).sum, 9U);
            for (int k = 0; k < 9; ++k) EXPECT_EQ(row.hord(m).mass[k], 1);
        }
    }
}

TEST(Decode, a_full_lenslet_of_15x15_bins_stays_in_range) {
    const Extents e{3, 3, 15, 15};
    for (const int bits : {8, 16}) {
        const std::uint32_t full_scale = (1U << bits) - 1;
        Frame frame(e.width_px(), e.height_px(), bits);
        for (int y = 0; y < e.height_px(); ++y) {
            for (int x = 0; x < e.width_px(); ++x) frame.set(x, y, full_scale);
        }
        for (const Isa isa : isas_here()) {
            HordRow row(e);
            decode_row(frame.view(), e, {0, 1, full_scale}, 2, row, isa);
            EXPECT_EQ(row.hord(1).sum, 225U * full_scale);
            EXPECT_LT(row.hord(1).sum, 1U << 24);
            EXPECT_EQ(row.moments_x()[1], 0);
            EXPECT_EQ(row.moments_y()[1], 0);
            EXPECT_EQ(row.mask()[1], kSaturated);
            decode_row(frame.view(), e, {0, 1, full_scale + 1}, 2, row, isa);  // nothing is that bright
            EXPECT_EQ(row.mask()[1], kValid);
        }
    }
}

}  // namespace
}  // namespace hord::algo
