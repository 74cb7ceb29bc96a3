// A part's way through the core, as literal stories: what happens when, to the millisecond.
#include "tests/firmware/core/core_rig.h"

namespace hord::firmware {
namespace {

using algo::Reason;
using algo::Verdict;

class Running : public ::testing::Test {
  protected:
    Running() { rig.bring_to(State::continuous_execution); }

    // The part gets no valid verdict and is rejected, for this reason.
    void expect_fail_safe(std::uint32_t part, PartReason reason) {
        ASSERT_TRUE(rig.advance_until_rejected(part));
        rig.confirmed(part);
        for (const PartResult& r : rig.results) {
            if (r.part != part) continue;
            EXPECT_EQ(r.verdict, PartVerdict::unfit);
            EXPECT_EQ(r.reason, reason) << name_of(r.reason);
            EXPECT_EQ(r.reject, RejectState::confirmed);
            return;
        }
        ADD_FAILURE() << "no result for part " << part;
    }

    CoreRig rig;
};

TEST_F(Running, a_good_part_is_exposed_judged_and_let_go) {
    const TimePoint edge = rig.now;
    const auto part = rig.part_arrives();
    ASSERT_EQ(rig.exposures.size(), 1U);
    ASSERT_EQ(rig.pulses.size(), 1U);
    EXPECT_EQ(rig.exposures[0].start, edge + milliseconds(5));
    EXPECT_EQ(rig.exposures[0].length, microseconds(500));
    EXPECT_EQ(rig.pulses[0].start, edge + microseconds(5100));
    EXPECT_EQ(rig.pulses[0].width, microseconds(200));
    rig.advance(milliseconds(10));
    rig.light_comes(part);
    rig.frame_comes(part);
    ASSERT_EQ(rig.inspections.size(), 1U);
    EXPECT_EQ(rig.inspections[0].part, part);
    rig.advance(milliseconds(20));
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
    EXPECT_EQ(rig.only_result().reject, RejectState::not_needed);
    EXPECT_EQ(rig.only_result().latency_us, 30'000U);
    EXPECT_EQ(rig.shot().parts_on_line, 1U);
    rig.advance(milliseconds(500));
    EXPECT_EQ(rig.shot().parts_on_line, 0U);
    EXPECT_TRUE(rig.rejects.empty());
    EXPECT_EQ(rig.core.state(), State::continuous_execution);
}

TEST_F(Running, a_bad_part_is_ejected_when_it_is_there) {
    const TimePoint edge = rig.now;
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::deflection);
    EXPECT_TRUE(rig.rejects.empty());
    rig.now = edge + kDeadline - milliseconds(1);
    rig.send(Tick{});
    EXPECT_TRUE(rig.rejects.empty());
    rig.advance(milliseconds(1));
    ASSERT_EQ(rig.rejects.size(), 1U);
    EXPECT_EQ(rig.rejects[0].part, part);
    EXPECT_EQ(rig.rejects[0].start, edge + kPulseStart);
    EXPECT_EQ(rig.rejects[0].width, milliseconds(15));
    rig.advance(milliseconds(21));
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().reason, PartReason::deflection);
    EXPECT_EQ(rig.only_result().reject, RejectState::confirmed);
    EXPECT_EQ(rig.only_result().reject_latency_us, 176'000U);
    EXPECT_EQ(rig.only_result().defects, 2);
    EXPECT_FALSE(rig.shot().line_stop);
}

TEST_F(Running, a_verdict_that_comes_at_the_deadline_is_late) {
    const TimePoint edge = rig.now;
    const auto part = rig.part_is_seen();
    rig.now = edge + kDeadline;  // the judgement is carried in before the tick
    rig.judged(part, Verdict::pass);
    ASSERT_EQ(rig.rejects.size(), 1U);
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().reason, PartReason::verdict_late);
    EXPECT_EQ(rig.shot().counters.pass, 0U);
    EXPECT_NE(rig.shot().faults_latched & kFaultOverrun, 0U);
}

TEST_F(Running, a_verdict_just_before_the_deadline_counts) {
    const TimePoint edge = rig.now;
    const auto part = rig.part_is_seen();
    rig.now = edge + kDeadline - Duration(1);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
}

TEST_F(Running, a_verdict_after_the_deadline_changes_nothing) {
    const auto part = rig.part_is_seen();
    rig.advance(milliseconds(150));
    rig.judged(part, Verdict::pass);
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().reason, PartReason::verdict_late);
    EXPECT_EQ(rig.shot().counters.pass, 0U);
}

TEST_F(Running, a_second_judgement_of_the_same_part_is_ignored) {
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::slope);
    rig.judged(part, Verdict::pass);
    rig.advance(milliseconds(150));
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::reject);
}

TEST_F(Running, without_a_frame_the_part_is_rejected) {
    const auto part = rig.part_arrives();
    rig.light_comes(part);
    expect_fail_safe(part, PartReason::frame_lost);
    EXPECT_EQ(rig.shot().counters.inspected, 0U);
}

TEST_F(Running, without_a_strobe_report_a_good_judgement_does_not_count) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.frame_comes(part);
    rig.judged(part, Verdict::pass);
    EXPECT_TRUE(rig.results.empty());
    expect_fail_safe(part, PartReason::strobe_failed);
}

TEST_F(Running, light_and_judgement_may_come_in_any_order) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.frame_comes(part);
    rig.judged(part, Verdict::pass);
    rig.light_comes(part);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
}

TEST_F(Running, light_at_the_wrong_time_or_of_the_wrong_length_does_not_count) {
    struct Wrong {
        bool lit;
        Duration shift, width;
    };
    for (const Wrong& wrong : {Wrong{false, {}, microseconds(200)}, Wrong{true, microseconds(101), microseconds(200)},
                               Wrong{true, microseconds(-101), microseconds(200)}, Wrong{true, {}, microseconds(99)},
                               Wrong{true, {}, microseconds(301)}}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const auto part = one.part_arrives();
        one.advance(milliseconds(10));
        one.frame_comes(part);
        one.judged(part, Verdict::pass);
        one.send(hal::StrobeReport{part, wrong.lit, one.exposure_of(part).start + microseconds(100) + wrong.shift, wrong.width});
        one.advance(milliseconds(150));
        one.confirmed(part);
        EXPECT_EQ(one.only_result().reason, PartReason::strobe_failed);
    }
}

TEST_F(Running, a_stale_frame_is_nobodys_and_the_own_frame_still_counts) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.light_comes(part);
    rig.frame_comes_at(rig.exposure_of(part).start - milliseconds(3));
    EXPECT_EQ(rig.released.size(), 1U);
    EXPECT_TRUE(rig.inspections.empty());
    rig.frame_comes(part);
    ASSERT_EQ(rig.inspections.size(), 1U);
    EXPECT_EQ(rig.inspections[0].frame, 2U);
}

TEST_F(Running, a_stale_frame_alone_is_the_reason) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.light_comes(part);
    rig.frame_comes_at(rig.exposure_of(part).start - milliseconds(100));
    expect_fail_safe(part, PartReason::frame_stale);
}

TEST_F(Running, the_same_frame_again_is_a_duplicate_not_the_next_parts_frame) {
    const auto first = rig.part_is_seen();
    rig.judged(first, Verdict::pass);
    rig.advance(milliseconds(90));
    const auto second = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.light_comes(second);
    // The device repeats its frame under a fresh time stamp, but with the old count.
    rig.send(FrameArrived{9, {rig.frame_sequence, rig.exposure_of(second).start, 1000, false}});
    EXPECT_EQ(rig.released, std::vector<FrameHandle>{9});
    rig.results.clear();
    expect_fail_safe(second, PartReason::frame_duplicate);
}

TEST_F(Running, short_and_corrupt_frames_reject_at_once) {
    for (const bool corrupt : {false, true}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const auto part = one.part_arrives();
        one.advance(milliseconds(10));
        one.send(FrameArrived{1, {1, one.exposure_of(part).start, corrupt ? 1000U : 999U, corrupt}});
        EXPECT_EQ(one.released.size(), 1U);
        EXPECT_EQ(one.shot().counters.unfit, 1U);
        one.advance(milliseconds(150));
        one.confirmed(part);
        EXPECT_EQ(one.only_result().reason, corrupt ? PartReason::frame_corrupt : PartReason::frame_short);
    }
}

TEST_F(Running, a_frame_that_comes_after_its_parts_time_is_not_the_next_parts) {
    const auto first = rig.part_arrives();
    rig.advance(milliseconds(60));  // its frame is given up after 55.5 ms
    const auto second = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.light_comes(second);
    rig.frame_comes(first);
    EXPECT_EQ(rig.released.size(), 1U);
    EXPECT_TRUE(rig.inspections.empty());
    rig.frame_comes(second);
    ASSERT_EQ(rig.inspections.size(), 1U);
    EXPECT_EQ(rig.inspections[0].part, second);
}

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
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 5, {}});  // 4 was "leaves"
    EXPECT_FALSE(rig.shot().line_stop);
    EXPECT_EQ(rig.shot().counters.missed, 0U);
    EXPECT_TRUE(rig.exposures.empty());
    expect_fail_safe(2, PartReason::frame_lost);
    expect_fail_safe(3, PartReason::edge_lost);
}

TEST_F(Running, a_frame_from_the_device_that_refused_its_trigger_is_not_awaited) {
    const auto part = rig.part_arrives();
    rig.send(TriggerRefused{part});
    EXPECT_EQ(rig.shot().counters.unfit, 1U);
    expect_fail_safe(part, PartReason::frame_lost);
}

TEST_F(Running, a_refused_strobe_rejects) {
    const auto part = rig.part_arrives();
    rig.send(StrobeRefused{part});
    expect_fail_safe(part, PartReason::strobe_failed);
}

TEST_F(Running, a_full_or_failing_inspector_rejects) {
    const auto first = rig.part_is_seen();
    rig.send(InspectRefused{first});
    rig.advance(milliseconds(90));
    const auto second = rig.part_is_seen();
    rig.send(Judged{second, true, Verdict::pass, Reason::none, 0, 0});
    expect_fail_safe(first, PartReason::inspector_failed);
    expect_fail_safe(second, PartReason::inspector_failed);
}

TEST_F(Running, an_edge_told_too_late_to_expose_rejects) {
    hal::PartEdge edge{hal::PartEdge::Kind::arrives, rig.now - milliseconds(6), 1, {}};
    rig.send(edge);
    EXPECT_TRUE(rig.exposures.empty());
    expect_fail_safe(1, PartReason::strobe_failed);
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
    one.part_arrives();
    EXPECT_EQ(one.only_result().reason, PartReason::line_full);
    EXPECT_EQ(one.only_result().reject, RejectState::failed);
    EXPECT_TRUE(one.shot().line_stop);
}

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
        EXPECT_EQ(one.core.state(), State::error) << story.what;
        EXPECT_EQ(one.permits, std::vector<bool>{false}) << story.what;
        EXPECT_EQ(one.only_result().reject, story.state) << story.what;
        EXPECT_NE(one.shot().faults_active & kFaultRejectUnconfirmed, 0U) << story.what;
        one.send(Command::reset);
        EXPECT_FALSE(one.shot().line_stop) << story.what;
    }
}

TEST_F(Running, a_confirmation_after_the_pulse_is_late) {
    const TimePoint edge = rig.now;
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::slope);
    rig.now = edge + kPulseEnd + Duration(1);
    rig.send(Tick{});  // the loop was held up: the command itself is too late
    EXPECT_FALSE(rig.rejected(part));
    EXPECT_EQ(rig.only_result().reject, RejectState::late);
    EXPECT_TRUE(rig.shot().line_stop);
}

TEST_F(Running, a_command_after_the_part_is_at_the_ejector_is_given_and_counted_late) {
    const TimePoint edge = rig.now;
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::slope);
    rig.now = edge + milliseconds(181);
    rig.send(Tick{});
    EXPECT_TRUE(rig.rejected(part));
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().reject, RejectState::late);
    EXPECT_TRUE(rig.shot().line_stop);
}

TEST_F(Running, with_the_rejector_down_bad_parts_stop_the_line) {
    const auto part = rig.part_is_seen();
    rig.send(DeviceLost{Device::rejector});
    EXPECT_EQ(rig.core.state(), State::error);
    rig.judged(part, Verdict::reject, Reason::slope);
    rig.advance(milliseconds(150));
    EXPECT_FALSE(rig.rejected(part));
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_TRUE(rig.shot().line_stop);
}

// The permit dropped with the link: the line may have stopped, and nobody can say that the pulse met the part.
TEST_F(Running, a_rejector_that_is_back_before_the_deadline_is_commanded_and_not_trusted) {
    const auto part = rig.part_is_seen();
    rig.send(DeviceLost{Device::rejector});
    rig.judged(part, Verdict::reject, Reason::slope);
    rig.send(DeviceUp{Device::rejector});
    rig.advance(milliseconds(150));
    EXPECT_TRUE(rig.rejected(part));
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_TRUE(rig.shot().line_stop);
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

TEST_F(Running, the_same_trouble_part_after_part_is_an_error) {
    for (int k = 0; k < 5; ++k) {
        EXPECT_EQ(rig.core.state(), State::continuous_execution) << k;
        const auto part = rig.part_is_seen();
        rig.judged(part, Verdict::unfit, Reason::too_dark);
        rig.advance(milliseconds(150));
        rig.confirmed(part);
    }
    EXPECT_EQ(rig.core.state(), State::error);
    EXPECT_EQ(rig.shot().first_fault, 9);  // kFaultLightLevel is bit 8
    EXPECT_FALSE(rig.shot().run_permit);
}

TEST_F(Running, one_good_judgement_clears_passing_trouble) {
    auto part = rig.part_is_seen();
    rig.judged(part, Verdict::unfit, Reason::too_dark);
    EXPECT_EQ(rig.shot().faults_active, std::uint32_t{kFaultLightLevel});
    rig.advance(milliseconds(150));
    rig.confirmed(part);
    part = rig.part_is_seen();
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.shot().faults_active, 0U);
    EXPECT_EQ(rig.shot().faults_latched, std::uint32_t{kFaultLightLevel});
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

// Without an encoder nobody knows where parts come to rest once the line stops.
TEST_F(Running, an_error_stops_the_line_and_no_rejection_counts_from_then_on) {
    const auto first = rig.part_is_seen();
    rig.judged(first, Verdict::reject, Reason::slope);
    rig.advance(milliseconds(50));
    const auto second = rig.part_is_seen();
    rig.judged(second, Verdict::pass);
    rig.send(DeviceLost{Device::strobe});
    EXPECT_EQ(rig.permits, std::vector<bool>{false});
    EXPECT_TRUE(rig.shot().line_stop);
    ASSERT_TRUE(rig.advance_until_rejected(first));  // the line may not have obeyed
    rig.confirmed(first);
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_EQ(rig.shot().counters.reject_failed, 1U);
    EXPECT_EQ(rig.shot().counters.pass, 1U);
}

TEST_F(Running, a_reset_ends_the_story_of_parts_whose_place_was_lost) {
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::slope);
    rig.send(DeviceLost{Device::strobe});
    rig.send(Command::reset);
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_FALSE(rig.shot().line_stop);
    rig.advance(milliseconds(500));
    EXPECT_FALSE(rig.rejected(part)) << "its pulse would hit another part of the line that runs again";
}

TEST_F(Running, arming_waits_until_the_ejector_rests) {
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::slope);
    ASSERT_TRUE(rig.advance_until_rejected(part));
    rig.send(DeviceLost{Device::strobe});
    rig.send(DeviceUp{Device::strobe});
    rig.send(Command::reset);
    EXPECT_EQ(rig.send(Command::arm), Answer::pulse_under_way);
    rig.advance(milliseconds(35));  // lead and pulse
    EXPECT_EQ(rig.send(Command::arm), Answer::done);
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

TEST_F(Running, abort_rejects_what_is_under_way) {
    const auto part = rig.part_is_seen();
    rig.send(Command::abort);
    EXPECT_EQ(rig.core.state(), State::ready);
    rig.judged(part, Verdict::pass);
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

TEST(NotRunning, parts_are_rejected_and_counted_where_the_rejector_is_up) {
    for (const State state : {State::initialized, State::ready}) {
        CoreRig rig;
        rig.bring_to(state);
        const auto part = rig.part_arrives();
        EXPECT_TRUE(rig.exposures.empty());
        rig.advance(milliseconds(156));
        ASSERT_TRUE(rig.rejected(part)) << name_of(state);
        rig.confirmed(part);
        EXPECT_EQ(rig.only_result().reason, PartReason::station_not_running);
        EXPECT_EQ(rig.shot().counters.reject_confirmed, 1U);
        EXPECT_FALSE(rig.shot().line_stop);
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
