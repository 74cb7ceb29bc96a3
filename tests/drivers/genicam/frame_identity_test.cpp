// Block ids and the camera's clock.
#include "drivers/genicam/frame_identity.h"

#include <gtest/gtest.h>

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;

hal::TimePoint at(hal::Duration since) { return hal::TimePoint(since); }

std::vector<std::uint32_t> sequences(const std::vector<std::uint64_t>& ids) {
    BlockCounter counter;
    std::vector<std::uint32_t> out;
    for (const std::uint64_t id : ids) out.push_back(counter.sequence_of(id));
    return out;
}

TEST(BlockCounter, ids_of_16_bits_go_from_65535_to_1) {
    EXPECT_EQ(sequences({65534, 65535, 1, 2}), (std::vector<std::uint32_t>{1, 2, 3, 4}));
    EXPECT_EQ(sequences({65534, 2, 3}), (std::vector<std::uint32_t>{1, 4, 5})) << "65535 and 1 were lost";
}
TEST(BlockCounter, of_firmware_that_has_a_block_0_ids_go_from_65535_to_0) {
    EXPECT_EQ(sequences({0, 1, 40'000, 65535, 0, 1}), (std::vector<std::uint32_t>{1, 2, 40'001, 65536, 65537, 65538}));
    EXPECT_EQ(sequences({65535, 0, 1}), (std::vector<std::uint32_t>{1, 2, 3})) << "seen at the first wrap";
}
TEST(BlockCounter, ids_of_64_bits_do_not_wrap_at_16) {
    EXPECT_EQ(sequences({65534, 65535, 65536, 65539}), (std::vector<std::uint32_t>{1, 2, 3, 6}));
    EXPECT_EQ(sequences({1ULL << 40U, (1ULL << 40U) + 1}), (std::vector<std::uint32_t>{1, 2}));
}
TEST(BlockCounter, a_block_that_comes_after_later_ones_keeps_its_number) {
    EXPECT_EQ(sequences({7, 9, 8, 10}), (std::vector<std::uint32_t>{1, 3, 2, 4}));
    EXPECT_EQ(sequences({65534, 1, 65535, 2}), (std::vector<std::uint32_t>{1, 3, 2, 4})) << "across the wrap";
    EXPECT_EQ(sequences({70'000, 70'003, 70'001, 70'004}), (std::vector<std::uint32_t>{1, 4, 2, 5}));
}
TEST(BlockCounter, blocks_without_an_id_take_the_numbers_up_to_the_next_id) {
    BlockCounter counter;
    EXPECT_EQ(counter.sequence_without_id(), 1U);
    EXPECT_EQ(counter.sequence_of(5), 2U);
    EXPECT_EQ(counter.sequence_without_id(), 3U);
    EXPECT_EQ(counter.sequence_without_id(), 4U);
    EXPECT_EQ(counter.sequence_of(8), 5U);
    EXPECT_EQ(counter.sequence_without_id(), 6U);
    EXPECT_EQ(counter.sequence_of(11), 8U);  // a block was lost whole
}

TEST(BlockCounter, a_repeated_id_repeats_the_sequence) {
    EXPECT_EQ(sequences({7, 8, 8, 9}), (std::vector<std::uint32_t>{1, 2, 2, 3}));
}

TEST(CameraClock, the_offset_lies_between_the_readings_around_the_latch) {
    CameraClock clock;
    EXPECT_FALSE(clock.error());
    clock.latched(at(1000us), 400us, at(1200us));  // offset 600 to 800
    EXPECT_EQ(*clock.error(), 100us);
    EXPECT_EQ(clock.earliest(500us), at(1100us));
    EXPECT_EQ(clock.latest(500us), at(1300us));
    clock.latched(at(1300us), 500us, at(1370us));  // 800 to 870: meets the first one, which grew by less than 1 us
    EXPECT_LT(*clock.error(), 1us);
    EXPECT_LE(clock.earliest(0us), at(800us));
    EXPECT_GE(clock.latest(0us), at(800us));
}

// Two clocks that drift by 100 ppm: the interval contains the true offset at any time, and its width stays bounded.
TEST(CameraClock, follows_a_drift) {
    CameraClock clock;
    for (int second = 1; second <= 600; ++second) {
        const hal::Duration now = second * 1s, camera(static_cast<std::int64_t>(1e9 * second * 1.0001));
        const hal::Duration early = second % 7 * 20us, late = second % 5 * 30us + 10us;  // asymmetric, changing delays
        clock.latched(at(now - early), camera, at(now + late));
        EXPECT_LE(clock.earliest(camera), at(now)) << second;
        EXPECT_GE(clock.latest(camera), at(now)) << second;
        EXPECT_LE(*clock.error(), 500us);
    }
}

TEST(CameraClock, that_was_set_is_learned_again) {
    CameraClock clock;
    clock.latched(at(1s), 1s, at(1s + 100us));
    clock.latched(at(2s), 50s, at(2s + 100us));
    EXPECT_EQ(clock.latest(50s), at(2s + 100us));
}

TEST(CameraClock, that_cannot_be_latched_is_as_late_as_the_quickest_arrival) {
    CameraClock clock;
    clock.arrived(100ms, at(105ms));
    clock.arrived(200ms, at(202ms));
    clock.arrived(300ms, at(309ms));
    EXPECT_FALSE(clock.error());
    EXPECT_GE(clock.latest(400ms), at(402ms));
    EXPECT_LE(clock.latest(400ms), at(402ms + 200us)) << "grown for the drift of 0.1 s";
}

}  // namespace
}  // namespace hord::drivers
