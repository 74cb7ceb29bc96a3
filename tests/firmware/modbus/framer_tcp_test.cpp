#include "firmware/modbus/framer_tcp.h"

#include <algorithm>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::firmware::modbus {
namespace {

using ::testing::ElementsAre;
using Bytes = std::vector<std::uint8_t>;

struct Copy {
    std::uint16_t transaction;
    std::uint8_t unit;
    Bytes pdu;
    bool operator==(const Copy&) const = default;
};

// Feeds `bytes` in pieces that end at `cuts`.
std::vector<Copy> requests_in(FramerTcp& framer, const Bytes& bytes, std::vector<std::size_t> cuts = {}) {
    std::vector<Copy> all;
    cuts.push_back(bytes.size());
    std::size_t begin = 0;
    for (const std::size_t end : cuts) {
        auto piece = std::span(bytes).subspan(begin, end - begin);
        while (const auto request = framer.take(piece)) {
            all.push_back({request->transaction, request->unit, Bytes(request->pdu.begin(), request->pdu.end())});
        }
        begin = end;
    }
    return all;
}

Bytes frame_of(std::uint16_t transaction, std::uint8_t unit, const Bytes& pdu) {
    const auto byte = [](std::size_t v) { return static_cast<std::uint8_t>(v & 0xFFU); };
    Bytes frame{byte(transaction >> 8U),      byte(transaction),    0,   0,
                byte((pdu.size() + 1) >> 8U), byte(pdu.size() + 1), unit};
    frame.insert(frame.end(), pdu.begin(), pdu.end());
    return frame;
}

// The example of the Modbus specification: read registers 108 to 110.
const Bytes kReadThree{0x15, 0x01, 0x00, 0x00, 0x00, 0x06, 0xFF, 0x03, 0x00, 0x6B, 0x00, 0x03};

TEST(FramerTcp, one_frame_is_one_request) {
    FramerTcp framer;
    const auto requests = requests_in(framer, kReadThree);
    ASSERT_EQ(requests.size(), 1U);
    EXPECT_EQ(requests[0].transaction, 0x1501);
    EXPECT_EQ(requests[0].unit, 0xFF);
    EXPECT_THAT(requests[0].pdu, ElementsAre(0x03, 0x00, 0x6B, 0x00, 0x03));
}

TEST(FramerTcp, nothing_comes_of_a_frame_without_its_last_byte) {
    for (std::size_t size = 0; size < kReadThree.size(); ++size) {
        FramerTcp framer;
        EXPECT_TRUE(
            requests_in(framer, Bytes(kReadThree.begin(), kReadThree.begin() + static_cast<std::ptrdiff_t>(size)))
                .empty());
        EXPECT_FALSE(framer.broken());
    }
}

TEST(FramerTcp, the_shortest_and_the_longest_frame_are_taken) {
    FramerTcp framer;
    Bytes stream = frame_of(1, 1, {0x07});
    const Bytes longest = frame_of(2, 1, Bytes(kMaxPdu, 0x55));
    EXPECT_EQ(longest.size(), 260U);
    stream.insert(stream.end(), longest.begin(), longest.end());
    const auto requests = requests_in(framer, stream);
    ASSERT_EQ(requests.size(), 2U);
    EXPECT_EQ(requests[0].pdu.size(), 1U);
    EXPECT_EQ(requests[1].pdu.size(), 253U);
}

TEST(FramerTcp, a_wrong_header_breaks_the_stream_for_good) {
    const Bytes wrong[] = {
        {0, 1, 0, 1, 0, 6, 1, 3, 0, 0, 0, 1},        // protocol id
        {0, 1, 1, 0, 0, 6, 1, 3, 0, 0, 0, 1},        // protocol id, high byte
        {0, 1, 0, 0, 0, 0, 1, 3, 0, 0, 0, 1},        // length 0
        {0, 1, 0, 0, 0, 1, 1, 3, 0, 0, 0, 1},        // length 1: no function code
        {0, 1, 0, 0, 0, 255, 1, 3, 0, 0, 0, 1},      // length 255: longer than any PDU
        {0, 1, 0, 0, 0xFF, 0xFF, 1, 3, 0, 0, 0, 1},  // length 65535
    };
    for (const Bytes& bytes : wrong) {
        FramerTcp framer;
        EXPECT_TRUE(requests_in(framer, bytes).empty());
        EXPECT_TRUE(framer.broken());
        EXPECT_TRUE(requests_in(framer, kReadThree).empty()) << "nothing after it is trusted";
    }
}

TEST(FramerTcp, a_good_frame_before_a_wrong_header_is_still_answered) {
    FramerTcp framer;
    Bytes stream = kReadThree;
    stream.insert(stream.end(), {0, 2, 9, 9, 0, 6});
    EXPECT_EQ(requests_in(framer, stream).size(), 1U);
    EXPECT_TRUE(framer.broken());
}

TEST(FramerTcp, however_the_stream_is_cut_the_requests_are_the_same) {
    for (std::uint32_t seed = 0; seed < 500; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto below = [&](std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(random); };
        std::vector<Copy> sent;
        Bytes stream;
        for (std::size_t k = 0, n = 1 + below(8); k < n; ++k) {
            Copy copy{static_cast<std::uint16_t>(below(65536)), static_cast<std::uint8_t>(below(256)),
                      Bytes(1 + below(kMaxPdu))};
            for (auto& byte : copy.pdu) byte = static_cast<std::uint8_t>(below(256));
            const Bytes frame = frame_of(copy.transaction, copy.unit, copy.pdu);
            stream.insert(stream.end(), frame.begin(), frame.end());
            sent.push_back(std::move(copy));
        }
        std::vector<std::size_t> cuts;
        for (std::size_t k = 0, n = below(40); k < n; ++k) cuts.push_back(below(stream.size() + 1));
        if (seed % 10 == 0) {  // byte by byte
            cuts.clear();
            for (std::size_t k = 1; k < stream.size(); ++k) cuts.push_back(k);
        }
        std::sort(cuts.begin(), cuts.end());
        FramerTcp framer;
        EXPECT_EQ(requests_in(framer, stream, cuts), sent);
        EXPECT_FALSE(framer.broken());
    }
}

TEST(FramerTcp, random_bytes_give_requests_of_legal_size_or_break_it) {
    int broken = 0;
    for (std::uint32_t seed = 0; seed < 2000; ++seed) {
        std::mt19937 random(seed);
        Bytes noise(1 + random() % 600);
        for (auto& byte : noise) byte = static_cast<std::uint8_t>(random() % (seed % 2 == 0 ? 256 : 3));
        FramerTcp framer;
        for (const Copy& request : requests_in(framer, noise)) {
            EXPECT_GE(request.pdu.size(), 1U);
            EXPECT_LE(request.pdu.size(), kMaxPdu);
        }
        broken += framer.broken() ? 1 : 0;
    }
    EXPECT_GT(broken, 1000);
}

TEST(FramerTcp, the_reply_carries_the_requests_transaction_and_unit) {
    Bytes reply(kMbapSize + 5);
    write_mbap({.transaction = 0x1501, .unit = 0xFF, .pdu = {}}, 5, reply);
    EXPECT_THAT(Bytes(reply.begin(), reply.begin() + 7), ElementsAre(0x15, 0x01, 0, 0, 0, 6, 0xFF));
}

}  // namespace
}  // namespace hord::firmware::modbus
