// Messages of a GigE camera's message channel. The bytes are written from the layout of the packets, by hand.
#include "drivers/genicam/gvcp_events.h"

#include <gtest/gtest.h>

namespace hord::drivers {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes event(std::uint16_t id, std::uint8_t ticks) {
    Bytes out(16, 0);
    out[2] = static_cast<std::uint8_t>(id >> 8U);
    out[3] = static_cast<std::uint8_t>(id & 0xFFU);
    out[15] = ticks;
    return out;
}

Bytes message(std::uint8_t flags, std::uint8_t command, std::uint16_t request, const Bytes& body) {
    Bytes out{0x42,
              flags,
              0,
              command,
              0,
              static_cast<std::uint8_t>(body.size()),
              static_cast<std::uint8_t>(request >> 8U),
              static_cast<std::uint8_t>(request & 0xFFU)};
    out.insert(out.end(), body.begin(), body.end());
    return out;
}

std::vector<std::uint32_t> sequences(const std::vector<std::uint16_t>& requests) {
    InputEdges input(0x9011, 0x9012);
    std::vector<std::uint32_t> out;
    for (const std::uint16_t request : requests) {
        for (const InputEdges::Edge& edge :
             input.take(*parse_gvcp_message(message(0, 0xC0, request, event(0x9011, 1)))))
            out.push_back(edge.sequence);
    }
    return out;
}

TEST(GvcpMessage, of_events_is_read_and_answered) {
    Bytes body = event(0x9011, 7);
    const Bytes second = event(0x9012, 9);
    body.insert(body.end(), second.begin(), second.end());
    const auto read = parse_gvcp_message(message(0x01, 0xC0, 0x1234, body));
    ASSERT_TRUE(read);
    EXPECT_TRUE(read->wants_answer);
    ASSERT_EQ(read->events.size(), 2U);
    EXPECT_EQ(read->events[0].id, 0x9011);
    EXPECT_EQ(read->events[0].ticks, 7U);
    EXPECT_EQ(read->events[1].id, 0x9012);
    EXPECT_EQ(gvcp_answer(*read), (std::array<std::uint8_t, 8>{0, 0, 0, 0xC1, 0, 0, 0x12, 0x34}));
}

TEST(GvcpMessage, with_block_ids_of_64_bits_has_longer_events) {
    Bytes body(24, 0);
    body[2] = 0x90;
    body[3] = 0x11;
    body[16] = 0x80;  // the highest byte of the time
    const auto read = parse_gvcp_message(message(0x10, 0xC0, 1, body));
    ASSERT_TRUE(read);
    EXPECT_EQ(read->events[0].ticks, 1ULL << 63U);
}

TEST(GvcpMessage, of_an_event_with_data_is_that_event) {
    Bytes body = event(0x9011, 7);
    body.insert(body.end(), {1, 2, 3, 4, 5});
    const auto read = parse_gvcp_message(message(0x01, 0xC2, 3, body));
    ASSERT_TRUE(read);
    ASSERT_EQ(read->events.size(), 1U);
    EXPECT_EQ(read->events[0].ticks, 7U);
    EXPECT_EQ(gvcp_answer(*read)[3], 0xC3);
}

TEST(GvcpMessage, that_is_malformed_or_another_is_none) {
    const Bytes good = message(0x01, 0xC0, 1, event(0x9011, 7));
    for (std::size_t size = 0; size < good.size(); ++size)
        EXPECT_FALSE(parse_gvcp_message(std::span(good).first(size))) << size;
    const auto with = [&](std::size_t at, std::uint8_t value) {
        Bytes changed = good;
        changed[at] = value;
        return parse_gvcp_message(changed).has_value();
    };
    EXPECT_TRUE(with(1, 0x00));
    EXPECT_FALSE(with(0, 0x43)) << "key";
    EXPECT_FALSE(with(1, 0x11)) << "too short for 64 bits";
    EXPECT_FALSE(with(3, 0x81)) << "command";
    EXPECT_FALSE(with(5, 15)) << "length";
    EXPECT_FALSE(with(7, 0)) << "request 0";
    Bytes longer = message(0x01, 0xC0, 1, Bytes(20, 0));
    EXPECT_FALSE(parse_gvcp_message(longer)) << "no whole number of events";
}

TEST(InputEdges, count_and_skip_what_was_lost) {
    EXPECT_EQ(sequences({7, 8, 9}), (std::vector<std::uint32_t>{1, 2, 3}));
    EXPECT_EQ(sequences({65534, 65535, 1, 2}), (std::vector<std::uint32_t>{1, 2, 3, 4}));
    EXPECT_EQ(sequences({7, 9, 10}), (std::vector<std::uint32_t>{1, 3, 4})) << "8 was lost";
    EXPECT_EQ(sequences({7, 7, 8, 8}), (std::vector<std::uint32_t>{1, 2})) << "sent again";
    EXPECT_EQ(sequences({7, 9, 8, 10}), (std::vector<std::uint32_t>{1, 3, 4})) << "late: it counts as lost";
}

TEST(InputEdges, are_those_of_its_own_events) {
    InputEdges input(0x9011, 0x9012);
    EXPECT_TRUE(input.take(*parse_gvcp_message(message(0, 0xC0, 1, event(0x9001, 1)))).empty());
    const auto edges = input.take(*parse_gvcp_message(message(0, 0xC0, 2, event(0x9012, 5))));
    ASSERT_EQ(edges.size(), 1U);
    EXPECT_FALSE(edges[0].active);
    EXPECT_EQ(edges[0].sequence, 1U);
    EXPECT_EQ(edges[0].ticks, 5U);
}

}  // namespace
}  // namespace hord::drivers
