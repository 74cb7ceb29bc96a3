// A conveyor that slows, stops and restarts: deadlines and ejection follow the encoder, not the clock.
#include <limits>

#include "tests/firmware/core/core_rig.h"

namespace hord::firmware {
namespace {

using algo::Reason;
using algo::Verdict;

CoreConfig with_encoder() {
    CoreConfig c = quick_line();
    c.by_encoder = true;  // 1800 counts to the ejector: 180 ms at 10 counts a millisecond
    return c;
}

class Encoder : public ::testing::Test {
  protected:
    Encoder() {
        rig.bring_to(State::continuous_execution);
        rig.belt(0);
        run(milliseconds(50), 10);
    }
    // The belt moves `per_ms` counts a millisecond and is read every 10 ms.
    void run(Duration by, std::int64_t per_ms) {
        for (Duration done{}; done < by; done += milliseconds(10)) {
            rig.advance(milliseconds(10));
            rig.belt(10 * per_ms);
        }
    }
    std::uint32_t bad_part() {
        const auto part = rig.part_arrives();  // reaches the camera 50 counts (5 ms) later
        rig.advance(milliseconds(10));
        rig.belt(100);
        rig.light_comes(part);
        rig.frame_comes(part);
        rig.judged(part, Verdict::reject, Reason::deflection_gradient);
        return part;
    }

    CoreRig rig{with_encoder()};
};

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

TEST_F(Encoder, a_part_that_passes_as_the_pulse_begins_is_ejected) {
    const auto part = bad_part();
    run(milliseconds(140), 10);
    rig.advance(milliseconds(10));
    ASSERT_TRUE(rig.rejected(part));
    rig.confirmed(part);
    rig.advance(rig.rejects[0].start - rig.now);
    rig.belt(1800 - 1500);  // a little faster than it was
    EXPECT_EQ(rig.only_result().reject, RejectState::confirmed);
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

TEST_F(Encoder, parts_close_in_space_are_too_close_however_slow_the_conveyor) {
    rig.part_arrives();
    run(milliseconds(90), 2);  // the first part has no frame: unfit
    rig.advance(milliseconds(8));
    rig.part_arrives();  // 98 ms but only 180 counts after the first
    EXPECT_EQ(rig.exposures.size(), 1U);
    EXPECT_EQ(rig.shot().counters.unfit, 2U);
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
    const auto part = rig.part_arrives();
    rig.advance(milliseconds(99));
    EXPECT_FALSE(rig.shot().line_stop);
    rig.advance(milliseconds(1));
    EXPECT_TRUE(rig.shot().line_stop);
    EXPECT_EQ(rig.core.state(), State::error);
    ASSERT_FALSE(rig.results.empty());
    EXPECT_EQ(rig.results[0].part, part);
    EXPECT_EQ(rig.shot().parts_on_line, 0U);
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
        EXPECT_EQ(one.shot().counters.missed, most != 0 ? 1U : 0U);
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

TEST(Conveyor, one_count_microseconds_after_a_reading_is_no_speed) {
    Conveyor c;
    const TimePoint t0(std::chrono::seconds(1));
    c.read(t0, 0);
    c.read(t0 + milliseconds(10), 100);
    c.read(t0 + milliseconds(10) + microseconds(10), 101);  // an edge with its count
    EXPECT_EQ(c.reaches(201), t0 + milliseconds(20) + microseconds(10));
}

TEST(Conveyor, extrapolates_the_last_two_readings_and_never_overflows) {
    Conveyor c;
    const TimePoint t0(std::chrono::seconds(1));
    EXPECT_EQ(c.reaches(100), TimePoint::max());
    c.read(t0, 0);
    EXPECT_EQ(c.reaches(100), TimePoint::max());
    c.read(t0 + milliseconds(10), 100);
    EXPECT_EQ(c.reaches(150), t0 + milliseconds(15));
    EXPECT_EQ(c.reaches(50), t0 + milliseconds(5));
    EXPECT_EQ(c.counts_at(t0 + milliseconds(20)), 200);
    EXPECT_EQ(c.reaches(std::int64_t{1} << 60), TimePoint::max());
    const TimePoint last = t0 + milliseconds(10);
    const std::int64_t in_an_hour = 36'000'000;
    EXPECT_EQ(c.counts_at(last + std::chrono::hours(1)), 100 + in_an_hour);
    EXPECT_EQ(c.counts_at(last + std::chrono::hours(2)), 100 + in_an_hour) << "not extrapolated any further";
    EXPECT_EQ(c.counts_at(last - std::chrono::hours(2)), 100 - in_an_hour);
    c.read(t0 + milliseconds(20), 90);  // a decreasing count is treated as a standstill
    EXPECT_EQ(c.reaches(100), TimePoint::max());
    c.read(t0 + milliseconds(20), 500);  // not newer than the last reading
    EXPECT_EQ(c.reaches(100), TimePoint::max());
}

}  // namespace
}  // namespace hord::firmware
