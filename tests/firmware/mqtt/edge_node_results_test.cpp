// The edge node hands over results: each at least once, in order, whatever fails.
#include <random>
#include <set>

#include "tests/firmware/mqtt/edge_node_world.h"

namespace hord::firmware::mqtt::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

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
    world.node.confirmed(12345, true, kNow);  // an unknown token
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
    EXPECT_FALSE(read(world.sent.back().payload).metrics[0].historical);  // stored while the node was connected
}

// Broker, network and process fail at random, and some messages under way are lost. Every result is delivered, and the
// node never has more than `in_flight` results open.
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
        for (int life = 0; life < 20; ++life) {  // one run of the process
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
                    case 2: world.answer(false); break;  // there is no subscriber
                    case 3: on_disk = world.node.cursor(); break;
                    case 4: world.answer_first(); break;
                    default: world.answer();
                }
            }
            newest = world.newest;
            delivered.insert(delivered.end(), world.delivered.begin(),
                             world.delivered.end());  // messages under way at the kill are lost
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

}  // namespace
}  // namespace hord::firmware::mqtt::test
