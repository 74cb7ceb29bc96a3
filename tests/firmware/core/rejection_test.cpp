// At the ejector: confirmations, lost positions and line stop: literal scenarios.
#include "tests/firmware/core/running.h"

namespace hord::firmware {
namespace {

using algo::Reason;
using algo::Verdict;

TEST_F(Running, an_unconfirmed_rejection_stops_the_line) {
    using Outcome = hal::RejectReport::Outcome;
    struct Story {
        const char* what;
        int report;  // Outcome, or -1: none, or -2: refused
        RejectState state;
    };
    for (const Story& story : {Story{"silent", -1, RejectState::failed}, Story{"refused", -2, RejectState::failed},
                               Story{"failed", static_cast<int>(Outcome::failed), RejectState::failed},
                               Story{"late", static_cast<int>(Outcome::late), RejectState::late}}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const auto part = one.part_is_seen();
        one.judged(part, Verdict::reject, Reason::absorption);
        one.advance(milliseconds(150));
        ASSERT_TRUE(one.rejected(part));
        EXPECT_FALSE(one.shot().line_stop) << story.what;
        if (story.report == -2) one.send(RejectRefused{part});
        if (story.report >= 0) one.send(hal::RejectReport{part, static_cast<Outcome>(story.report), one.now});
        one.advance(milliseconds(200));
        EXPECT_TRUE(one.shot().line_stop) << story.what;
        EXPECT_EQ(
            one.shot().line_stop_why,
            (LineStop{story.state == RejectState::late ? LineStopCause::reject_late : LineStopCause::reject_failed,
                      part}))
            << story.what;
        EXPECT_EQ(one.core.state(), State::error) << story.what;
        EXPECT_EQ(one.permits, std::vector<bool>{false}) << story.what;
        EXPECT_EQ(one.only_result().reject, story.state) << story.what;
        EXPECT_NE(one.shot().faults_active & kFaultRejectUnconfirmed, 0U) << story.what;
        one.advance(kMinLineStop);
        one.send(Command::reset);
        EXPECT_FALSE(one.shot().line_stop) << story.what;
    }
}

TEST_F(Running, a_refused_rejection_has_failed_at_once) {
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::absorption);
    rig.send(RejectRefused{part});
    EXPECT_TRUE(rig.results.empty()) << "nobody has asked for it yet";
    ASSERT_TRUE(rig.advance_until_rejected(part));
    rig.send(RejectRefused{part});
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_TRUE(rig.shot().line_stop);
}

TEST_F(Running, the_first_report_of_a_rejection_counts) {
    using Outcome = hal::RejectReport::Outcome;
    for (const Outcome first : {Outcome::failed, Outcome::late, Outcome::confirmed}) {
        CoreConfig config = quick_line();
        config.by_encoder = true;  // the part is awaited after the report
        CoreRig one(config);
        one.bring_to(State::continuous_execution);
        one.belt(0);
        one.advance(milliseconds(10));
        one.belt(100);
        const auto part = one.part_arrives();
        const auto run = [&](int steps) {
            for (int k = 0; k < steps; ++k) {
                one.advance(milliseconds(10));
                one.belt(100);
            }
        };
        run(1);
        one.light_comes(part);
        one.frame_comes(part);
        one.judged(part, Verdict::reject, Reason::deflection_gradient);
        run(15);
        ASSERT_TRUE(one.rejected(part));
        one.send(hal::RejectReport{part, first, one.now});
        one.send(hal::RejectReport{part, first == Outcome::confirmed ? Outcome::failed : Outcome::confirmed, one.now});
        run(3);
        EXPECT_EQ(one.only_result().reject,
                  first == Outcome::confirmed    ? RejectState::confirmed
                      : first == Outcome::failed ? RejectState::failed
                                                 : RejectState::late);
    }
}

TEST_F(Running, a_confirmation_after_the_pulse_is_late) {
    const TimePoint edge = rig.now;
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::deflection_gradient);
    rig.now = edge + kPulseEnd;
    rig.send(Tick{});  // the loop was held up: the command itself is too late
    EXPECT_FALSE(rig.rejected(part));
    EXPECT_EQ(rig.only_result().reject, RejectState::late);
    EXPECT_TRUE(rig.shot().line_stop);
}

// Within the pulse, but the ejector may have moved only after the part had passed.
TEST_F(Running, what_is_acknowledged_after_the_part_was_at_the_ejector_is_late) {
    for (const bool in_time : {true, false}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const TimePoint edge = one.now;
        const auto part = one.part_is_seen();
        one.judged(part, Verdict::reject, Reason::deflection_gradient);
        ASSERT_TRUE(one.advance_until_rejected(part));
        one.now = edge + one.core.config().transport + (in_time ? Duration(0) : Duration(1));
        ASSERT_LT(one.now, edge + kPulseEnd);
        one.confirmed(part);
        EXPECT_EQ(one.only_result().reject, in_time ? RejectState::confirmed : RejectState::late);
        EXPECT_EQ(one.shot().line_stop, !in_time);
        EXPECT_EQ(one.shot().counters.reject_late, in_time ? 0U : 1U);
    }
}

TEST_F(Running, a_command_after_the_part_is_at_the_ejector_is_given_and_counted_late) {
    for (const Duration late : {Duration(0), Duration(1)}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const TimePoint edge = one.now;
        const auto part = one.part_is_seen();
        one.judged(part, Verdict::reject, Reason::deflection_gradient);
        one.now = edge + one.core.config().transport + late;
        one.send(Tick{});
        EXPECT_TRUE(one.rejected(part));
        one.send(hal::RejectReport{part, hal::RejectReport::Outcome::confirmed, edge + one.core.config().transport});
        EXPECT_EQ(one.only_result().reject, late == Duration(0) ? RejectState::confirmed : RejectState::late);
        EXPECT_EQ(one.shot().line_stop, late != Duration(0));
    }
}

TEST_F(Running, with_the_rejector_down_bad_parts_stop_the_line) {
    const auto part = rig.part_is_seen();
    rig.send(DeviceLost{Device::rejector});
    EXPECT_EQ(rig.core.state(), State::error);
    rig.judged(part, Verdict::reject, Reason::deflection_gradient);
    rig.advance(milliseconds(150));
    EXPECT_FALSE(rig.rejected(part));
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_TRUE(rig.shot().line_stop);
}

// The permit dropped with the link: the line may have stopped, so the pulse may have missed the part.
TEST_F(Running, a_rejector_that_is_back_before_the_deadline_is_commanded_and_not_trusted) {
    const auto part = rig.part_is_seen();
    rig.send(DeviceLost{Device::rejector});
    rig.judged(part, Verdict::reject, Reason::deflection_gradient);
    rig.send(DeviceUp{Device::rejector});
    rig.advance(milliseconds(150));
    EXPECT_TRUE(rig.rejected(part));
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_TRUE(rig.shot().line_stop);
}

// Without an encoder the positions of parts are unknown once the line stops.
TEST_F(Running, an_error_stops_the_line_and_no_rejection_counts_from_then_on) {
    const auto first = rig.part_is_seen();
    rig.judged(first, Verdict::reject, Reason::deflection_gradient);
    rig.advance(milliseconds(50));
    const auto second = rig.part_is_seen();
    rig.judged(second, Verdict::pass);
    rig.send(DeviceLost{Device::strobe});
    EXPECT_EQ(rig.permits, std::vector<bool>{false});
    EXPECT_TRUE(rig.shot().line_stop);
    ASSERT_TRUE(rig.advance_until_rejected(first));  // the line may still be moving
    rig.confirmed(first);
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_EQ(rig.shot().counters.reject_failed, 1U);
    EXPECT_EQ(rig.shot().counters.pass, 1U);
}

TEST_F(Running, a_reset_ends_the_story_of_parts_whose_place_was_lost) {
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::deflection_gradient);
    rig.advance(milliseconds(10));
    rig.send(DeviceLost{Device::strobe});
    rig.advance(milliseconds(100));
    const auto last = rig.part_arrives();  // the conveyor runs down
    rig.advance(milliseconds(100));
    rig.confirmed(part);
    rig.forget();
    EXPECT_EQ(rig.send(Command::reset), Answer::done);
    EXPECT_EQ(rig.only_result().part, last);
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_FALSE(rig.shot().line_stop);
    rig.advance(milliseconds(500));
    EXPECT_FALSE(rig.rejected(last)) << "its pulse would hit another part of the line that runs again";
}

// The process was held up: a reset of before the line stop is read after it.
TEST_F(Running, a_reset_that_nobody_can_have_sent_for_this_line_stop_is_refused) {
    rig.part_is_seen();
    rig.send(DeviceLost{Device::part_sensor});
    rig.send(DeviceUp{Device::part_sensor});
    EXPECT_EQ(rig.send(Command::reset), Answer::not_yet);
    EXPECT_TRUE(rig.shot().line_stop);
    rig.advance(kMinLineStop - Duration(1));
    rig.send(LineUnknown{});  // again line stop: its time is that of the first
    EXPECT_EQ(rig.send(Command::reset), Answer::not_yet);
    EXPECT_EQ(rig.send(Command::halt), Answer::done);
    EXPECT_EQ(rig.send(Command::reset), Answer::not_yet);
    EXPECT_TRUE(rig.shot().line_stop);
    rig.advance(Duration(1));
    EXPECT_EQ(rig.send(Command::reset), Answer::done);
    EXPECT_FALSE(rig.shot().line_stop);
}

// Held up twice: before the line stop, and between it and the reset. The time of the clock says nothing then.
TEST_F(Running, a_line_stop_is_not_seen_while_the_process_is_held_up) {
    rig.send(LineUnknown{});
    rig.now += milliseconds(500);
    EXPECT_EQ(rig.send(Command::reset), Answer::not_yet);
    EXPECT_TRUE(rig.shot().line_stop);
    rig.advance(kMinLineStop - kMaxTurn - Duration(1));
    EXPECT_EQ(rig.send(Command::reset), Answer::not_yet);
    rig.advance(Duration(1));
    EXPECT_EQ(rig.send(Command::reset), Answer::done);
    EXPECT_FALSE(rig.shot().line_stop);
}

TEST_F(Running, the_core_wakes_when_a_reset_is_possible) {
    rig.send(LineUnknown{});
    const TimePoint start = rig.now;
    rig.advance(kMinLineStop - Duration(1));
    EXPECT_EQ(rig.core.next_wake(), start + kMinLineStop);
}

TEST_F(Running, a_line_stop_after_a_reset_is_to_be_seen_again) {
    for (int k = 0; k < 2; ++k) {
        rig.send(LineUnknown{});
        EXPECT_EQ(rig.send(Command::reset), Answer::not_yet);
        rig.advance(kMinLineStop);
        EXPECT_EQ(rig.send(Command::reset), Answer::done);
    }
}

TEST_F(Running, a_reset_without_line_stop_is_not_delayed) {
    rig.send(DeviceLost{Device::sensor});
    EXPECT_EQ(rig.core.state(), State::error);
    EXPECT_FALSE(rig.shot().line_stop);
    EXPECT_EQ(rig.send(Command::reset), Answer::done);
}

// 0 says that there was no rejection, 0xFFFFFFFF that the value is not available.
TEST_F(Running, the_latency_of_a_rejection_is_a_value_whatever_the_report_says) {
    const TimePoint arrived = rig.now;
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::deflection_gradient);
    ASSERT_TRUE(rig.advance_until_rejected(part));
    rig.send(hal::RejectReport{part, hal::RejectReport::Outcome::confirmed, arrived - milliseconds(1)});
    EXPECT_EQ(rig.only_result().reject_latency_us, 1U);

    CoreConfig config = quick_line();
    config.transport = std::chrono::hours(2);
    CoreRig far(config);
    far.bring_to(State::continuous_execution);
    const auto other = far.part_is_seen();
    far.judged(other, Verdict::reject, Reason::deflection_gradient);
    far.advance(std::chrono::hours(2) - milliseconds(20));
    ASSERT_TRUE(far.rejected(other));
    far.confirmed(other);
    EXPECT_EQ(far.only_result().reject, RejectState::confirmed);
    EXPECT_EQ(far.only_result().reject_latency_us, 0xFFFFFFFEU);
}

TEST_F(Running, arming_waits_until_the_ejector_rests) {
    CoreConfig config = quick_line();
    config.reject_pulse = milliseconds(300);
    config.min_gap = milliseconds(301);
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    const auto part = one.part_is_seen();
    one.judged(part, Verdict::reject, Reason::deflection_gradient);
    ASSERT_TRUE(one.advance_until_rejected(part));
    const TimePoint rests = one.rejects.front().start + config.reject_pulse;
    one.send(DeviceLost{Device::strobe});
    one.send(DeviceUp{Device::strobe});
    one.advance(kMinLineStop);
    EXPECT_EQ(one.send(Command::reset), Answer::done);
    EXPECT_EQ(one.send(Command::arm), Answer::not_yet);
    EXPECT_EQ(one.core.next_wake(), rests) << "who waits to arm hears of it";
    one.advance(rests - Duration(1) - one.now);
    EXPECT_EQ(one.send(Command::arm), Answer::not_yet);
    one.advance(Duration(1));
    EXPECT_EQ(one.send(Command::arm), Answer::done);
}

TEST_F(Running, a_part_before_the_camera_when_the_line_stops_is_not_judged_by_what_stands_there_later) {
    CoreConfig config = quick_line();
    config.exposure_delay = milliseconds(40);
    CoreRig far(config);
    far.bring_to(State::continuous_execution);
    far.part_arrives();
    far.advance(milliseconds(20));
    far.send(DeviceLost{Device::rejector});
    far.advance(milliseconds(100));
    EXPECT_TRUE(far.exposures.empty());
    EXPECT_EQ(far.shot().counters.unfit, 1U);
}

// A frame that was exposed while the belt ran shows its own part.
TEST_F(Running, a_part_whose_exposure_is_over_when_the_line_stops_is_judged_by_its_frame) {
    const CoreConfig& config = rig.core.config();
    for (const Duration before : {Duration(0), Duration(1), config.exposure}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const auto part = one.part_arrives();
        one.advance(config.exposure_delay + config.exposure - before);
        one.send(DeviceLost{Device::rejector});
        one.advance(milliseconds(2));
        one.light_comes(part);
        one.frame_comes(part);
        one.judged(part, Verdict::pass);
        EXPECT_EQ(one.core.line()[0].result.verdict, before == Duration(0) ? PartVerdict::pass : PartVerdict::unfit);
    }
}

TEST_F(Running, a_part_at_the_ejector_when_the_permit_falls_is_where_it_should_be) {
    for (const Duration before : {Duration(0), Duration(1)}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const TimePoint edge = one.now;
        const auto part = one.part_is_seen();
        one.judged(part, Verdict::reject, Reason::absorption);
        one.advance(edge + one.core.config().transport - before - one.now);
        ASSERT_TRUE(one.rejected(part));
        one.send(DeviceLost{Device::sensor});
        one.confirmed(part);
        EXPECT_EQ(one.only_result().reject, before == Duration(0) ? RejectState::confirmed : RejectState::failed);
    }
}

TEST_F(Running, a_good_part_on_its_way_needs_no_line_stop_when_the_permit_falls) {
    rig.judged(rig.part_is_seen(), Verdict::pass);
    rig.send(DeviceLost{Device::strobe});
    EXPECT_EQ(rig.permits, std::vector<bool>{false});
    EXPECT_FALSE(rig.shot().line_stop);
}

// More results than one step has room for.
TEST(Reset, ends_the_story_of_every_part_of_a_full_line_at_once) {
    CoreConfig config = quick_line();
    config.transport = std::chrono::hours(1);
    config.max_parts = 100;
    config.max_failures_in_a_row = 0;
    CoreRig rig(config);
    rig.bring_to(State::continuous_execution);
    for (std::uint32_t k = 0; k < config.max_parts; ++k) {
        rig.part_arrives();
        rig.advance(milliseconds(100));
    }
    rig.send(DeviceLost{Device::rejector});
    rig.advance(kMinLineStop);
    rig.forget();
    ASSERT_EQ(rig.send(Command::reset), Answer::done);
    EXPECT_EQ(rig.results.size(), config.max_parts);
    EXPECT_EQ(rig.shot().parts_on_line, config.max_parts) << "they may still be there";
}

TEST(Reset, gives_a_part_that_still_waits_its_verdict) {
    CoreConfig config = quick_line();
    config.transport = std::chrono::seconds(2);
    CoreRig rig(config);
    rig.bring_to(State::continuous_execution);
    rig.part_is_seen();
    rig.send(DeviceLost{Device::rejector});
    ASSERT_TRUE(rig.shot().line_stop);
    rig.advance(kMinLineStop);
    ASSERT_EQ(rig.shot().counters.unfit, 0U);
    ASSERT_EQ(rig.send(Command::reset), Answer::done);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::unfit);
    EXPECT_EQ(rig.only_result().reason, PartReason::station_not_running);
    EXPECT_EQ(rig.shot().counters.unfit, 1U);
}

TEST(NotRunning, parts_that_come_while_the_line_stops_are_commanded_and_keep_the_line_stopped) {
    CoreRig rig;
    rig.bring_to(State::error);
    const auto part = rig.part_arrives();
    ASSERT_TRUE(rig.advance_until_rejected(part));
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().reason, PartReason::station_not_running);
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_TRUE(rig.shot().line_stop);
}

// Before the permit falls, as it falls (the process was held up), and after it, on a belt that coasts: the belt may
// stand before the part is at the ejector.
TEST_F(Running, a_part_that_comes_about_the_withdrawal_of_the_permit_stops_the_line) {
    for (const Duration after : {Duration(-1), Duration(0), Duration(1), Duration(milliseconds(20))}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        EXPECT_EQ(one.send(Command::stop), Answer::done);
        EXPECT_EQ(one.permits, std::vector<bool>{false});
        const TimePoint edge = one.now + after;
        one.advance(std::max(Duration(1), after));
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, edge, ++one.edges, {}});
        EXPECT_TRUE(one.shot().line_stop);
        EXPECT_EQ(one.shot().line_stop_why, (LineStop{LineStopCause::place_lost, 1}));
        ASSERT_TRUE(one.advance_until_rejected(1)) << "the belt may run on";
        one.confirmed(1);
        EXPECT_EQ(one.only_result().reject, RejectState::failed);
    }
}

TEST_F(Running, a_part_that_comes_as_the_permit_is_given_keeps_its_place) {
    for (const bool before : {false, true}) {
        CoreRig one;
        one.bring_to(State::ready);
        one.advance(milliseconds(1));
        const TimePoint given = one.now;
        one.send(Command::start_continuous);
        one.advance(milliseconds(2));
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, given - Duration(before ? 1 : 0), ++one.edges, {}});
        EXPECT_EQ(one.shot().line_stop, before);
    }
}

TEST_F(Running, a_reset_ends_the_tracking_of_a_part_that_came_without_the_permit) {
    EXPECT_EQ(rig.send(Command::stop), Answer::done);
    rig.part_arrives();
    EXPECT_EQ(rig.core.state(), State::error);
    rig.advance(kMinLineStop);
    EXPECT_EQ(rig.send(Command::reset), Answer::done);
    rig.advance(milliseconds(200));
    EXPECT_EQ(rig.core.line().size(), 0U);
    EXPECT_FALSE(rig.shot().line_stop) << "a person has taken it off";
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
}

TEST(NotRunning, parts_are_rejected_and_counted_and_stop_the_line) {
    for (const State state : {State::initialized, State::ready}) {
        CoreRig rig;
        rig.bring_to(state);
        const auto part = rig.part_arrives();
        EXPECT_EQ(rig.core.state(), State::error) << name_of(state);
        EXPECT_TRUE(rig.exposures.empty());
        rig.advance(milliseconds(156));
        ASSERT_TRUE(rig.rejected(part)) << name_of(state);
        rig.confirmed(part);
        EXPECT_EQ(rig.only_result().reason, PartReason::station_not_running);
        EXPECT_EQ(rig.only_result().latency_us, 0U) << "decided at its edge";
        EXPECT_EQ(rig.shot().counters.reject_failed, 1U) << "nobody knows where it is";
    }
}

TEST(NotRunning, without_a_rejector_they_stop_the_line) {
    CoreRig rig;
    rig.send(Command::initialise);
    rig.send(DeviceUp{Device::part_sensor});
    rig.part_arrives();
    rig.advance(milliseconds(156));
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_EQ(rig.core.state(), State::error);
}

}  // namespace
}  // namespace hord::firmware
