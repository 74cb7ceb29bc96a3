// The edge node as a broker and its hosts see it, in virtual time: sessions, results, commands. Payloads are read back
// by decode_command(), which payload_test.cpp compares with protoc.
#include "firmware/mqtt/edge_node.h"

#include <map>
#include <random>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::firmware::mqtt::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr UtcMs kNow = 1'790'000'000'000;

store::StoredResult result(std::int64_t number) {
    store::StoredResult made;
    made.number = number;
    made.time_us = kNow * 1000 + number;
    made.part = static_cast<std::uint32_t>(number);
    made.verdict = "pass";
    made.defects = "[]";
    return made;
}

// Births are larger than commands may be: read here, a metric at a time.
Payload read(const std::string& bytes) {
    Payload all;
    std::string_view left = bytes;
    while (!left.empty()) {
        // Fields of a payload one by one, so that decode_command() takes them.
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

const Metric* find(const Payload& payload, const std::string& name) {
    for (const Metric& m : payload.metrics) {
        if (m.name == name) return &m;
    }
    return nullptr;
}
std::int64_t number_of(const Payload& payload) {
    for (const Metric& m : payload.metrics) {
        if (m.alias == kResultAlias) return static_cast<std::int64_t>(std::get<std::uint64_t>(m.value));
    }
    return 0;
}
std::uint64_t bd_seq_of(const std::string& bytes) {
    const Payload payload = read(bytes);
    return std::get<std::uint64_t>(find(payload, "bdSeq")->value);
}

std::string rebirth() {
    Payload payload;
    Metric m;
    m.name = "Node Control/Rebirth";
    m.type = DataType::boolean;
    m.value = true;
    payload.metrics = {m};
    return encode(payload);
}

NodeOptions options() {
    NodeOptions made;
    made.group = "g";
    made.node = "n";
    made.in_flight = 4;
    made.repeat = 0;
    made.history_per_s = 0;
    made.begin_with_all = true;
    return made;
}

// A node with a store of so many results, and a broker that can be told what to do.
struct World {
    explicit World(NodeOptions o = options(), Cursor cursor = {}) : node(std::move(o), std::move(cursor)) {}
    EdgeNode node;
    std::int64_t first = 1, newest = 0;
    UtcMs now = kNow;
    std::vector<std::uint64_t> waiting;  // tokens without an answer
    std::vector<std::int64_t> arrived;   // numbers, as the node sent them
    // Of these: not answered yet (each with the token that answers it; 0: the next fence), and what came to somebody
    // who listens.
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
    // One answer, and no more.
    void answer_first() {
        if (waiting.empty()) return;
        const std::uint64_t token = waiting.front();
        waiting.erase(waiting.begin());
        while (!under_way.empty() && under_way.front().first == token) deliver(1);
        node.confirmed(token, true, now);
    }
    // Of what is under way some first ones come through, and no answer comes back.
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

TEST(EdgeNode, is_born_with_every_metric_and_dies_with_the_same_bdSeq) {
    World world;
    world.connect();
    EXPECT_EQ(world.will.topic, "spBv1.0/g/NDEATH/n");
    EXPECT_EQ(world.will.qos, 1);
    const Payload death = read(world.will.payload);
    EXPECT_FALSE(death.seq);
    ASSERT_THAT(death.metrics, SizeIs(1));
    EXPECT_EQ(bd_seq_of(world.will.payload), 0U);

    const auto out = world.node.take_outgoing();
    ASSERT_THAT(out, SizeIs(1));
    EXPECT_EQ(out[0].topic, "spBv1.0/g/NBIRTH/n");
    EXPECT_EQ(out[0].qos, 1);
    const Payload birth = read(out[0].payload);
    EXPECT_EQ(birth.seq, 0);
    EXPECT_EQ(birth.time_ms, kNow);
    EXPECT_EQ(bd_seq_of(out[0].payload), 0U);
    std::set<std::uint64_t> aliases;
    std::set<std::string> names;
    for (const Metric& m : birth.metrics) {
        EXPECT_TRUE(names.insert(m.name).second) << m.name;
        EXPECT_EQ(m.time_ms, kNow) << m.name;
        EXPECT_NE(m.type, DataType::none) << m.name;
        if (m.alias) {
            EXPECT_TRUE(aliases.insert(*m.alias).second) << m.name;
        }
    }
    EXPECT_FALSE(find(birth, "Node Control/Rebirth")->alias);
    EXPECT_EQ(find(birth, "Node Control/Rebirth")->value, MetricValue(false));
    EXPECT_EQ(find(birth, "Station/STATUS/state")->alias, 102U);
    EXPECT_EQ(find(birth, "Result/Number")->alias, kResultAlias);
    for (const char* name : {"Result/Verdict", "Station/Online", "Station/COUNTERS/seen", "Station/HEALTH/latency_p99"})
        EXPECT_NE(find(birth, name), nullptr) << name;
    EXPECT_EQ(find(birth, "Station/STATUS/heartbeat"), nullptr);

    // The next session has the next bdSeq, over 255, too; its birth begins with seq 0 again.
    for (unsigned k = 1; k < 300; ++k) {
        world.connect();
        EXPECT_EQ(bd_seq_of(world.will.payload), k % 256);
        EXPECT_EQ(bd_seq_of(world.node.take_outgoing()[0].payload), k % 256);
    }
}

TEST(EdgeNode, counts_every_message_from_0_to_255_and_again) {
    World world;
    world.newest = 600;
    world.connect();
    world.node.use_store("s", 600);
    world.run(200);
    ASSERT_THAT(world.sent, SizeIs(601));
    for (std::size_t k = 0; k < world.sent.size(); ++k) EXPECT_EQ(read(world.sent[k].payload).seq, k % 256);
}

TEST(EdgeNode, names_nothing_after_its_birth_but_the_aliases_that_it_declared) {
    World world;
    world.newest = 1;
    world.connect();
    world.node.use_store("s", 1);
    world.run(1);
    std::set<std::uint64_t> declared;
    for (const Metric& m : read(world.sent[0].payload).metrics) {
        if (m.alias) declared.insert(*m.alias);
    }
    const Payload data = read(world.sent[1].payload);
    EXPECT_THAT(data.metrics, SizeIs(17));
    for (const Metric& m : data.metrics) {
        EXPECT_TRUE(m.name.empty());
        EXPECT_TRUE(declared.contains(m.alias.value()));
        EXPECT_EQ(m.time_ms, kNow);  // of the result
    }
}

TEST(EdgeNode, tells_of_the_station_only_what_changed) {
    World world;
    world.connect();
    world.carry();
    const Block& block = *find_block(BlockId::counters);
    std::vector<Reading> readings{{&block.registers[0], 7.0, "7"}, {&block.registers[1], std::nullopt, "-"}};
    world.node.set_readings(readings, kNow + 1000);
    auto out = world.node.take_outgoing();
    ASSERT_THAT(out, SizeIs(1));
    EXPECT_EQ(out[0].qos, 1);  // as results: of two QoS a broker would change the order
    const Payload data = read(out[0].payload);
    ASSERT_THAT(data.metrics, SizeIs(2));
    EXPECT_EQ(data.metrics[0].alias, kNodeAlias + 4);  // it is reached now
    EXPECT_EQ(data.metrics[1].alias, 142U);
    EXPECT_EQ(data.metrics[1].value, MetricValue(std::uint64_t{7}));
    world.node.set_readings(readings, kNow + 2000);
    EXPECT_THAT(world.node.take_outgoing(), IsEmpty());
    world.node.set_readings({}, kNow + 3000);  // not reached: unknown, not as before
    EXPECT_EQ(read(world.node.take_outgoing()[0].payload).metrics[1].value, MetricValue());
}

// -- results

TEST(EdgeNode, moves_its_cursor_only_over_what_is_confirmed_without_a_gap) {
    World world;
    world.newest = 10;
    world.connect();
    world.node.use_store("s", 10);
    world.offer();
    world.carry();
    EXPECT_THAT(world.arrived, ElementsAre(1, 2, 3, 4));  // four may be in flight
    EXPECT_FALSE(world.node.demand(kNow));
    world.node.confirmed(world.waiting[1], true, kNow);
    EXPECT_EQ(world.node.cursor().confirmed, 0);
    world.node.confirmed(world.waiting[0], true, kNow);
    EXPECT_EQ(world.node.cursor().confirmed, 2);
    EXPECT_EQ(world.node.demand(kNow)->after, 4);
    EXPECT_EQ(world.node.demand(kNow)->count, 2U);
    world.node.confirmed(12345, true, kNow);  // an answer that belongs to nothing
    EXPECT_EQ(world.node.cursor().confirmed, 2);
}

TEST(EdgeNode, publishes_again_what_a_lost_session_left_open_and_calls_it_historical) {
    World world;
    world.newest = 3;
    world.connect();
    world.node.use_store("s", 3);
    world.offer();
    world.carry();
    world.node.confirmed(world.waiting[0], true, kNow);
    world.node.disconnected();
    world.answer();  // too late: the session is over
    EXPECT_EQ(world.node.cursor().confirmed, 1);
    world.connect();
    world.sent.clear();
    world.offer();
    world.carry();
    EXPECT_THAT(world.arrived, ElementsAre(1, 2, 3, 2, 3));
    EXPECT_TRUE(read(world.sent[1].payload).metrics[0].historical);
    world.answer();
    world.newest = 4;
    world.offer();
    world.carry();
    EXPECT_EQ(number_of(read(world.sent.back().payload)), 4);
    EXPECT_FALSE(read(world.sent.back().payload).metrics[0].historical);  // came while it was connected
}

// Broker, network and process fail at random; what is under way then is lost in part: every number is delivered, and
// little is held.
TEST(EdgeNode, loses_nothing_over_random_failures) {
    for (unsigned seed = 1; seed <= 30; ++seed) {
        std::mt19937 random(seed);
        NodeOptions o = options();
        o.in_flight = 1 + random() % 8;
        o.repeat = static_cast<int>(random() % 5);
        o.qos = static_cast<int>(random() % 2);
        Cursor on_disk;
        std::vector<std::int64_t> delivered;
        std::int64_t newest = 0;
        for (int life = 0; life < 20; ++life) {  // of the process
            World world(o, on_disk);
            world.newest = newest;
            world.node.use_store("s", newest);
            for (int step = 0; step < 40; ++step) {
                world.now += random() % 50;
                if (random() % 3 == 0) world.newest += random() % 4;
                if (!world.node.born()) {
                    if (random() % 2 == 0) {
                        world.connect();
                        on_disk = world.node.cursor();
                    }
                    continue;
                }
                world.offer();
                world.carry();
                EXPECT_LE(world.node.open(), o.in_flight);
                switch (random() % 8) {
                    case 0: world.lose_connection(random() % 5); break;
                    case 1: world.node.message("spBv1.0/g/NCMD/n", rebirth(), world.now); break;
                    case 2: world.answer(false); break;  // nobody listens just now
                    case 3: on_disk = world.node.cursor(); break;
                    case 4: world.answer_first(); break;
                    default: world.answer();
                }
            }
            newest = world.newest;
            delivered.insert(delivered.end(), world.delivered.begin(),
                             world.delivered.end());  // what was under way when it was killed is not
        }
        World last(o, on_disk);
        last.newest = newest;
        last.node.use_store("s", newest);
        last.connect();
        last.run(static_cast<int>(newest) + 10);
        EXPECT_EQ(last.node.cursor().confirmed, newest);
        delivered.insert(delivered.end(), last.delivered.begin(), last.delivered.end());
        const std::set<std::int64_t> once(delivered.begin(), delivered.end());
        EXPECT_EQ(once.size(), static_cast<std::size_t>(newest)) << "seed " << seed;
    }
}

TEST(EdgeNode, repeats_the_last_results_after_every_birth_but_none_from_before_its_first_start) {
    NodeOptions o = options();
    o.repeat = 3;
    o.begin_with_all = false;
    World world(o);
    world.newest = 100;
    world.connect();
    world.node.use_store("s", 100);
    world.run(3);
    EXPECT_THAT(world.arrived, IsEmpty());
    world.newest = 105;
    world.run(5);
    EXPECT_THAT(world.arrived, ElementsAre(101, 102, 103, 104, 105));
    world.arrived.clear();
    world.now += 5000;
    world.node.message("spBv1.0/g/NCMD/n", rebirth(), world.now);
    world.run(3);
    EXPECT_THAT(world.arrived, ElementsAre(103, 104, 105));
    EXPECT_EQ(world.node.cursor().confirmed, 105);
    EXPECT_EQ(world.node.figures().repeats, 3U);
}

TEST(EdgeNode, keeps_results_while_nobody_listens_and_asks_with_one_at_a_time) {
    World world;
    world.newest = 10;
    world.connect();
    world.node.use_store("s", 10);
    world.offer();
    world.carry();
    world.answer(false);
    EXPECT_EQ(world.node.cursor().confirmed, 0);
    EXPECT_THAT(world.node.trouble(), HasSubstr("nobody who reads"));
    EXPECT_FALSE(world.node.demand(world.now));
    world.now += 2000;
    EXPECT_EQ(world.node.demand(world.now)->count, 1U);
    world.offer();
    world.carry();
    world.answer(false);
    world.now += 2000;
    world.run(20);
    EXPECT_EQ(world.node.cursor().confirmed, 10);
}

TEST(EdgeNode, with_qos_0_confirms_by_a_fence_behind_what_was_sent) {
    NodeOptions o = options();
    o.qos = 0;
    World world(o);
    world.newest = 6;
    world.connect();
    world.node.use_store("s", 6);
    world.offer();
    world.carry();
    ASSERT_THAT(world.sent, SizeIs(6));  // birth, four results, fence
    for (std::size_t k = 0; k < 5; ++k) EXPECT_EQ(world.sent[k].qos, 0);
    EXPECT_TRUE(world.sent.back().fence);
    EXPECT_EQ(world.sent.back().topic, "spBv1.0/g/NCMD/n");
    ASSERT_THAT(world.waiting, SizeIs(1));
    EXPECT_EQ(world.node.cursor().confirmed, 0);
    world.answer();
    EXPECT_EQ(world.node.cursor().confirmed, 4);
}

TEST(EdgeNode, counts_what_retention_removed_before_it_was_handed_over_once) {
    World world;
    world.newest = 20;
    world.first = 8;
    world.connect();
    world.node.use_store("s", 20);
    world.offer();
    world.carry();
    EXPECT_EQ(world.node.cursor().lost, 7U);
    EXPECT_THAT(world.node.trouble(), HasSubstr("results 1 to 7 were removed"));
    world.waiting.clear();
    world.connect();
    world.run(10);
    EXPECT_EQ(world.node.cursor().lost, 7U);
    EXPECT_EQ(world.node.cursor().confirmed, 20);
}

TEST(EdgeNode, begins_anew_with_another_store_and_notices_one_that_was_put_back) {
    World world;
    world.newest = 5;
    world.connect();
    world.node.use_store("s", 5);
    world.run(3);
    EXPECT_EQ(world.node.cursor().confirmed, 5);
    world.node.use_store("other", 2);
    world.newest = 2;
    world.run(2);
    EXPECT_EQ(world.node.cursor().store, "other");
    EXPECT_EQ(world.node.cursor().confirmed, 2);
    world.node.use_store("other", 1);
    EXPECT_THAT(world.node.trouble(), HasSubstr("put back to an older state"));
    EXPECT_EQ(world.node.cursor().confirmed, 1);
}

TEST(EdgeNode, sends_history_at_the_pace_that_it_is_given_and_new_results_at_once) {
    NodeOptions o = options();
    o.in_flight = 10;
    o.history_per_s = 100;
    World world(o);
    world.newest = 1000;
    world.connect();
    world.node.use_store("s", 1000);
    for (int ms = 0; ms < 1000; ms += 10) {
        world.now += 10;
        world.run(1);
    }
    EXPECT_LE(world.arrived.size(), 110U);  // ten at once, then a hundred a second
    EXPECT_GE(world.arrived.size(), 100U);
}

// -- what others say

TEST(EdgeNode, is_born_again_when_it_is_asked_with_the_same_bdSeq_and_at_most_once_a_second) {
    World world;
    world.connect();
    world.carry();
    world.now += 1000;
    world.node.message("spBv1.0/g/NCMD/n", rebirth(), world.now);
    world.carry();
    ASSERT_THAT(world.sent, SizeIs(2));
    EXPECT_EQ(world.sent[1].topic, "spBv1.0/g/NBIRTH/n");
    EXPECT_EQ(read(world.sent[1].payload).seq, 0);
    EXPECT_EQ(bd_seq_of(world.sent[1].payload), bd_seq_of(world.will.payload));
    for (int k = 0; k < 1000; ++k) world.node.message("spBv1.0/g/NCMD/n", rebirth(), world.now + 1);
    world.carry();
    EXPECT_THAT(world.sent, SizeIs(2));
    world.node.step(world.now + 1000);  // all of these share one
    world.node.step(world.now + 3000);
    world.carry();
    EXPECT_THAT(world.sent, SizeIs(3));
    EXPECT_EQ(world.node.figures().refused, 0U);
}

TEST(EdgeNode, refuses_and_counts_every_other_command) {
    const auto command = [](std::vector<std::pair<std::string, MetricValue>> writes, DataType type = DataType::none) {
        Payload payload;
        for (auto& [name, value] : writes) {
            Metric m;
            m.name = name;
            m.value = value;
            m.type = type;
            payload.metrics.push_back(m);
        }
        return encode(payload);
    };
    Payload by_alias;
    by_alias.metrics.resize(1);
    by_alias.metrics[0].alias = 102;
    by_alias.metrics[0].value = std::uint64_t{8};
    const std::vector<std::string> hostile{
        "",
        "garbage",
        std::string(5000, '\x12'),
        std::string(100, '\0'),
        "{\"online\":true}",
        encode(by_alias),
        command({{"Node Control/Reboot", true}}),
        command({{"node control/rebirth", true}}),
        command({{"Station/STATUS/state", std::uint64_t{8}}}),
        command({{"Node Control/Rebirth", false}}),
        command({{"Node Control/Rebirth", std::string("true")}}),
        command({{"Node Control/Rebirth", std::uint64_t{1}}}),
        command({{"Node Control/Rebirth", {}}}),
        command({{"Node Control/Rebirth", true}}, DataType::text),
        command({{"Node Control/Rebirth", true}, {"Station/STATUS/state", std::uint64_t{3}}}),
        command({{std::string(3000, 'x'), true}})};
    World world;
    world.connect();
    world.carry();
    world.now += 10'000;
    std::uint64_t refused = 0;
    for (const std::string& bytes : hostile) {
        world.node.message("spBv1.0/g/NCMD/n", bytes, world.now);
        EXPECT_EQ(world.node.figures().refused, ++refused);
        EXPECT_THAT(world.node.trouble(), HasSubstr("refused"));
    }
    world.node.message("spBv1.0/g/NCMD/other", rebirth(), world.now);
    EXPECT_EQ(world.node.figures().refused, ++refused);
    world.node.message("spBv1.0/g/NCMD/n", rebirth(), world.now, true);  // kept by the broker: it would ask for ever
    EXPECT_EQ(world.node.figures().refused, ++refused);
    world.node.step(world.now + 5000);
    EXPECT_THAT(world.node.take_outgoing(), IsEmpty());
    world.node.set_readings({}, world.now);
    EXPECT_EQ(read(world.node.take_outgoing()[0].payload).metrics[0].value,
              MetricValue(refused));  // and tells how many
}

TEST(EdgeNode, waits_for_its_primary_host_and_leaves_when_that_goes) {
    NodeOptions o = options();
    o.primary_host = "scada";
    World world(o);
    world.newest = 5;
    EXPECT_THAT(world.node.topics(), ElementsAre("spBv1.0/g/NCMD/n", "spBv1.0/STATE/scada"));
    world.connect();
    world.node.use_store("s", 5);
    world.run(3);
    EXPECT_THAT(world.sent, IsEmpty());
    const auto state = [&](const char* text) { world.node.message("spBv1.0/STATE/scada", text, world.now); };
    state("{\"online\":false,\"timestamp\":100}");
    for (const char* bad : {"ONLINE", "{\"online\":true}", "{\"online\":1,\"timestamp\":1}", "[]",
                            "{\"online\":true,\"timestamp\":\"x\"}"})
        state(bad);
    EXPECT_EQ(world.node.figures().refused, 5U);
    state("{\"online\":true,\"timestamp\":99}");  // older than what is known
    EXPECT_TRUE(world.node.waits_for_host());
    state("{\"online\":true,\"timestamp\":200}");
    EXPECT_TRUE(world.node.born());
    world.run(3);
    EXPECT_THAT(world.arrived, ElementsAre(1, 2, 3, 4, 5));
    EXPECT_TRUE(read(world.sent[1].payload).metrics[0].historical);
    state("{\"online\":false,\"timestamp\":150}");
    EXPECT_FALSE(world.node.wants_to_leave());
    state("{\"online\":false,\"timestamp\":200}");  // the host's own will has the time of its birth
    EXPECT_TRUE(world.node.wants_to_leave());
    const auto out = world.node.take_outgoing();
    ASSERT_THAT(out, SizeIs(1));
    EXPECT_EQ(out[0].topic, "spBv1.0/g/NDEATH/n");
    EXPECT_EQ(out[0].payload, world.will.payload);
    world.newest = 6;
    world.node.disconnected();
    world.connect();
    world.run(2);
    EXPECT_EQ(world.arrived.size(), 5U);
    state("{\"online\":true,\"timestamp\":300}");
    world.run(2);
    EXPECT_EQ(world.arrived.back(), 6);
}

}  // namespace
}  // namespace hord::firmware::mqtt::test
