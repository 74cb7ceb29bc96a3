// Parts that touch, or cover the part sensor for too long: literal scenarios.
#include "tests/firmware/core/running.h"

namespace hord::firmware {
namespace {

TEST_F(Running, a_part_that_covers_the_sensor_for_too_long_hides_another_and_stops_the_line) {
    CoreConfig config = quick_line();
    config.max_part = milliseconds(30);
    CoreRig touching{config};
    touching.bring_to(State::continuous_execution);
    const auto edge = [&](hal::PartEdge::Kind kind) {
        touching.send(hal::PartEdge{kind, touching.now, ++touching.edges, {}});
    };
    edge(hal::PartEdge::Kind::arrives);
    touching.advance(milliseconds(20));
    edge(hal::PartEdge::Kind::leaves);
    touching.advance(milliseconds(50));
    EXPECT_FALSE(touching.shot().line_stop);
    edge(hal::PartEdge::Kind::arrives);
    touching.advance(milliseconds(29));
    EXPECT_FALSE(touching.shot().line_stop);
    touching.advance(milliseconds(2));
    EXPECT_TRUE(touching.shot().line_stop);
    EXPECT_EQ(touching.shot().counters.missed, 1U);
    edge(hal::PartEdge::Kind::leaves);
    EXPECT_EQ(touching.shot().counters.missed, 1U);
}

// A second arrival without an end of the first part is a ghost, or a part that touches: the sensor stays covered.
TEST_F(Running, an_arrival_on_a_covered_sensor_does_not_hide_that_it_is_covered_for_too_long) {
    for (const std::uint32_t skipped : {0U, 1U}) {  // with 1, an edge in between was lost: this one is uncertain
        CoreConfig config = quick_line();
        config.max_part = milliseconds(30);
        CoreRig touching{config};
        touching.bring_to(State::continuous_execution);
        const auto edge = [&](hal::PartEdge::Kind kind) {
            touching.send(hal::PartEdge{kind, touching.now, ++touching.edges, {}});
        };
        edge(hal::PartEdge::Kind::arrives);
        touching.advance(milliseconds(20));
        edge(hal::PartEdge::Kind::leaves);
        touching.advance(milliseconds(50));
        edge(hal::PartEdge::Kind::arrives);
        touching.advance(milliseconds(25));
        touching.edges += skipped;
        edge(hal::PartEdge::Kind::arrives);
        touching.advance(milliseconds(skipped == 0 ? 5 : 30));
        EXPECT_FALSE(touching.shot().line_stop);
        touching.advance(Duration(1));
        EXPECT_TRUE(touching.shot().line_stop) << "covered for longer than any part takes";
    }
}

// A line on which parts may cover the part sensor for 30 ms. The first part has come and gone.
class Touching : public ::testing::Test {
  protected:
    explicit Touching(Duration max_part = milliseconds(30))
        : rig([&] {
              CoreConfig config = quick_line();
              config.max_part = max_part;
              return config;
          }()) {
        rig.bring_to(State::continuous_execution);
        edge(hal::PartEdge::Kind::arrives);
        rig.advance(milliseconds(20));
        edge(hal::PartEdge::Kind::leaves);
        EXPECT_TRUE(rig.advance_until_rejected(1));
        rig.confirmed(1);
        rig.advance(milliseconds(100));
        rig.forget();
    }
    void edge(hal::PartEdge::Kind kind, Duration told_late = {}) {
        rig.send(hal::PartEdge{kind, rig.now - told_late, ++rig.edges, {}});
    }
    CoreRig rig;
};

TEST_F(Touching, the_time_for_which_a_part_covers_the_sensor_begins_at_its_edge_however_late_it_is_told) {
    edge(hal::PartEdge::Kind::arrives, milliseconds(20));
    rig.advance(milliseconds(10));
    rig.send(Tick{});
    EXPECT_FALSE(rig.shot().line_stop);
    rig.advance(Duration(1));
    EXPECT_TRUE(rig.shot().line_stop);
}

TEST_F(Touching, an_edge_from_the_future_covers_the_sensor_from_now_on) {
    edge(hal::PartEdge::Kind::arrives, -milliseconds(20));
    rig.advance(milliseconds(30));
    EXPECT_FALSE(rig.shot().line_stop);
    rig.advance(Duration(1));
    EXPECT_TRUE(rig.shot().line_stop);
}

TEST_F(Touching, the_part_that_hides_another_is_unfit) {
    edge(hal::PartEdge::Kind::arrives);
    ASSERT_EQ(rig.shot().parts_on_line, 1U);
    rig.advance(milliseconds(30) + Duration(1));
    EXPECT_EQ(rig.core.line()[0].result.reason, PartReason::parts_too_close);
    EXPECT_NE(rig.shot().faults_active & kFaultPartSensor, 0U);
}

// A belt that stands keeps its part before the sensor for as long as it stands.
TEST_F(Touching, without_the_run_permit_a_covered_sensor_hides_nothing) {
    edge(hal::PartEdge::Kind::arrives);
    rig.send(DeviceLost{Device::rejector});
    rig.advance(milliseconds(100));
    EXPECT_EQ(rig.shot().counters.missed, 0U);
    EXPECT_EQ(rig.shot().faults_latched & kFaultPartSensor, 0U);
}

TEST_F(Touching, a_part_that_coasts_onto_the_sensor_and_stands_there_hides_nothing) {
    rig.send(DeviceLost{Device::rejector});
    rig.advance(milliseconds(20));
    edge(hal::PartEdge::Kind::arrives);
    EXPECT_EQ(rig.shot().line_stop_why.cause, LineStopCause::place_lost);
    rig.advance(std::chrono::seconds(1));
    EXPECT_EQ(rig.shot().counters.missed, 0U);
    EXPECT_EQ(rig.shot().faults_latched & kFaultPartSensor, 0U);
}

struct TouchingForLong : Touching {
    TouchingForLong() : Touching(milliseconds(500)) {}
};

TEST_F(TouchingForLong, a_part_that_stood_before_the_sensor_leaves_it_when_the_belt_runs_again) {
    rig.send(DeviceLost{Device::rejector});
    rig.send(DeviceUp{Device::rejector});
    edge(hal::PartEdge::Kind::arrives);
    rig.advance(milliseconds(300));
    ASSERT_EQ(rig.send(Command::reset), Answer::done);
    ASSERT_EQ(rig.send(Command::arm), Answer::done);
    ASSERT_EQ(rig.send(Command::start_continuous), Answer::done);
    rig.advance(milliseconds(300));
    edge(hal::PartEdge::Kind::leaves);
    EXPECT_FALSE(rig.shot().line_stop);
    EXPECT_EQ(rig.shot().counters.missed, 0U);
}

TEST_F(Touching, the_leaving_edge_itself_shows_that_the_part_was_too_long) {
    for (const Duration covered : {milliseconds(30), milliseconds(31)}) {
        edge(hal::PartEdge::Kind::arrives);
        rig.now += covered;  // the process is held up
        edge(hal::PartEdge::Kind::leaves);
        EXPECT_EQ(rig.shot().line_stop, covered > milliseconds(30));
    }
}

TEST_F(Touching, without_an_encoder_a_reading_counts_for_nothing) {
    edge(hal::PartEdge::Kind::arrives);
    rig.send(hal::EncoderReading{rig.now + std::chrono::seconds(1), 5});
    EXPECT_FALSE(rig.shot().line_stop);
}
TEST_F(Touching, of_two_edges_that_were_lost_one_is_a_part) {
    rig.edges += 2;
    edge(hal::PartEdge::Kind::arrives);
    EXPECT_EQ(rig.shot().counters.missed, 1U);
    EXPECT_TRUE(rig.shot().line_stop);
}

}  // namespace
}  // namespace hord::firmware
