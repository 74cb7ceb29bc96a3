// The bit depth that the samples of a frame look like.
#include "algo/light/sample_depth.h"

#include <cstdint>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

constexpr std::size_t kLenslets = 40;

// So many samples of `bright`; the others read 3.
Frame frame_of(int bits, std::size_t number, std::uint32_t bright) {
    Frame frame(50, 20, bits);
    for (std::size_t k = 0; k < 1000; ++k)
        frame.set(static_cast<int>(k % 50), static_cast<int>(k / 50), k < number ? bright : 3);
    return frame;
}

TEST(FewerBits, are_those_of_a_sensor_whose_range_the_light_of_most_lenslets_fills) {
    EXPECT_EQ(fewer_bits(frame_of(12, 20, 1023).view(), kLenslets), 10);
    EXPECT_EQ(fewer_bits(frame_of(12, 20, 512).view(), kLenslets), 10);
    EXPECT_EQ(fewer_bits(frame_of(12, 20, 130).view(), kLenslets), 8);
    EXPECT_EQ(fewer_bits(frame_of(16, 20, 4095).view(), kLenslets), 12);
    EXPECT_EQ(fewer_bits(frame_of(16, 20, 16383).view(), kLenslets), 14);
}

TEST(FewerBits, are_none_of_a_frame_that_fills_its_range_or_of_darkness) {
    EXPECT_EQ(fewer_bits(frame_of(12, 1, 1024).view(), kLenslets), 0);
    EXPECT_EQ(fewer_bits(frame_of(12, 20, 4095).view(), kLenslets), 0);
    EXPECT_EQ(fewer_bits(frame_of(8, 20, 255).view(), kLenslets), 0);
    EXPECT_EQ(fewer_bits(frame_of(12, 20, 511).view(), kLenslets), 0);  // not in the upper half of 10 bits
    EXPECT_EQ(fewer_bits(frame_of(16, 20, 300).view(), kLenslets), 0);  // sensors have no 9 bits
    EXPECT_EQ(fewer_bits(frame_of(8, 20, 100).view(), kLenslets), 0);
    EXPECT_EQ(fewer_bits(frame_of(12, 19, 1023).view(), kLenslets), 0);  // a few warm pixels
    EXPECT_EQ(fewer_bits(frame_of(12, 0, 0).view(), kLenslets), 0);
}

}  // namespace
}  // namespace hord::algo
