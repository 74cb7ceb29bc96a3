// An edge node with a store and a broker in virtual time. Payloads are read back by decode_command(), which
// payload_test.cpp compares with protoc.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/mqtt/edge_node.h"

namespace hord::firmware::mqtt::test {

constexpr UtcMs kNow = 1'790'000'000'000;

inline store::StoredResult result(std::int64_t number) {
    store::StoredResult made;
    made.number = number;
    made.time_us = kNow * 1000 + number;
    made.part = static_cast<std::uint32_t>(number);
    made.verdict = "pass";
    made.defects = "[]";
    return made;
}

// Decodes any payload. A birth exceeds the size limit of decode_command(), so each field is decoded by itself.
inline Payload read(const std::string& bytes) {
    Payload all;
    std::string_view left = bytes;
    while (!left.empty()) {
        // Finds the end of the next field.
        std::size_t size = 1, body = 0;
        const bool metric = left[0] == '\x12';
        unsigned shift = 0;
        while (true) {
            const auto byte = static_cast<unsigned char>(left[size++]);
            body |= static_cast<std::size_t>(byte & 0x7FU) << shift;
            shift += 7;
            if (byte < 0x80) break;
        }
        if (metric) size += body;
        const auto part = decode_command(left.substr(0, size));
        EXPECT_TRUE(part);
        if (part->time_ms) all.time_ms = part->time_ms;
        if (part->seq) all.seq = part->seq;
        for (const Metric& m : part->metrics) all.metrics.push_back(m);
        left.remove_prefix(size);
    }
    return all;
}

inline const Metric* find(const Payload& payload, const std::string& name) {
    for (const Metric& m : payload.metrics) {
        if (m.name == name) return &m;
    }
    return nullptr;
}
inline std::int64_t number_of(const Payload& payload) {
    for (const Metric& m : payload.metrics) {
        if (m.alias == kResultAlias) return static_cast<std::int64_t>(std::get<std::uint64_t>(m.value));
    }
    return 0;
}
inline std::uint64_t bd_seq_of(const std::string& bytes) {
    const Payload payload = read(bytes);
    return std::get<std::uint64_t>(find(payload, "bdSeq")->value);
}

inline std::string rebirth() {
    Payload payload;
    Metric m;
    m.name = "Node Control/Rebirth";
    m.type = DataType::boolean;
    m.value = true;
    payload.metrics = {m};
    return encode(payload);
}

inline NodeOptions options() {
    NodeOptions made;
    made.group = "g";
    made.node = "n";
    made.in_flight = 4;
    made.repeat = 0;
    made.history_per_s = 0;
    made.begin_with_all = true;
    return made;
}

// A node whose store holds the results `first` to `newest`, and a broker controlled by the test.
struct World {
    explicit World(NodeOptions o = options(), Cursor cursor = {}) : node(std::move(o), std::move(cursor)) {}
    EdgeNode node;
    std::int64_t first = 1, newest = 0;
    UtcMs now = kNow;
    std::vector<std::uint64_t> waiting;  // tokens without an answer
    std::vector<std::int64_t> arrived;   // result numbers in the order sent
    // Of `arrived`: results without an answer, each with the token that answers it (0: the next fence), and results
    // that a subscriber received.
    std::vector<std::pair<std::uint64_t, std::int64_t>> under_way;
    std::vector<std::int64_t> delivered;
    std::vector<Outgoing> sent;

    void connect() {
        will = node.begin_session(now);
        node.connected(now);
    }
    void offer() {
        const auto demand = node.demand(now);
        if (!demand) return;
        std::vector<store::StoredResult> some;
        for (std::int64_t k = std::max(demand->after + 1, first); k <= newest && some.size() < demand->count; ++k)
            some.push_back(result(k));
        node.offer(some, newest, now);
    }
    void carry() {
        for (Outgoing& message : node.take_outgoing()) {
            if (message.token != 0) waiting.push_back(message.token);
            for (auto& [token, number] : under_way) {
                if (message.fence && token == 0) token = message.token;
            }
            if (!message.fence && message.topic.find("NDATA") != std::string::npos) {
                if (const auto number = number_of(read(message.payload)); number != 0) {
                    arrived.push_back(number);
                    under_way.emplace_back(message.token, number);
                }
            }
            sent.push_back(std::move(message));
        }
    }
    void answer(bool heard = true) {
        if (heard) deliver(under_way.size());
        under_way.clear();
        for (const std::uint64_t token : std::exchange(waiting, {})) node.confirmed(token, heard, now);
    }
    void deliver(std::size_t count) {
        for (std::size_t k = 0; k < count; ++k) delivered.push_back(under_way[k].second);
        under_way.erase(under_way.begin(), under_way.begin() + static_cast<std::ptrdiff_t>(count));
    }
    // Answers only the oldest token.
    void answer_first() {
        if (waiting.empty()) return;
        const std::uint64_t token = waiting.front();
        waiting.erase(waiting.begin());
        while (!under_way.empty() && under_way.front().first == token) deliver(1);
        node.confirmed(token, true, now);
    }
    // Delivers the first `through` results under way, loses the others, and answers none.
    void lose_connection(std::size_t through) {
        deliver(std::min(through, under_way.size()));
        under_way.clear();
        waiting.clear();
        node.disconnected();
    }
    void run(int rounds) {
        for (int k = 0; k < rounds; ++k) {
            offer();
            carry();
            answer();
        }
    }
    Outgoing will;
};

}  // namespace hord::firmware::mqtt::test
