// A conveyor that slows, stops and restarts: deadlines and ejection follow the encoder, not the clock.
#include "tests/firmware/core/encoder_rig.h"

namespace hord::firmware {
namespace {

using algo::Verdict;

TEST_F(Encoder, at_constant_speed_the_pulse_meets_the_part) {
    const TimePoint edge = rig.now;
    const auto part = bad_part();
    run(milliseconds(150), 10);
    ASSERT_TRUE(rig.rejected(part));
    EXPECT_EQ(rig.rejects[0].start, edge + kPulseStart);
    rig.confirmed(part);
    EXPECT_TRUE(rig.results.empty());  // the encoder must also show that it passes during the pulse
    run(milliseconds(30), 10);
    EXPECT_EQ(rig.only_result().reject, RejectState::confirmed);
    EXPECT_FALSE(rig.shot().line_stop);
}

TEST_F(Encoder, what_is_acknowledged_after_the_part_was_at_the_ejector_is_late) {
    const auto part = bad_part();
    run(milliseconds(150), 10);
    ASSERT_TRUE(rig.rejected(part));
    run(milliseconds(20), 10);  // 180 ms after the edge: at the ejector; the pulse lasts until 190 ms
    run(milliseconds(10), 10);
    rig.confirmed(part);
    EXPECT_EQ(rig.only_result().reject, RejectState::late);
    EXPECT_TRUE(rig.shot().line_stop);
}

// The process was held up: the command comes when the part should have passed. That the belt was slower does not help.
TEST_F(Encoder, a_command_after_the_part_should_have_passed_is_late_even_if_it_had_not) {
    const auto part = bad_part();
    run(milliseconds(140), 10);
    rig.now += milliseconds(32);  // 182 ms after the edge; 180 were planned
    rig.send(Tick{});
    ASSERT_TRUE(rig.rejected(part));
    rig.now += milliseconds(1);
    rig.confirmed(part);
    rig.now += milliseconds(3);
    rig.belt(299);
    EXPECT_TRUE(rig.results.empty() || rig.only_result().reject == RejectState::late);
    rig.now += milliseconds(2);
    rig.belt(2);  // it passes now, within the pulse
    EXPECT_EQ(rig.only_result().reject, RejectState::late);
}

TEST_F(Encoder, a_part_that_passes_as_the_pulse_begins_or_ends_is_ejected) {
    for (const bool ends : {false, true}) {
        const auto part = bad_part();
        run(milliseconds(140), 10);
        rig.advance(milliseconds(10));
        ASSERT_TRUE(rig.rejected(part));
        rig.confirmed(part);
        const hal::RejectCommand& pulse = rig.rejects.back();
        rig.advance(pulse.start + (ends ? pulse.width : Duration(0)) - rig.now);
        rig.belt(1800 - 1500);  // a little faster than it was, or slower
        EXPECT_EQ(rig.only_result().reject, RejectState::confirmed) << ends;
        run(milliseconds(100), 10);
        rig.forget();
    }
}

TEST_F(Encoder, at_half_speed_the_pulse_comes_twice_as_late) {
    const auto part = bad_part();  // 100 counts after the edge
    const TimePoint slow_from = rig.now;
    run(milliseconds(300), 5);
    EXPECT_FALSE(rig.rejected(part));
    run(milliseconds(20), 5);
    ASSERT_TRUE(rig.rejected(part));
    EXPECT_EQ(rig.rejects[0].start, slow_from + milliseconds(1700 / 5 - 5));
}

TEST_F(Encoder, the_exposure_waits_for_the_part) {
    CoreConfig config = with_encoder();
    config.exposure_counts = 1000;
    CoreRig far(config);
    far.bring_to(State::continuous_execution);
    far.belt(0);
    far.advance(milliseconds(10));
    far.belt(100);
    const auto part = far.part_arrives();
    for (int k = 0; k < 5; ++k) {
        far.advance(milliseconds(10));
        far.belt(100);
    }
    for (int k = 0; k < 9; ++k) {
        EXPECT_TRUE(far.exposures.empty());
        far.advance(milliseconds(10));
        far.belt(50);  // half as fast
    }
    ASSERT_TRUE(far.exposures.empty());
    const TimePoint last = far.now;  // 50 counts are left
    far.advance(milliseconds(5));
    ASSERT_EQ(far.exposures.size(), 1U);
    EXPECT_EQ(far.exposure_of(part).start, last + milliseconds(10));
}

TEST_F(Encoder, a_conveyor_that_jumps_before_the_exposure_spoils_it) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.light_comes(part);
    rig.frame_comes(part);
    rig.judged(part, Verdict::pass);
    EXPECT_TRUE(rig.results.empty());  // its position at the exposure needs the next reading
    rig.belt(400);                     // 200 counts at the exposure, not 50
    EXPECT_TRUE(rig.results.empty());
    EXPECT_EQ(rig.shot().counters.pass, 0U);
    EXPECT_EQ(rig.shot().counters.unfit, 1U);
}

// Half of the least gap between two parts: beyond it the frame may show the neighbour.
TEST_F(Encoder, a_part_is_where_it_was_planned_to_be_to_half_a_gap) {
    const auto half = rig.core.config().min_gap_counts / 2;
    for (const std::int64_t off : {half - 1, half}) {
        const Counters before = rig.shot().counters;
        const auto part = rig.part_arrives();
        rig.advance(milliseconds(10));
        rig.light_comes(part);
        rig.frame_comes(part);
        rig.judged(part, Verdict::pass);
        rig.belt(2 * (50 + off));  // the exposure was in the middle of this time
        EXPECT_EQ(rig.shot().counters.pass, before.pass + (off < half ? 1 : 0)) << off;
        EXPECT_EQ(rig.shot().counters.unfit, before.unfit + (off < half ? 0 : 1)) << off;
        run(milliseconds(50), 10);
    }
}

TEST_F(Encoder, a_stopped_conveyor_keeps_its_parts_until_it_restarts) {
    const auto part = bad_part();
    run(std::chrono::seconds(60), 0);
    EXPECT_FALSE(rig.rejected(part));
    EXPECT_EQ(rig.core.state(), State::continuous_execution);
    EXPECT_EQ(rig.shot().parts_on_line, 1U);
    const TimePoint restart = rig.now;
    run(milliseconds(160), 10);
    ASSERT_TRUE(rig.rejected(part));
    EXPECT_EQ(rig.rejects[0].start, restart + milliseconds(165));
    rig.confirmed(part);
    run(milliseconds(40), 10);
    EXPECT_EQ(rig.only_result().reject, RejectState::confirmed);
    EXPECT_EQ(rig.shot().parts_on_line, 0U);
}

TEST_F(Encoder, a_good_part_is_on_the_line_until_it_has_passed_the_ejector) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.belt(100);
    rig.light_comes(part);
    rig.frame_comes(part);
    rig.judged(part, Verdict::pass);
    ASSERT_EQ(rig.shot().counters.pass, 1U);
    run(std::chrono::seconds(60), 0);
    EXPECT_EQ(rig.shot().parts_on_line, 1U);
    EXPECT_EQ(rig.send(Command::stop), Answer::done);
    EXPECT_EQ(rig.core.state(), State::continuous_execution) << "it is not through yet";
    run(milliseconds(200), 10);
    EXPECT_EQ(rig.shot().parts_on_line, 0U);
    EXPECT_EQ(rig.core.state(), State::ready);
}

TEST_F(Encoder, a_slow_verdict_is_in_time_while_the_conveyor_stands) {
    const auto part = rig.part_arrives();
    run(milliseconds(10), 10);
    rig.light_comes(part);
    rig.frame_comes(part);
    run(std::chrono::seconds(5), 0);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
}

TEST_F(Encoder, a_latency_of_more_than_an_hour_is_the_longest_one) {
    CoreConfig config = with_encoder();
    config.encoder_timeout = Duration::zero();  // a silent encoder is no fault
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    one.belt(0);
    one.advance(milliseconds(10));
    one.belt(100);
    const auto part = one.part_arrives();
    one.advance(milliseconds(10));
    one.belt(100);
    one.light_comes(part);
    one.frame_comes(part);
    one.advance(milliseconds(10));
    one.belt(0);  // it stands
    one.advance(std::chrono::hours(2));
    one.judged(part, Verdict::pass);
    EXPECT_EQ(one.only_result().verdict, PartVerdict::pass);
    EXPECT_EQ(one.only_result().latency_us, 0xFFFFFFFEU);
}

TEST_F(Encoder, a_conveyor_that_stops_between_command_and_ejector_stops_the_line) {
    const auto part = bad_part();
    run(milliseconds(150), 10);
    ASSERT_TRUE(rig.rejected(part));
    rig.confirmed(part);
    run(milliseconds(200), 0);  // the pulse ends before the part arrives
    EXPECT_EQ(rig.only_result().reject, RejectState::late);
    EXPECT_TRUE(rig.shot().line_stop);
}

TEST_F(Encoder, a_conveyor_that_speeds_up_after_the_command_stops_the_line) {
    const auto part = bad_part();
    run(milliseconds(150), 10);
    ASSERT_TRUE(rig.rejected(part));
    rig.confirmed(part);
    run(milliseconds(10), 40);  // the part passes the ejector before the pulse
    EXPECT_EQ(rig.only_result().reject, RejectState::late);
    EXPECT_TRUE(rig.shot().line_stop);
}

TEST_F(Encoder, a_silent_encoder_loses_the_parts_and_stops_the_line) {
    const auto part = rig.part_is_seen();  // it waits for its judgement
    rig.advance(milliseconds(89));
    EXPECT_FALSE(rig.shot().line_stop);
    rig.advance(milliseconds(1));
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_NE(rig.shot().faults_active & kFaultPartSensor, 0U);
    EXPECT_EQ(rig.core.state(), State::error);
    ASSERT_FALSE(rig.results.empty());
    EXPECT_EQ(rig.results[0].part, part);
    EXPECT_EQ(rig.results[0].reason, PartReason::device_lost);
    EXPECT_EQ(rig.shot().parts_on_line, 0U);
}

// The next part would be lost in the same way.
TEST_F(Encoder, that_is_silent_stops_the_line_even_if_every_part_on_it_is_good) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(10));
    rig.belt(100);
    rig.light_comes(part);
    rig.frame_comes(part);
    rig.judged(part, Verdict::pass);
    ASSERT_EQ(rig.only_result().verdict, PartVerdict::pass);
    rig.advance(milliseconds(100));
    EXPECT_TRUE(rig.shot().line_stop);
}

TEST_F(Encoder, is_silent_no_sooner_than_a_part_is_on_the_line) {
    rig.advance(milliseconds(90));
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, ++rig.edges, {}});
    rig.advance(milliseconds(60));
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, ++rig.edges, {}});
    rig.advance(milliseconds(39));
    EXPECT_FALSE(rig.shot().line_stop);
    rig.advance(milliseconds(1));
    EXPECT_TRUE(rig.shot().line_stop) << "100 ms after the first of the two";
}

// The counts may have gone on, or begun anew: the speed of before says nothing.
TEST_F(Encoder, after_a_silent_encoder_a_place_needs_two_readings) {
    rig.part_arrives();
    rig.advance(milliseconds(100));
    ASSERT_TRUE(rig.shot().line_stop);
    rig.advance(kMinLineStop);
    for (const Command c : {Command::reset, Command::arm, Command::start_continuous})
        ASSERT_EQ(rig.send(c), Answer::done);
    rig.exposures.clear();
    rig.belt(100'000);
    rig.part_arrives();
    EXPECT_TRUE(rig.exposures.empty());
}

TEST_F(Encoder, after_a_halt_a_place_needs_two_readings) {
    for (const Command c : {Command::halt, Command::reset, Command::initialise}) ASSERT_EQ(rig.send(c), Answer::done);
    rig.devices_up();
    for (const Command c : {Command::arm, Command::start_continuous}) ASSERT_EQ(rig.send(c), Answer::done);
    rig.advance(milliseconds(10));
    rig.belt(100'000);
    rig.part_arrives();
    EXPECT_TRUE(rig.exposures.empty());
}

// Halt and start up again: the part sensor's edges are numbered from 1 again, and its encoder counts from 0.
TEST_F(Encoder, after_a_halt_counts_have_nothing_to_do_with_those_before) {
    const auto before = bad_part();
    run(milliseconds(150), 10);
    rig.confirmed(before);
    run(milliseconds(100), 10);
    ASSERT_EQ(rig.shot().parts_on_line, 0U);
    rig.forget();
    for (const Command c : {Command::halt, Command::reset, Command::initialise}) ASSERT_EQ(rig.send(c), Answer::done);
    rig.edges = 0;
    rig.counts = 0;
    rig.devices_up();
    for (const Command c : {Command::arm, Command::start_continuous}) ASSERT_EQ(rig.send(c), Answer::done);
    run(milliseconds(50), 10);
    const auto part = bad_part();
    EXPECT_TRUE(rig.results.empty());
    run(milliseconds(150), 10);
    ASSERT_TRUE(rig.rejected(part)) << "it was taken for too close to the part before the halt";
    rig.confirmed(part);
    run(milliseconds(30), 10);
    EXPECT_EQ(rig.only_result().reason, PartReason::deflection_gradient);
}

TEST_F(Encoder, a_halt_loses_the_places_of_parts_also_if_the_station_starts_at_once) {
    const auto part = bad_part();
    for (const Command c : {Command::halt, Command::reset, Command::initialise}) ASSERT_EQ(rig.send(c), Answer::done);
    EXPECT_FALSE(rig.shot().line_stop) << "the encoder is not silent for long enough";
    rig.edges = 0;
    rig.counts = 0;
    rig.devices_up();
    EXPECT_EQ(rig.only_result().part, part);
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_TRUE(rig.rejects.empty());
}

TEST_F(Encoder, parts_keep_their_place_while_the_run_permit_is_down) {
    const auto part = bad_part();
    rig.send(DeviceLost{Device::strobe});
    EXPECT_EQ(rig.permits, std::vector<bool>{false});
    EXPECT_FALSE(rig.shot().line_stop);
    run(milliseconds(150), 10);
    ASSERT_TRUE(rig.rejected(part));
    rig.confirmed(part);
    run(milliseconds(30), 10);
    EXPECT_EQ(rig.only_result().reject, RejectState::confirmed);
}

TEST_F(Encoder, a_place_is_proven_by_a_reading_of_the_exposures_moment) {
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(5));
    rig.belt(50);
    ASSERT_EQ(rig.exposure_of(part).start, rig.now);
    rig.advance(milliseconds(5));
    rig.light_comes(part);
    rig.frame_comes(part);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
}

TEST_F(Encoder, a_belt_that_speeds_up_after_the_exposure_does_not_spoil_it) {
    const auto part = rig.part_arrives();
    run(milliseconds(10), 10);
    rig.light_comes(part);
    rig.frame_comes(part);
    run(milliseconds(10), 40);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
}

TEST_F(Encoder, a_conveyor_that_stops_just_before_the_exposure_spoils_it) {
    CoreConfig config = with_encoder();
    config.exposure_counts = 1000;
    config.transport_counts = 18'000;
    CoreRig fast(config);
    fast.bring_to(State::continuous_execution);
    fast.belt(0);
    fast.advance(milliseconds(10));
    fast.belt(1000);
    fast.part_arrives();
    fast.advance(milliseconds(6));
    ASSERT_EQ(fast.exposures.size(), 1U);
    fast.belt(500);  // half of the way
    fast.advance(milliseconds(5));
    fast.belt(0);
    EXPECT_EQ(fast.core.line()[0].result.reason, PartReason::edge_lost);
}

// More results than one step has room for.
TEST_F(Encoder, every_part_of_a_full_line_whose_place_is_lost_gets_its_result) {
    CoreConfig config = with_encoder();
    config.transport_counts = 1'000'000;
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    one.belt(0);
    for (std::uint32_t k = 0; k < 2 * Actions::kCapacity; ++k) {
        one.part_arrives();
        one.advance(milliseconds(50));
        one.belt(1000);
    }
    one.forget();
    one.send(DeviceLost{Device::part_sensor});
    ASSERT_EQ(one.results.size(), 2 * Actions::kCapacity);
    for (std::uint32_t k = 0; k < one.results.size(); ++k) {
        EXPECT_EQ(one.results[k].part, k + 1);
        EXPECT_EQ(one.results[k].reject, RejectState::failed);
    }
}

}  // namespace
}  // namespace hord::firmware
