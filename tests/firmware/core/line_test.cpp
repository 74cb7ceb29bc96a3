// Parts on the line, and what happens to them when the station stops: literal scenarios.
#include "tests/firmware/core/running.h"

namespace hord::firmware {
namespace {

using algo::Verdict;

TEST_F(Running, a_part_before_the_one_ahead_is_exposed_rejects_both) {
    const auto first = rig.part_arrives();
    rig.advance(milliseconds(3));
    const auto second = rig.part_arrives();
    EXPECT_EQ(rig.exposures.size(), 1U);
    rig.advance(milliseconds(160));
    EXPECT_TRUE(rig.rejected(first));
    EXPECT_TRUE(rig.rejected(second));
    rig.confirmed(first);
    rig.confirmed(second);
    ASSERT_EQ(rig.results.size(), 2U);
    EXPECT_EQ(rig.results[0].reason, PartReason::parts_too_close);
    EXPECT_EQ(rig.results[1].reason, PartReason::parts_too_close);
}

TEST_F(Running, a_part_too_close_behind_an_exposed_one_leaves_that_one_alone) {
    const auto first = rig.part_is_seen();  // exposed; 10 ms have passed
    const auto second = rig.part_arrives();
    rig.judged(first, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
    rig.results.clear();
    expect_fail_safe(second, PartReason::parts_too_close);
    EXPECT_FALSE(rig.rejected(first));
}

TEST_F(Running, an_edge_told_twice_is_one_part) {
    const hal::PartEdge edge{hal::PartEdge::Kind::arrives, rig.now, 1, {}};
    rig.send(edge);
    rig.send(edge);
    EXPECT_EQ(rig.shot().counters.seen, 1U);
}

TEST_F(Running, a_lost_arrival_stops_the_line_for_a_part_went_by_unseen) {
    rig.part_is_seen();
    rig.advance(milliseconds(90));
    ++rig.edges;
    rig.part_arrives();
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_EQ(rig.core.state(), State::error);
    EXPECT_EQ(rig.shot().counters.missed, 1U);
    EXPECT_NE(rig.shot().faults_active & kFaultPartSensor, 0U);
}

TEST_F(Running, a_lost_leaving_edge_makes_the_next_parts_identity_uncertain_and_no_more) {
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 1, {}});
    rig.advance(milliseconds(30));
    rig.send(hal::PartEdge{hal::PartEdge::Kind::leaves, rig.now, 2, {}});
    rig.advance(milliseconds(70));
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 3, {}});
    ASSERT_TRUE(rig.advance_until_rejected(1));
    rig.confirmed(1);
    rig.exposures.clear();
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 5, {}});  // number 4 was a "leaves" edge
    EXPECT_FALSE(rig.shot().line_stop);
    EXPECT_EQ(rig.shot().counters.missed, 0U);
    EXPECT_TRUE(rig.exposures.empty());
    expect_fail_safe(2, PartReason::frame_lost);
    expect_fail_safe(3, PartReason::edge_lost);
}

TEST_F(Running, a_lost_arrival_behind_an_edge_of_noise_stops_the_line) {
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 1, {}});
    rig.advance(milliseconds(30));
    rig.send(hal::PartEdge{hal::PartEdge::Kind::leaves, rig.now, 2, {}});
    rig.advance(milliseconds(5));
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 3, {}});  // no part
    rig.advance(milliseconds(60));
    ASSERT_FALSE(rig.shot().line_stop);
    rig.send(hal::PartEdge{hal::PartEdge::Kind::leaves, rig.now, 5, {}});  // number 4 was the arrival of its part
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_EQ(rig.core.state(), State::error);
    EXPECT_EQ(rig.shot().counters.missed, 1U);
}

TEST_F(Running, an_edge_from_the_future_or_before_the_last_one_is_no_part_to_be_trusted) {
    rig.part_is_seen();
    for (const Duration off : {Duration(1), milliseconds(-11)}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        one.advance(milliseconds(20));
        one.part_is_seen();
        one.exposures.clear();
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, one.now + off, ++one.edges, {}});
        EXPECT_TRUE(one.exposures.empty());
        EXPECT_EQ(one.core.line()[1].result.reason, PartReason::edge_lost);
        EXPECT_EQ(one.shot().counters.missed, 0U);
        EXPECT_LE(one.core.line()[1].arrived, one.now);
        EXPECT_FALSE(one.shot().line_stop);
    }
    CoreRig now;
    now.bring_to(State::continuous_execution);
    now.send(hal::PartEdge{hal::PartEdge::Kind::arrives, now.now, 1, {}});
    EXPECT_EQ(now.exposures.size(), 1U) << "an edge of this moment is in time";
}

TEST_F(Running, two_edges_of_one_moment_are_in_order) {
    rig.part_arrives();
    rig.part_arrives();
    EXPECT_EQ(rig.core.line()[1].result.reason, PartReason::parts_too_close) << "and not edge_lost";
}

TEST_F(Running, an_edge_told_too_late_to_expose_rejects) {
    rig.advance(milliseconds(10));
    hal::PartEdge edge{hal::PartEdge::Kind::arrives, rig.now - milliseconds(6), 1, {}};
    rig.send(edge);
    EXPECT_TRUE(rig.exposures.empty());
    EXPECT_NE(rig.shot().faults_active & kFaultOverrun, 0U);
    expect_fail_safe(1, PartReason::strobe_failed);
}

TEST_F(Running, an_edge_told_at_the_moment_of_its_exposure_is_in_time) {
    rig.advance(milliseconds(10));
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now - rig.core.config().exposure_delay, 1, {}});
    EXPECT_EQ(rig.exposures.size(), 1U);
    EXPECT_EQ(rig.core.line()[0].result.reason, PartReason::none);
}

TEST_F(Running, a_part_that_came_before_the_start_is_not_inspected_though_its_edge_is_told_after_it) {
    for (const Duration before_start : {Duration(1), Duration(0)}) {
        CoreRig one;
        one.bring_to(State::ready);
        one.forget();
        const TimePoint came = one.now;
        one.advance(before_start);
        one.send(Command::start_single);
        one.advance(microseconds(100));
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, came, ++one.edges, {}});
        const bool inspected = before_start == Duration(0);
        EXPECT_EQ(one.core.line()[0].accepted, inspected);
        EXPECT_EQ(one.exposures.size(), inspected ? 1U : 0U);
        EXPECT_EQ(one.core.line()[0].result.reason, inspected ? PartReason::none : PartReason::station_not_running);
        EXPECT_EQ(one.shot().line_stop, !inspected) << "the belt had no permit when it came";
        if (inspected) continue;
        EXPECT_TRUE(one.advance_until_rejected(1));
    }
}

// Minutes after a line stop, an edge comes that is as old as the stop.
TEST_F(Running, a_part_that_came_before_the_reset_of_a_line_stop_was_taken_off_though_its_edge_is_told_after_it) {
    for (const Duration after_reset : {Duration(-1), Duration(0)}) {
        CoreConfig config = quick_line();
        config.max_part = milliseconds(40);
        CoreRig one(config);
        one.bring_to(State::continuous_execution);
        one.send(hal::PartEdge{hal::PartEdge::Kind::leaves, one.now, ++one.edges, {}});
        one.send(Command::reset);  // the first edge was one that leaves: line stop
        ASSERT_TRUE(one.shot().line_stop);
        one.advance(std::chrono::minutes(3));
        ASSERT_EQ(one.send(Command::reset), Answer::done);
        const TimePoint reset = one.now;
        one.advance(milliseconds(50));
        one.send(Command::arm);
        one.send(Command::start_continuous);
        one.forget();
        one.advance(milliseconds(50));
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, reset + after_reset, ++one.edges, {}});
        if (after_reset >= Duration(0)) {
            EXPECT_EQ(one.core.line().size(), 1U);
            EXPECT_TRUE(one.advance_until_rejected(1));
            continue;
        }
        EXPECT_FALSE(one.shot().line_stop);
        EXPECT_EQ(one.core.state(), State::continuous_execution);
        EXPECT_NE(one.shot().faults_active & kFaultPartSensor, 0U);
        EXPECT_EQ(one.only_result().reason, PartReason::station_not_running);
        EXPECT_EQ(one.only_result().reject, RejectState::failed);
        EXPECT_EQ(one.shot().counters.seen, 1U);
        EXPECT_EQ(one.shot().counters.unfit, 1U);
        EXPECT_EQ(one.shot().counters.reject_failed, 1U);
        one.advance(milliseconds(100));
        EXPECT_FALSE(one.shot().line_stop) << "it does not cover the part sensor either";
        EXPECT_TRUE(one.rejects.empty());
        const std::uint32_t next = one.part_is_seen();
        one.judged(next, algo::Verdict::pass);
        ASSERT_EQ(one.results.size(), 2U);
        EXPECT_EQ(one.results[1].verdict, PartVerdict::pass);
    }
}

TEST_F(Running, more_parts_than_the_line_may_hold_are_rejected_and_tracked) {
    CoreConfig config = quick_line();
    config.transport = std::chrono::seconds(10);
    config.max_parts = 3;
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    for (int k = 0; k < 3; ++k) {
        one.judged(one.part_is_seen(), Verdict::pass);
        one.advance(milliseconds(90));
    }
    one.results.clear();
    one.exposures.clear();
    const auto fourth = one.part_arrives();
    EXPECT_TRUE(one.exposures.empty());
    EXPECT_EQ(one.shot().parts_on_line, 4U);
    ASSERT_TRUE(one.advance_until_rejected(fourth, std::chrono::seconds(10)));
    one.confirmed(fourth);
    EXPECT_EQ(one.rejects.size(), 1U);
    one.results.erase(one.results.begin(), one.results.end() - 1);
    EXPECT_EQ(one.only_result().reason, PartReason::line_full);
}

TEST_F(Running, beyond_the_lines_memory_the_line_stops) {
    CoreConfig config = quick_line();
    config.transport = std::chrono::seconds(3600);
    config.max_parts = kLineCapacity;
    config.max_failures_in_a_row = 0;
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    for (std::uint32_t k = 0; k < kLineCapacity; ++k) {
        one.part_arrives();
        one.advance(milliseconds(100));
    }
    EXPECT_FALSE(one.shot().line_stop);
    one.results.clear();
    const Counters before = one.shot().counters;
    one.part_arrives();
    EXPECT_EQ(one.shot().counters.unfit, before.unfit + 1);
    EXPECT_EQ(one.shot().counters.reject_commanded, before.reject_commanded + 1);
    EXPECT_EQ(one.shot().counters.reject_failed, before.reject_failed + 1);
    EXPECT_EQ(one.only_result().part, kLineCapacity + 1);
    EXPECT_EQ(one.only_result().reason, PartReason::line_full);
    EXPECT_EQ(one.only_result().reject, RejectState::failed);
    EXPECT_EQ(one.only_result().arrived_ns, one.now.time_since_epoch().count());
    EXPECT_TRUE(one.shot().line_stop);
}

TEST_F(Running, losing_the_sensor_rejects_those_that_wait_for_it_and_no_others) {
    const auto first = rig.part_is_seen();
    rig.advance(milliseconds(90));
    const auto second = rig.part_arrives();
    rig.send(DeviceLost{Device::sensor});
    rig.judged(first, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
    rig.results.clear();
    ASSERT_TRUE(rig.advance_until_rejected(second));
    rig.confirmed(second);
    EXPECT_EQ(rig.only_result().reason, PartReason::device_lost);
}

TEST_F(Running, losing_the_part_sensor_stops_the_line) {
    rig.send(DeviceLost{Device::part_sensor});
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_EQ(rig.core.state(), State::error);
}

TEST_F(Running, stop_lets_inspected_parts_finish_and_rejects_new_ones) {
    const auto first = rig.part_is_seen();
    rig.send(Command::stop);
    EXPECT_EQ(rig.core.state(), State::continuous_execution);
    rig.advance(milliseconds(90));
    const auto second = rig.part_arrives();
    EXPECT_EQ(rig.exposures.size(), 1U);
    rig.judged(first, Verdict::pass);
    EXPECT_EQ(rig.core.state(), State::continuous_execution);
    rig.advance(milliseconds(95));  // the first is past the ejector 195 ms after its edge
    EXPECT_EQ(rig.core.state(), State::ready);
    EXPECT_TRUE(rig.shot().run_permit) << "the line runs until it is empty";
    rig.results.clear();
    expect_fail_safe(second, PartReason::station_not_running);
    rig.advance(milliseconds(50));
    EXPECT_EQ(rig.permits, std::vector<bool>{false});
    EXPECT_FALSE(rig.shot().line_stop);
}

TEST_F(Running, abort_rejects_what_is_under_way) {
    const auto part = rig.part_is_seen();
    rig.send(Command::abort);
    EXPECT_EQ(rig.core.state(), State::ready);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.shot().counters.inspected, 0U);
    expect_fail_safe(part, PartReason::station_not_running);
}

TEST(Single, inspects_one_part_rejects_the_next_and_is_ready_when_the_one_is_through) {
    CoreRig rig;
    rig.bring_to(State::single_execution);
    const auto first = rig.part_is_seen();
    rig.judged(first, Verdict::pass);
    rig.advance(milliseconds(90));
    const auto second = rig.part_arrives();
    EXPECT_EQ(rig.exposures.size(), 1U);
    EXPECT_EQ(rig.core.state(), State::single_execution);
    rig.advance(milliseconds(95));
    EXPECT_EQ(rig.core.state(), State::ready);
    rig.results.clear();
    ASSERT_TRUE(rig.advance_until_rejected(second));
    rig.confirmed(second);
    EXPECT_EQ(rig.only_result().reason, PartReason::station_not_running);
}

TEST_F(Running, an_edge_with_the_number_of_the_last_one_or_of_long_ago_hides_no_part) {
    for (const std::uint32_t step : {0U, 1U << 31, (1U << 31) + 1, 0U - 1U}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        one.part_arrives();
        one.advance(milliseconds(100));
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, one.now, one.edges + step, {}});
        EXPECT_EQ(one.core.line()[1].result.reason, PartReason::edge_lost) << step;
        EXPECT_EQ(one.shot().counters.missed, 0U) << step;
        EXPECT_FALSE(one.shot().line_stop) << step;
    }
}

TEST_F(Running, a_part_as_far_behind_as_the_least_gap_is_not_too_close) {
    for (const Duration gap : {rig.core.config().min_gap, rig.core.config().min_gap - Duration(1)}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        one.part_arrives();
        one.advance(gap);
        one.part_arrives();
        EXPECT_EQ(one.core.line()[1].result.reason,
                  gap == one.core.config().min_gap ? PartReason::none : PartReason::parts_too_close);
    }
}

TEST_F(Running, the_part_ahead_is_safe_once_its_exposure_is_over) {
    const CoreConfig& config = rig.core.config();
    for (const Duration before : {Duration(0), Duration(1), config.exposure}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        one.part_arrives();
        one.advance(config.exposure_delay + config.exposure - before);
        one.part_arrives();
        EXPECT_EQ(one.core.line()[0].result.reason,
                  before == Duration(0) ? PartReason::none : PartReason::parts_too_close);
    }
}

TEST_F(Running, a_part_whose_edge_is_uncertain_is_rejected_by_the_time_of_its_edge) {
    rig.part_is_seen();
    rig.advance(milliseconds(100));
    rig.edges += 1;
    const TimePoint edge = rig.now - milliseconds(10);
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, edge, ++rig.edges, {}});
    ASSERT_TRUE(rig.advance_until_rejected(2));
    EXPECT_EQ(rig.rejects.back().start, edge + kPulseStart);
}

TEST_F(Running, a_good_part_is_on_the_line_until_a_pulse_could_not_hit_it_any_more) {
    const TimePoint edge = rig.now;
    rig.judged(rig.part_is_seen(), Verdict::pass);
    const CoreConfig& config = rig.core.config();
    rig.advance(edge + config.transport + config.reject_pulse - Duration(1) - rig.now);
    EXPECT_EQ(rig.shot().parts_on_line, 1U);
    rig.advance(Duration(1));
    EXPECT_EQ(rig.shot().parts_on_line, 0U);
}

TEST_F(Running, a_part_that_was_at_the_sensor_when_it_came_up_stops_the_line) {
    rig.send(hal::PartEdge{hal::PartEdge::Kind::leaves, rig.now, 1, {}});
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_NE(rig.shot().faults_active & kFaultPartSensor, 0U);
    EXPECT_EQ(rig.shot().counters.missed, 1U);
}

TEST(LineUnknown, stops_the_line_until_a_reset) {
    CoreRig rig;
    rig.send(LineUnknown{});
    EXPECT_EQ(rig.core.state(), State::error);
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_EQ(rig.shot().line_stop_why.cause, LineStopCause::line_unknown);
    EXPECT_EQ(rig.shot().faults_latched, std::uint32_t{kFaultRejectUnconfirmed});
    EXPECT_NE(rig.shot().first_fault, 0);
    rig.advance(kMinLineStop);
    EXPECT_EQ(rig.send(Command::reset), Answer::done);
    EXPECT_FALSE(rig.shot().line_stop);
    EXPECT_EQ(rig.shot().line_stop_why, LineStop{});
    EXPECT_EQ(rig.core.state(), State::initialized);
    EXPECT_EQ(rig.starts.size(), 4U);
    rig.devices_up();
    EXPECT_EQ(rig.send(Command::arm), Answer::done);
}

}  // namespace
}  // namespace hord::firmware
