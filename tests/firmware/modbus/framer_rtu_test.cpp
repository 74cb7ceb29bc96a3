#include "firmware/modbus/framer_rtu.h"

#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/crc16.h"

namespace hord::firmware::modbus {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Bytes = std::vector<std::uint8_t>;

Bytes with_crc(Bytes frame) {
    frame.resize(frame.size() + 2);
    common::write_crc16(frame);
    return frame;
}

class Line : public ::testing::Test {
  protected:
    FramerRtu framer{17, 20ms};
    hal::TimePoint now{};
    std::vector<Bytes> requests;

    void hear(const Bytes& bytes) {
        std::span<const std::uint8_t> rest(bytes);
        while (const auto request = framer.take(rest, now))
            requests.emplace_back(request->pdu.begin(), request->pdu.end());
    }
    void silence() { now += 21ms; }
};

TEST_F(Line, a_frame_with_a_good_crc_is_a_request) {
    hear({0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87});  // the specification's example
    ASSERT_EQ(requests.size(), 1U);
    EXPECT_THAT(requests[0], ElementsAre(0x03, 0x00, 0x6B, 0x00, 0x03));
}

TEST_F(Line, every_function_that_is_served_has_its_length) {
    const Bytes pdus[] = {{1, 0, 0, 0, 1},
                          {2, 0, 0, 0, 1},
                          {3, 0, 0, 0, 1},
                          {4, 0, 0, 0, 1},
                          {5, 0, 0, 0xFF, 0},
                          {6, 0, 0, 0, 1},
                          {15, 0, 0, 0, 9, 2, 1, 1},
                          {16, 0, 0, 0, 2, 4, 0, 1, 0, 2},
                          {22, 0, 0, 0, 0, 0, 0},
                          {23, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 1},
                          {43, 14, 1, 0}};
    Bytes all;
    for (const Bytes& pdu : pdus) {
        Bytes frame{17};
        frame.insert(frame.end(), pdu.begin(), pdu.end());
        frame = with_crc(frame);
        all.insert(all.end(), frame.begin(), frame.end());
    }
    for (const std::uint8_t byte : all) hear({byte});  // no silence between them
    EXPECT_THAT(requests, ::testing::ElementsAreArray(pdus));
}

// The byte that counts the others has not arrived; at its place is one of the frame before.
TEST_F(Line, the_length_is_not_that_of_an_earlier_frame) {
    hear(with_crc({18, 3, 6, 1, 2, 3, 0xFF, 5, 6}));
    const Bytes frame = with_crc({17, 16, 0, 0, 0, 2, 4, 0, 1, 0, 2});
    for (const std::uint8_t byte : frame) hear({byte});
    EXPECT_EQ(requests.size(), 1U);
}

TEST_F(Line, frames_of_the_largest_size_are_passed_over) {
    Bytes longest{18, 3, kMaxRtuFrame - 5};
    longest.resize(kMaxRtuFrame - 2);
    hear(with_crc(longest));
    hear(with_crc({17, 3, 0, 0, 0, 1}));
    EXPECT_EQ(requests.size(), 1U);
}

TEST_F(Line, broadcasts_are_taken_and_other_units_passed_over) {
    hear(with_crc({0, 6, 0, 1, 0, 2}));
    hear(with_crc({18, 3, 0, 0, 0, 2}));
    hear(with_crc({18, 3, 4, 1, 2, 3, 4}));  // the reply of unit 18
    hear(with_crc({18, 0x83, 2}));
    hear(with_crc({17, 3, 0, 0, 0, 1}));
    ASSERT_EQ(requests.size(), 2U);
    EXPECT_EQ(requests[0][0], 6);
    EXPECT_EQ(requests[1][0], 3);
}

TEST_F(Line, a_damaged_frame_is_no_request_and_the_next_after_a_silence_is) {
    Bytes damaged = with_crc({17, 3, 0, 0, 0, 1});
    damaged[3] ^= 1;
    hear(damaged);
    hear(with_crc({17, 3, 0, 0, 0, 1}));
    EXPECT_THAT(requests, IsEmpty()) << "without a silence nobody knows where it begins";
    silence();
    hear(with_crc({17, 3, 0, 0, 0, 1}));
    EXPECT_EQ(requests.size(), 1U);
}

TEST_F(Line, a_truncated_frame_is_forgotten_in_the_silence) {
    Bytes frame = with_crc({17, 16, 0, 0, 0, 2, 4, 0, 1, 0, 2});
    frame.resize(7);
    hear(frame);
    silence();
    hear(with_crc({17, 3, 0, 0, 0, 1}));
    EXPECT_EQ(requests.size(), 1U);
}

TEST_F(Line, a_request_inside_another_units_data_is_not_executed) {
    const Bytes hidden = with_crc({17, 6, 0x1F, 0x42, 0, 1});
    Bytes reply{18, 3, static_cast<std::uint8_t>(hidden.size())};
    reply.insert(reply.end(), hidden.begin(), hidden.end());
    hear(with_crc(reply));
    silence();
    reply.push_back(0x55);  // also not when the enclosing frame is damaged
    reply.push_back(0x55);
    hear(reply);
    EXPECT_THAT(requests, IsEmpty());
}

TEST_F(Line, noise_or_truncation_costs_at_most_the_request_it_hits) {
    for (std::uint32_t seed = 0; seed < 2000; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        requests.clear();
        constexpr std::size_t kSent = 12;
        const std::size_t hit = random() % kSent;
        for (std::size_t k = 0; k < kSent; ++k) {
            Bytes frame = with_crc({17, 3, 0, static_cast<std::uint8_t>(k), 0, 1});
            if (k == hit) {
                const std::size_t at = random() % frame.size();
                switch (random() % 4) {
                    case 0:
                        frame.insert(frame.begin() + static_cast<std::ptrdiff_t>(at),
                                     static_cast<std::uint8_t>(random()));
                        break;
                    case 1: frame.erase(frame.begin() + static_cast<std::ptrdiff_t>(at)); break;
                    case 2: frame[at] ^= static_cast<std::uint8_t>(1 + random() % 255); break;
                    default:  // noise alone, in the silence before the request
                        hear(Bytes(1 + random() % 40, static_cast<std::uint8_t>(random())));
                        silence();
                        break;
                }
            }
            hear(frame);
            silence();
        }
        EXPECT_GE(requests.size(), kSent - 1);
        for (const Bytes& request : requests) EXPECT_EQ(request.size(), 5U);
    }
}

TEST_F(Line, random_bytes_never_make_a_request_for_us_but_with_a_good_crc) {
    std::mt19937 random(3);
    Bytes noise(200'000);
    for (auto& byte : noise) byte = static_cast<std::uint8_t>(random());
    for (std::size_t k = 0; k < noise.size(); k += 50) {
        hear(
            Bytes(noise.begin() + static_cast<std::ptrdiff_t>(k), noise.begin() + static_cast<std::ptrdiff_t>(k + 50)));
        silence();
    }
    EXPECT_THAT(requests, IsEmpty());
}

}  // namespace
}  // namespace hord::firmware::modbus
