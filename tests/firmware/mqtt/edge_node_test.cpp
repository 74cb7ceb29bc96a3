// The edge node as a broker and its hosts see it: sessions, the station's metrics, commands.
#include <set>

#include <fmt/format.h>

#include "tests/firmware/mqtt/edge_node_world.h"

namespace hord::firmware::mqtt::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

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
    for (const char* name :
         {"Result/Verdict", "Result/Bounded", "Station/Online", "Station/COUNTERS/seen", "Station/HEALTH/latency_p99"})
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
    EXPECT_THAT(data.metrics, SizeIs(19));
    for (const Metric& m : data.metrics) {
        EXPECT_TRUE(m.name.empty());
        EXPECT_TRUE(declared.contains(m.alias.value()));
        EXPECT_EQ(m.time_ms, kNow);  // the time of the result
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
    EXPECT_EQ(out[0].qos, 1);  // the QoS of results: a broker may reorder messages of different QoS
    const Payload data = read(out[0].payload);
    ASSERT_THAT(data.metrics, SizeIs(2));
    EXPECT_EQ(data.metrics[0].alias, kNodeAlias + 4);  // the station is reached now
    EXPECT_EQ(data.metrics[1].alias, 142U);
    EXPECT_EQ(data.metrics[1].value, MetricValue(std::uint64_t{7}));
    world.node.set_readings(readings, kNow + 2000);
    EXPECT_THAT(world.node.take_outgoing(), IsEmpty());
    world.node.set_readings({}, kNow + 3000);  // not reached: the value is unknown, the old one is dropped
    EXPECT_EQ(read(world.node.take_outgoing()[0].payload).metrics[1].value, MetricValue());
}

// -- messages from hosts

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
    world.node.step(world.now + 1000);  // one birth answers all these requests
    world.node.step(world.now + 3000);
    world.carry();
    EXPECT_THAT(world.sent, SizeIs(3));
    EXPECT_EQ(world.node.refused(), 0U);
}

TEST(EdgeNode, refuses_and_counts_every_other_command) {
    const auto command = [](const std::vector<std::pair<std::string, MetricValue>>& writes,
                            DataType type = DataType::none) {
        Payload payload;
        for (const auto& [name, value] : writes) {
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
        EXPECT_EQ(world.node.refused(), ++refused);
        EXPECT_THAT(world.node.trouble(), HasSubstr("refused"));
    }
    world.node.message("spBv1.0/g/NCMD/other", rebirth(), world.now);
    EXPECT_EQ(world.node.refused(), ++refused);
    world.node.message("spBv1.0/g/NCMD/n", rebirth(), world.now, true);  // retained: repeated for ever
    EXPECT_EQ(world.node.refused(), ++refused);
    world.node.step(world.now + 5000);
    EXPECT_THAT(world.node.take_outgoing(), IsEmpty());
    world.node.set_readings({}, world.now);
    EXPECT_EQ(read(world.node.take_outgoing()[0].payload).metrics[0].value,
              MetricValue(refused));  // the count of refused commands
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
    EXPECT_EQ(world.node.refused(), 5U);
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

    // A forged time in the far future does not make the host's next state too old.
    state("{\"online\":false,\"timestamp\":9223372036854775807}");
    EXPECT_TRUE(world.node.wants_to_leave());
    world.newest = 7;
    world.node.disconnected();
    world.connect();
    state(fmt::format("{{\"online\":true,\"timestamp\":{}}}", world.now).c_str());
    world.run(2);
    EXPECT_EQ(world.arrived.back(), 7);
}

TEST(EdgeNodeResults, of_a_damaged_row_say_so) {
    store::StoredResult row;
    EXPECT_EQ(result_metrics(&row, "s", false).back().value, MetricValue(std::string()));
    row.damage = "column part is no INTEGER";
    EXPECT_EQ(result_metrics(&row, "s", false).back().value, MetricValue(row.damage));
    EXPECT_EQ(result_metrics(nullptr, "", false).back().name, "Result/Damage");
}

}  // namespace
}  // namespace hord::firmware::mqtt::test
