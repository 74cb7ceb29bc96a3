// The packings of GigE Vision and PFNC, by the examples of their documents: sample 0 is 0x3A5 or 0xABC.
#include "drivers/hal/packed_samples.h"

#include <array>
#include <vector>

#include <gtest/gtest.h>

namespace hord::drivers {
namespace {

std::vector<std::byte> bytes(std::initializer_list<unsigned> values) {
    std::vector<std::byte> out;
    for (const unsigned value : values) out.push_back(static_cast<std::byte>(value));
    return out;
}
using Samples = std::vector<std::uint16_t>;

TEST(PackedSamples, mono10packed_and_mono12packed_hold_two_in_three_bytes) {
    Samples three(3);
    ASSERT_TRUE(unpack_gige(bytes({0xE9, 0b0011'0001, 0x00, 0xFF, 0b0000'0010}), 10, three));
    EXPECT_EQ(three, (Samples{0x3A5, 0x003, 0x3FE}));
    ASSERT_TRUE(unpack_gige(bytes({0xAB, 0x5C, 0x12, 0xFF, 0x0F}), 12, three));
    EXPECT_EQ(three, (Samples{0xABC, 0x125, 0xFFF}));
}

TEST(PackedSamples, mono10p_and_mono12p_are_one_stream_of_bits) {
    Samples four(4);
    // 0x3A5, 0x001, 0x200, 0x3FF, lowest bit first.
    ASSERT_TRUE(unpack_pfnc(bytes({0xA5, 0b0000'0111, 0b0000'0000, 0b1110'0000, 0xFF}), 10, four));
    EXPECT_EQ(four, (Samples{0x3A5, 0x001, 0x200, 0x3FF}));
    Samples three(3);
    ASSERT_TRUE(unpack_pfnc(bytes({0xBC, 0x5A, 0x12, 0xFF, 0x0F}), 12, three));
    EXPECT_EQ(three, (Samples{0xABC, 0x125, 0xFFF}));
}

TEST(PackedSamples, a_frame_that_is_too_short_is_not_unpacked) {
    Samples three(3, 7);
    EXPECT_FALSE(unpack_gige(bytes({0xAB, 0x5C, 0x12, 0xFF}), 12, three));
    EXPECT_FALSE(unpack_pfnc(bytes({0xAB, 0x5C, 0x12}), 10, three));
    EXPECT_EQ(three, (Samples{7, 7, 7}));
}

}  // namespace
}  // namespace hord::drivers
