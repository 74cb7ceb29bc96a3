// What edges with a count tell of a part: its place, its length, its distance from the one before.
#include <limits>

#include "tests/firmware/core/encoder_rig.h"

namespace hord::firmware {
namespace {

TEST_F(Encoder, parts_close_in_space_are_too_close_however_slow_the_conveyor) {
    rig.part_arrives();
    run(milliseconds(90), 2);  // the first part has no frame: unfit
    rig.advance(milliseconds(8));
    rig.part_arrives();  // 98 ms but only 180 counts after the first
    EXPECT_EQ(rig.exposures.size(), 1U);
    EXPECT_EQ(rig.shot().counters.unfit, 2U);
}

TEST_F(Encoder, the_count_of_an_edge_is_a_reading) {
    for (int k = 0; k < 4; ++k) {
        rig.advance(milliseconds(60));
        rig.counts += 600;
        rig.part_arrives();
    }
    EXPECT_FALSE(rig.shot().line_stop) << "the encoder is not silent";
}

TEST_F(Encoder, a_part_that_comes_without_the_run_permit_is_rejected_and_confirmed) {
    EXPECT_EQ(rig.send(Command::stop), Answer::done);
    EXPECT_EQ(rig.permits, std::vector<bool>{false});
    const auto part = rig.part_arrives();  // the belt coasts
    EXPECT_FALSE(rig.shot().line_stop);
    run(milliseconds(170), 10);
    ASSERT_TRUE(rig.rejected(part));
    rig.confirmed(part);
    run(milliseconds(30), 10);
    EXPECT_EQ(rig.only_result().reject, RejectState::confirmed);
    EXPECT_FALSE(rig.shot().line_stop);
}

TEST_F(Encoder, a_part_that_came_before_the_start_is_not_the_single_one_though_its_edge_is_told_after_it) {
    CoreRig one(with_encoder());
    one.bring_to(State::ready);
    one.belt(0);
    const TimePoint came = one.now;
    one.advance(Duration(1));
    one.send(Command::start_single);
    one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, came, ++one.edges, one.counts});
    EXPECT_EQ(one.core.line()[0].result.reason, PartReason::station_not_running);
    EXPECT_FALSE(one.shot().line_stop);
    for (int k = 0; k < 10; ++k) {
        one.advance(milliseconds(10));
        one.belt(100);
    }
    EXPECT_EQ(one.part_arrives(), 2U);
    EXPECT_TRUE(one.core.line()[1].accepted) << "the single part is the next one";
}

TEST_F(Encoder, a_part_as_far_behind_as_the_least_gap_is_not_too_close) {
    rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.belt(100);
    rig.advance(milliseconds(10));
    rig.belt(100);  // 20 ms and 200 counts
    rig.part_arrives();
    EXPECT_EQ(rig.exposures.size(), 2U);
    rig.advance(milliseconds(20));
    rig.belt(199);
    rig.part_arrives();
    EXPECT_EQ(rig.core.line()[2].result.reason, PartReason::parts_too_close);
}

// With these counts the distance for which a part covers the sensor is known even where an edge has none.
TEST_F(Encoder, an_edge_without_a_possible_count_covers_no_distance) {
    CoreConfig config = with_encoder();
    config.max_part_counts = 300;
    for (const auto count : {std::optional<std::int64_t>{}, {std::numeric_limits<std::int64_t>::max()}}) {
        CoreRig one(config);
        one.bring_to(State::continuous_execution);
        one.belt(0);
        one.advance(milliseconds(10));
        one.belt(100);
        for (int k = 0; k < 2; ++k) {
            for (const auto kind : {hal::PartEdge::Kind::arrives, hal::PartEdge::Kind::leaves}) {
                one.send(hal::PartEdge{kind, one.now, ++one.edges, count});
                one.advance(milliseconds(20));
                one.belt(200);
            }
        }
        EXPECT_EQ(one.shot().counters.missed, 0U);
        EXPECT_FALSE(one.shot().line_stop);
    }
}

// The leaving edge of the part ahead was lost: the sensor was not covered for as long as it seems.
TEST_F(Encoder, an_uncertain_arrival_begins_a_distance_of_its_own) {
    CoreConfig config = with_encoder();
    config.max_part_counts = 300;
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    one.belt(0);
    const auto edge = [&](hal::PartEdge::Kind kind) {
        one.send(hal::PartEdge{kind, one.now, ++one.edges, one.counts});
    };
    const auto moves = [&] {
        one.advance(milliseconds(30));
        one.counts += 300;
    };
    edge(hal::PartEdge::Kind::arrives);
    moves();
    edge(hal::PartEdge::Kind::leaves);
    moves();
    edge(hal::PartEdge::Kind::arrives);
    moves();
    moves();
    ++one.edges;
    edge(hal::PartEdge::Kind::arrives);
    EXPECT_FALSE(one.shot().line_stop);
    moves();
    one.belt(0);
    EXPECT_FALSE(one.shot().line_stop);
}

// The covered distance counts, not the time; 0: not checked.
TEST_F(Encoder, parts_that_cover_the_sensor_for_too_many_counts_touch) {
    for (const std::int64_t most : {0, 300}) {
        CoreConfig config = with_encoder();
        config.max_part_counts = most;
        CoreRig one(config);
        one.bring_to(State::continuous_execution);
        one.belt(0);
        const auto edge = [&](hal::PartEdge::Kind kind) {
            one.send(hal::PartEdge{kind, one.now, ++one.edges, one.counts});
        };
        const auto moves = [&](std::int64_t counts) {
            one.advance(milliseconds(10));
            one.belt(counts);
        };
        edge(hal::PartEdge::Kind::arrives);
        moves(100);
        edge(hal::PartEdge::Kind::leaves);
        moves(300);
        edge(hal::PartEdge::Kind::arrives);
        moves(0);
        moves(300);
        EXPECT_FALSE(one.shot().line_stop);
        moves(1);
        EXPECT_EQ(one.shot().line_stop, most != 0);
        EXPECT_EQ((one.shot().faults_active & kFaultPartSensor) != 0, most != 0);
        moves(1000);
        EXPECT_EQ(one.shot().counters.missed, most != 0 ? 1U : 0U) << "once";
    }
}

// The part that covered it when it was lost is forgotten with its place.
TEST_F(Encoder, a_part_sensor_that_is_back_is_not_covered_by_a_part_of_before) {
    CoreConfig config = with_encoder();
    config.max_part_counts = 300;
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    one.belt(0);
    for (const auto kind : {hal::PartEdge::Kind::arrives, hal::PartEdge::Kind::leaves, hal::PartEdge::Kind::arrives}) {
        one.send(hal::PartEdge{kind, one.now, ++one.edges, one.counts});
        one.advance(milliseconds(10));
        one.belt(100);
    }
    one.send(DeviceLost{Device::part_sensor});
    one.advance(kMinLineStop);
    ASSERT_EQ(one.send(Command::reset), Answer::done);
    one.send(DeviceUp{Device::part_sensor});
    const std::uint32_t missed = one.shot().counters.missed;
    for (int k = 0; k < 10; ++k) {
        one.advance(milliseconds(10));
        one.belt(100);
    }
    EXPECT_EQ(one.shot().counters.missed, missed);
    EXPECT_FALSE(one.shot().line_stop);
}

TEST_F(Encoder, a_part_without_a_count_is_rejected_where_it_must_be) {
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 1, {}});
    run(milliseconds(160), 10);
    ASSERT_TRUE(rig.rejected(1));
    rig.confirmed(1);
    run(milliseconds(40), 10);
    EXPECT_EQ(rig.only_result().reason, PartReason::edge_lost);
    EXPECT_EQ(rig.only_result().reject, RejectState::confirmed);
}

TEST_F(Encoder, an_impossible_count_is_no_count) {
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 1, std::numeric_limits<std::int64_t>::max()});
    EXPECT_EQ(rig.shot().counters.unfit, 1U);
    rig.send(hal::EncoderReading{rig.now + milliseconds(1), std::numeric_limits<std::int64_t>::min()});
    run(milliseconds(160), 10);
    EXPECT_TRUE(rig.rejected(1));
}

}  // namespace
}  // namespace hord::firmware
