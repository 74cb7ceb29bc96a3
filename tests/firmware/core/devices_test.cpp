// Devices that come and go, a PLC that is lost, faults and the heartbeat: literal scenarios.
#include "tests/firmware/core/running.h"

namespace hord::firmware {
namespace {

using algo::Verdict;

constexpr std::uint32_t bits(FaultBit a) { return a; }

CoreRig with_policy(PlcPolicy policy, State state) {
    CoreConfig config = quick_line();
    config.plc_policy = policy;
    CoreRig rig(config);
    rig.bring_to(state);
    return rig;
}

TEST(PlcLostInCore, is_no_fault_without_a_policy) {
    CoreRig rig = with_policy(PlcPolicy::none, State::continuous_execution);
    const auto part = rig.part_is_seen();
    rig.send(PlcLost{});
    EXPECT_EQ(rig.shot().faults_active, 0U);
    EXPECT_EQ(rig.shot().faults_latched, 0U);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
    EXPECT_EQ(rig.send(Command::stop), Answer::done);
    rig.advance(milliseconds(200));
    EXPECT_EQ(rig.send(Command::start_single), Answer::done);
}

TEST(PlcLostInCore, with_policy_stop_finishes_the_parts_and_starts_no_more_until_it_is_back) {
    for (const Command start : {Command::start_single, Command::start_continuous}) {
        CoreRig rig = with_policy(PlcPolicy::stop, State::continuous_execution);
        const auto part = rig.part_is_seen();
        rig.send(PlcLost{});
        EXPECT_EQ(rig.shot().faults_active, bits(kFaultPlc));
        EXPECT_EQ(rig.core.state(), State::continuous_execution);
        rig.judged(part, Verdict::pass);
        EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
        rig.advance(milliseconds(200));
        EXPECT_EQ(rig.core.state(), State::ready);
        EXPECT_EQ(rig.send(start), Answer::plc_lost);
        EXPECT_EQ(rig.core.state(), State::ready);
        EXPECT_EQ(rig.send(Command::disarm), Answer::done);
        EXPECT_EQ(rig.send(Command::reset), Answer::done);
        EXPECT_EQ(rig.shot().faults_latched, bits(kFaultPlc)) << "it is still lost";
        EXPECT_EQ(rig.send(Command::arm), Answer::done);
        rig.send(PlcBack{});
        EXPECT_EQ(rig.shot().faults_active, 0U);
        EXPECT_EQ(rig.shot().faults_latched, bits(kFaultPlc));
        EXPECT_EQ(rig.send(start), Answer::done);
    }
}

TEST(PlcLostInCore, with_policy_stop_changes_nothing_in_ready) {
    CoreRig rig = with_policy(PlcPolicy::stop, State::ready);
    rig.send(PlcLost{});
    EXPECT_EQ(rig.core.state(), State::ready);
    EXPECT_EQ(rig.shot().first_fault, 10);  // kFaultPlc is bit 9
}

TEST(PlcLostInCore, with_policy_reject_all_rejects_what_has_no_verdict_and_every_new_part) {
    CoreRig rig = with_policy(PlcPolicy::reject_all, State::continuous_execution);
    const auto judged = rig.part_is_seen();
    rig.judged(judged, Verdict::pass);
    rig.results.clear();
    rig.advance(milliseconds(90));
    const auto waiting = rig.part_is_seen();
    rig.send(PlcLost{});
    rig.judged(waiting, Verdict::pass);
    EXPECT_TRUE(rig.results.empty());
    EXPECT_EQ(rig.shot().counters.unfit, 1U);
    rig.advance(milliseconds(90));
    rig.exposures.clear();
    const auto later = rig.part_arrives();
    EXPECT_TRUE(rig.exposures.empty());
    EXPECT_EQ(rig.core.state(), State::continuous_execution);
    for (const auto part : {waiting, later}) {
        ASSERT_TRUE(rig.advance_until_rejected(part));
        rig.confirmed(part);
    }
    ASSERT_EQ(rig.results.size(), 2U);
    for (const PartResult& r : rig.results) EXPECT_EQ(r.reason, PartReason::plc_lost);
    rig.send(PlcBack{});
    rig.advance(milliseconds(90));
    rig.results.clear();
    rig.judged(rig.part_is_seen(), Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
}

TEST_F(Running, a_lost_device_rejects_exactly_the_parts_that_need_it) {
    struct {
        Device device;
        bool light, frame;  // came before the loss
        bool rejected;
    } const stories[] = {
        {Device::sensor, false, false, true},    {Device::sensor, true, false, true},
        {Device::sensor, false, true, false},    {Device::strobe, false, false, true},
        {Device::strobe, false, true, true},     {Device::strobe, true, false, false},
        {Device::rejector, false, false, false}, {Device::sensor, true, true, false},
        {Device::strobe, true, true, false},
    };
    for (const auto& story : stories) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const auto part = one.part_arrives();
        one.advance(milliseconds(10));
        if (story.light) one.light_comes(part);
        if (story.frame) one.frame_comes(part);
        one.send(DeviceLost{story.device});
        EXPECT_EQ(one.core.state(), State::error);
        EXPECT_EQ(one.shot().counters.unfit, story.rejected ? 1U : 0U)
            << static_cast<int>(story.device) << story.light << story.frame;
        EXPECT_EQ(one.shot().faults_active & kDeviceFaults, fault_of(story.device));
        if (story.rejected) {
            EXPECT_EQ(one.core.line()[0].result.reason, PartReason::device_lost);
        }
    }
}

TEST_F(Running, a_part_that_is_not_exposed_yet_needs_light_and_sensor) {
    for (const Device device : {Device::sensor, Device::strobe}) {
        CoreConfig config = quick_line();
        config.exposure_delay = milliseconds(40);
        config.by_encoder = true;  // so that the lost permit does not reject it
        config.exposure_counts = 400;
        CoreRig one(config);
        one.bring_to(State::continuous_execution);
        one.belt(0);
        one.advance(milliseconds(10));
        one.belt(100);
        one.part_arrives();
        ASSERT_TRUE(one.exposures.empty());
        one.send(DeviceLost{device});
        EXPECT_EQ(one.core.line()[0].result.reason, PartReason::device_lost);
    }
}

TEST(DevicesInCore, reports_of_devices_that_were_not_opened_count_for_nothing) {
    CoreRig rig;
    rig.devices_up();
    rig.send(DeviceLost{Device::strobe});
    EXPECT_EQ(rig.shot().faults_latched, 0U);
    rig.send(Command::initialise);
    EXPECT_EQ(rig.shot().faults_active, kDeviceFaults);
    EXPECT_FALSE(rig.core.all_devices_up());
    rig.devices_up();
    EXPECT_TRUE(rig.core.all_devices_up());
    rig.send(Command::halt);
    EXPECT_FALSE(rig.core.all_devices_up());
    EXPECT_EQ(rig.shot().faults_active, 0U);
    rig.forget();
    rig.send(Command::reset);
    EXPECT_TRUE(rig.starts.empty()) << "initialise opens the devices";
    rig.send(Command::halt);
    EXPECT_EQ(rig.stops, 0) << "nothing is open";
    rig.send(Command::reset);
    rig.send(Command::initialise);
    EXPECT_EQ(rig.starts.size(), 4U);
}

TEST(DevicesInCore, losing_the_part_sensor_stops_the_line_only_where_parts_may_pass) {
    CoreRig rig;
    rig.bring_to(State::ready);
    rig.send(DeviceLost{Device::part_sensor});
    EXPECT_EQ(rig.core.state(), State::error);
    EXPECT_FALSE(rig.shot().line_stop);
}

// The sequence numbers of a device that was opened again begin anew.
TEST_F(Running, a_part_sensor_that_is_back_counts_from_one_again) {
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 7, {}});  // the first edge of all may be any
    rig.send(DeviceLost{Device::part_sensor});
    rig.advance(kMinLineStop);
    rig.send(Command::reset);
    rig.send(DeviceUp{Device::part_sensor});
    ASSERT_EQ(rig.send(Command::arm), Answer::done);
    ASSERT_EQ(rig.send(Command::start_continuous), Answer::done);
    const auto missed = rig.shot().counters.missed;
    rig.advance(milliseconds(300));
    rig.exposures.clear();
    rig.send(hal::PartEdge{hal::PartEdge::Kind::arrives, rig.now, 1, {}});
    EXPECT_EQ(rig.exposures.size(), 1U);
    EXPECT_EQ(rig.shot().counters.missed, missed);
    EXPECT_FALSE(rig.shot().line_stop);
}

// What it told before says nothing about its first edges.
TEST_F(Running, a_part_sensor_that_is_back_begins_with_an_empty_place) {
    for (const std::uint32_t first : {1U, 2U}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, one.now, 1, {}});
        one.send(hal::PartEdge{hal::PartEdge::Kind::leaves, one.now, 2, {}});
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, one.now + std::chrono::hours(1), 3, {}});
        one.send(DeviceLost{Device::part_sensor});
        one.advance(kMinLineStop);
        one.send(Command::reset);
        one.send(DeviceUp{Device::part_sensor});
        ASSERT_EQ(one.send(Command::arm), Answer::done);
        ASSERT_EQ(one.send(Command::start_continuous), Answer::done);
        const auto missed = one.shot().counters.missed;
        one.advance(milliseconds(300));
        one.exposures.clear();
        one.send(hal::PartEdge{hal::PartEdge::Kind::arrives, one.now, first, {}});
        EXPECT_EQ(one.exposures.size(), first == 1 ? 1U : 0U);
        EXPECT_EQ(one.shot().counters.missed, missed + first - 1) << "the first of two edges was an arrival";
    }
}

TEST_F(Running, a_sensor_that_is_back_may_number_its_frames_anew) {
    auto part = rig.part_is_seen();
    rig.judged(part, Verdict::pass);
    rig.advance(milliseconds(200));
    rig.send(DeviceLost{Device::sensor});
    rig.send(Command::reset);
    rig.send(DeviceUp{Device::sensor});
    ASSERT_EQ(rig.send(Command::arm), Answer::done);
    ASSERT_EQ(rig.send(Command::start_continuous), Answer::done);
    rig.frame_sequence = 0;
    rig.results.clear();
    part = rig.part_is_seen();
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.only_result().verdict, PartVerdict::pass);
}

TEST(Faults, of_the_outside_are_shown_while_they_last_and_latched_until_a_reset) {
    CoreRig rig;
    rig.bring_to(State::initialized);
    rig.send(OutsideFaults{kFaultStore | kFaultSensor});
    EXPECT_EQ(rig.shot().faults_active, bits(kFaultStore)) << "the core knows its devices better";
    EXPECT_EQ(rig.shot().first_fault, 11);  // kFaultStore is bit 10
    EXPECT_EQ(rig.core.state(), State::initialized);
    rig.send(Command::reset);
    EXPECT_EQ(rig.shot().faults_latched, bits(kFaultStore));
    rig.send(OutsideFaults{});
    EXPECT_EQ(rig.shot().faults_active, 0U);
    EXPECT_EQ(rig.shot().faults_latched, bits(kFaultStore));
    rig.send(Command::reset);
    EXPECT_EQ(rig.shot().faults_latched, 0U);
    EXPECT_EQ(rig.shot().first_fault, 0);
}

TEST_F(Running, a_reset_ends_the_faults_of_parts_that_were_not_judged) {
    rig.part_arrives();
    rig.advance(milliseconds(60));
    ASSERT_EQ(rig.shot().faults_active, bits(kFaultSensor)) << "its frame did not come";
    rig.send(LineUnknown{});
    rig.advance(kMinLineStop);
    ASSERT_EQ(rig.send(Command::reset), Answer::done);
    EXPECT_EQ(rig.shot().faults_active, 0U);
    EXPECT_EQ(rig.shot().faults_latched, 0U);
}

TEST(Faults, of_the_outside_stay_latched_in_a_halted_station) {
    CoreRig rig;
    rig.send(OutsideFaults{kFaultStore});
    rig.send(Command::halt);
    rig.send(Command::reset);
    EXPECT_EQ(rig.core.state(), State::preoperational);
    EXPECT_EQ(rig.shot().faults_latched, bits(kFaultStore));
}

TEST(Heartbeat, catches_up_after_a_hold_up_and_keeps_its_phase) {
    CoreConfig config = quick_line();
    config.station_heartbeat = milliseconds(500);
    CoreRig rig(config);
    rig.send(Tick{});
    EXPECT_EQ(rig.shot().station_heartbeat, 0);
    EXPECT_EQ(rig.core.next_wake(), rig.now + milliseconds(500));
    const TimePoint start = rig.now;
    rig.now += milliseconds(1700);
    rig.send(Tick{});
    EXPECT_EQ(rig.shot().station_heartbeat, 3);
    EXPECT_EQ(rig.core.next_wake(), start + milliseconds(2000));
    rig.now = start + milliseconds(2000);
    rig.send(Tick{});
    EXPECT_EQ(rig.shot().station_heartbeat, 4);
}

// Whatever else the core waits for: an encoder, the end of a covered sensor, an ejector at rest.
TEST(Heartbeat, is_not_late) {
    CoreConfig config = quick_line();
    config.station_heartbeat = milliseconds(1);
    config.max_part = milliseconds(50);
    const auto expect_soon = [](const CoreRig& rig) { EXPECT_LE(rig.core.next_wake(), rig.now + milliseconds(1)); };
    CoreRig covered(config);
    covered.bring_to(State::continuous_execution);
    for (const auto kind : {hal::PartEdge::Kind::arrives, hal::PartEdge::Kind::leaves, hal::PartEdge::Kind::arrives}) {
        covered.send(hal::PartEdge{kind, covered.now, ++covered.edges, {}});
        covered.advance(milliseconds(30));
    }
    expect_soon(covered);

    config.by_encoder = true;
    CoreRig counted(config);
    counted.bring_to(State::continuous_execution);
    counted.belt(0);
    counted.part_arrives();
    expect_soon(counted);

    config.by_encoder = false;
    config.reject_pulse = milliseconds(300);
    config.min_gap = milliseconds(301);
    CoreRig resting(config);
    resting.bring_to(State::continuous_execution);
    const auto part = resting.part_is_seen();
    resting.send(StrobeRefused{part});
    ASSERT_TRUE(resting.advance_until_rejected(part));
    resting.send(LineUnknown{});
    resting.advance(kMinLineStop);
    ASSERT_EQ(resting.send(Command::reset), Answer::done);
    ASSERT_EQ(resting.send(Command::arm), Answer::not_yet);
    expect_soon(resting);
}

TEST_F(Running, a_clock_that_goes_back_is_taken_to_stand) {
    const auto part = rig.part_is_seen();
    const TimePoint now = rig.now;
    rig.now -= milliseconds(5);
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.only_result().latency_us, 10'000U);
    EXPECT_GE(rig.core.next_wake(), now);
}

TEST_F(Running, halt_gives_up_every_part_and_tells_the_devices_once) {
    const auto part = rig.part_is_seen();
    rig.judged(part, Verdict::pass);
    rig.advance(milliseconds(90));
    rig.part_is_seen();
    rig.forget();
    EXPECT_EQ(rig.send(Command::halt), Answer::done);
    EXPECT_EQ(rig.stops, 1);
    EXPECT_FALSE(rig.shot().run_permit);
    EXPECT_TRUE(rig.permits.empty()) << "StopDevices switches the permit off";
    EXPECT_TRUE(rig.shot().line_stop) << "a part was on its way";
    EXPECT_EQ(rig.shot().line_stop_why, (LineStop{LineStopCause::place_lost, part + 1})) << "the first one is good";
    EXPECT_EQ(rig.shot().counters.unfit, 1U);
    rig.advance(milliseconds(200));
    EXPECT_EQ(rig.only_result().reject, RejectState::failed);
}

TEST_F(Running, abort_is_ready_at_once_and_no_part_waits) {
    const auto first = rig.part_is_seen();
    rig.advance(milliseconds(90));
    const auto second = rig.part_is_seen();
    EXPECT_EQ(rig.send(Command::abort), Answer::done);
    EXPECT_EQ(rig.core.state(), State::ready);
    EXPECT_TRUE(rig.shot().run_permit) << "until the line is empty";
    EXPECT_EQ(rig.shot().counters.unfit, 2U);
    for (const auto part : {first, second}) {
        ASSERT_TRUE(rig.advance_until_rejected(part));
        rig.confirmed(part);
    }
    rig.advance(milliseconds(60));
    EXPECT_EQ(rig.permits, std::vector<bool>{false});
    EXPECT_FALSE(rig.shot().line_stop);
    EXPECT_EQ(rig.send(Command::start_continuous), Answer::done);
}

}  // namespace
}  // namespace hord::firmware
