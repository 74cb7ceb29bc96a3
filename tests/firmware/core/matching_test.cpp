// Exposure, light, frame and judgement of a part: literal scenarios, exact to the millisecond.
#include "tests/firmware/core/running.h"

namespace hord::firmware {
namespace {

using algo::Reason;
using algo::Verdict;

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
    EXPECT_EQ(rig.only_result().arrived_ns, edge.time_since_epoch().count());
    EXPECT_EQ(rig.shot().parts_on_line, 1U);
    rig.advance(milliseconds(500));
    EXPECT_EQ(rig.shot().parts_on_line, 0U);
    EXPECT_TRUE(rig.rejects.empty());
    EXPECT_EQ(rig.core.state(), State::continuous_execution);
}

TEST_F(Running, a_bad_part_is_ejected_when_it_is_there) {
    const TimePoint edge = rig.now;
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::neighbours_disagree);
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
    EXPECT_EQ(rig.only_result().reason, PartReason::neighbours_disagree);
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

TEST_F(Running, a_judgement_by_upper_bounds_is_a_result_that_says_so) {
    for (const bool bounded : {true, false}) {
        const std::uint32_t part = rig.part_is_seen();
        rig.send(Judged{.part = part, .verdict = Verdict::pass, .bounded = bounded});
        EXPECT_EQ(rig.shot().last.bounded, bounded);
        rig.advance(milliseconds(500));
    }
}

TEST_F(Running, what_was_judged_is_the_result) {
    const auto part = rig.part_is_seen();
    rig.send(Judged{.part = part,
                    .verdict = Verdict::reject,
                    .reason = Reason::absorption,
                    .defects = 3,
                    .score = 2.5F,
                    .position_m = 7,
                    .position_n = 8,
                    .recipe = 9});
    ASSERT_TRUE(rig.advance_until_rejected(part));
    rig.confirmed(part);
    const PartResult& r = rig.only_result();
    EXPECT_EQ(r.verdict, PartVerdict::reject);
    EXPECT_EQ(r.reason, PartReason::absorption);
    EXPECT_EQ(r.defects, 3);
    EXPECT_EQ(r.score, 2.5F);
    EXPECT_EQ(r.position_m, 7);
    EXPECT_EQ(r.position_n, 8);
    EXPECT_EQ(r.recipe, 9);
}

TEST_F(Running, the_first_of_two_judgements_counts_also_before_the_light_is_reported) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.frame_comes(part);
    rig.judged(part, Verdict::reject, Reason::absorption);
    rig.judged(part, Verdict::pass);
    rig.light_comes(part);
    EXPECT_EQ(rig.core.line()[0].result.verdict, PartVerdict::reject);
}

TEST_F(Running, a_second_judgement_of_the_same_part_is_ignored) {
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::reject, Reason::deflection_gradient);
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

TEST_F(Running, a_frame_is_waited_for_until_its_time_after_the_exposures_end_is_over) {
    const auto part = rig.part_arrives();
    rig.light_comes(part);
    const CoreConfig& config = rig.core.config();
    const TimePoint lost_at = rig.exposure_of(part).start + config.exposure + config.frame_timeout;
    rig.advance(lost_at - Duration(1) - rig.now);
    EXPECT_EQ(rig.shot().counters.unfit, 0U);
    rig.advance(Duration(1));
    EXPECT_EQ(rig.shot().counters.unfit, 1U);
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
        one.send(hal::StrobeReport{part, wrong.lit, one.exposure_of(part).start + microseconds(100) + wrong.shift,
                                   wrong.width});
        one.advance(milliseconds(150));
        one.confirmed(part);
        EXPECT_EQ(one.only_result().reason, PartReason::strobe_failed);
    }
}

TEST_F(Running, light_within_its_tolerance_counts_up_to_the_limit) {
    for (const auto& [shift, width] :
         {std::pair(100, 200), std::pair(-100, 200), std::pair(0, 100), std::pair(0, 300), std::pair(100, 300)}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const auto part = one.part_arrives();
        one.advance(milliseconds(10));
        one.frame_comes(part);
        one.judged(part, Verdict::pass);
        one.send(hal::StrobeReport{part, true, one.exposure_of(part).start + microseconds(100 + shift),
                                   microseconds(width)});
        EXPECT_EQ(one.only_result().verdict, PartVerdict::pass) << shift << " " << width;
    }
}

TEST_F(Running, light_that_is_reported_after_the_part_was_given_up_changes_nothing) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.frame_comes(part);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.send(Command::abort), Answer::done);
    rig.light_comes(part);
    EXPECT_EQ(rig.shot().counters.inspected, 0U);
    expect_fail_safe(part, PartReason::station_not_running);
    EXPECT_EQ(rig.only_result().score, 0);
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

// The oldest part that waits for its frame, and no other.
TEST_F(Running, a_stale_frame_is_noted_on_the_part_that_may_have_lost_it) {
    CoreConfig config = quick_line();
    config.exposure_delay = milliseconds(40);
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    std::vector<std::uint32_t> parts;
    for (int k = 0; k < 4; ++k) {
        parts.push_back(one.part_arrives());
        one.advance(milliseconds(22));
    }
    one.advance(milliseconds(20));
    one.light_comes(parts[0]);
    one.frame_comes(parts[0]);          // it waits for its judgement
    one.send(StrobeRefused{parts[1]});  // it is rejected, and its frame may still come
    one.light_comes(parts[2]);
    one.light_comes(parts[3]);
    one.frame_comes_at(one.exposure_of(parts[0]).start - milliseconds(10));
    one.advance(milliseconds(60));
    const Line& line = one.core.line();
    ASSERT_EQ(line.size(), 4U);
    EXPECT_EQ(line[0].stray_frame, PartReason::none);
    EXPECT_EQ(line[1].result.reason, PartReason::strobe_failed);
    EXPECT_EQ(line[2].result.reason, PartReason::frame_stale);
    EXPECT_EQ(line[3].result.reason, PartReason::frame_lost);
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

TEST_F(Running, a_frames_number_is_new_up_to_half_of_all_numbers_ahead) {
    for (const std::uint32_t step : {(1U << 31) - 1, 1U << 31}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        one.judged(one.part_is_seen(), Verdict::pass);
        one.advance(milliseconds(90));
        const auto part = one.part_arrives();
        one.advance(milliseconds(10));
        one.frame_sequence += step - 1;
        one.frame_comes(part);
        EXPECT_EQ(one.inspections.size(), step < (1U << 31) ? 2U : 1U);
    }
}

// The trigger of the first part is obeyed late, while the second is about to be exposed.
TEST_F(Running, a_frame_that_names_another_parts_trigger_is_never_the_next_parts) {
    const auto first = rig.part_arrives();
    rig.advance(milliseconds(40));
    const auto second = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.light_comes(second);
    rig.send(FrameArrived{1, {1, rig.exposure_of(second).start - milliseconds(1), 1000, false, first}});
    EXPECT_TRUE(rig.inspections.empty());
    EXPECT_EQ(rig.shot().counters.unfit, 1U) << "the late frame has used up the trigger of the first";
    rig.send(FrameArrived{2, {2, rig.exposure_of(second).start, 1000, false, second}});
    ASSERT_EQ(rig.inspections.size(), 1U);
    EXPECT_EQ(rig.inspections[0].part, second);
    EXPECT_EQ(rig.inspections[0].frame, 2U);
    rig.judged(second, Verdict::pass);
    EXPECT_EQ(rig.shot().counters.pass, 1U);
    expect_fail_safe(first, PartReason::frame_stale);
}

TEST_F(Running, of_two_frames_in_one_window_none_is_chosen) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.light_comes(part);
    rig.frame_comes_at(rig.exposure_of(part).start - milliseconds(1));
    ASSERT_EQ(rig.inspections.size(), 1U);
    rig.frame_comes_at(rig.exposure_of(part).start + milliseconds(2));
    EXPECT_EQ(rig.released.size(), 1U);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.shot().counters.pass, 0U);
    expect_fail_safe(part, PartReason::frame_duplicate);
}

TEST_F(Running, a_frame_from_before_its_request_is_not_the_parts_whatever_the_window) {
    CoreConfig config = quick_line();
    config.frame_window = config.exposure_delay;
    config.trigger_lead = milliseconds(2);
    for (const bool before : {true, false}) {
        CoreRig one(config);
        one.bring_to(State::continuous_execution);
        const auto part = one.part_arrives();
        one.advance(milliseconds(10));
        one.frame_comes_at(one.exposure_of(part).start - config.trigger_lead - Duration(before ? 1 : 0));
        EXPECT_EQ(one.inspections.size(), before ? 0U : 1U);
    }
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
    rig.advance(milliseconds(60));  // the core stops waiting for its frame after 55.5 ms
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

TEST_F(Running, a_frame_from_the_device_that_refused_its_trigger_is_not_awaited) {
    const auto part = rig.part_arrives();
    rig.send(TriggerRefused{part});
    EXPECT_EQ(rig.shot().counters.unfit, 1U);
    expect_fail_safe(part, PartReason::frame_lost);
}

TEST_F(Running, a_frame_of_an_exposure_that_was_refused_is_nobodys) {
    const auto first = rig.part_arrives();
    rig.send(TriggerRefused{first});
    rig.advance(milliseconds(100));
    const auto second = rig.part_arrives();
    rig.light_comes(second);
    rig.frame_comes(first);
    expect_fail_safe(second, PartReason::frame_stale);
}

// As if it were the part's own, by its time stamp.
TEST_F(Running, a_frame_that_is_said_to_be_nobodys_is_not_judged_and_the_own_frame_still_counts) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.light_comes(part);
    const hal::FrameInfo nobodys{
        .sequence = 1, .exposure_start = rig.exposure_of(part).start, .bytes_used = 1000, .nobodys = true};
    rig.send(FrameArrived{77, nobodys});
    EXPECT_EQ(rig.released.size(), 1U);
    EXPECT_TRUE(rig.inspections.empty());
    hal::FrameInfo own = nobodys;
    own.sequence = 2;
    own.exposure = part;
    own.nobodys = false;
    rig.send(FrameArrived{78, own});
    ASSERT_EQ(rig.inspections.size(), 1U);
    EXPECT_EQ(rig.inspections[0].frame, 78U);
    hal::FrameInfo again = nobodys;
    again.sequence = 3;
    rig.send(FrameArrived{79, again});
    expect_fail_safe(part, PartReason::frame_duplicate);
}

}  // namespace
}  // namespace hord::firmware
