// What the station tells of devices and parts: each trouble by name, with its cure.
#include "tests/firmware/station/station_fixture.h"

namespace hord::firmware {
namespace {

using ::testing::HasSubstr;
using State = firmware::State;

TEST_F(StationTest, a_refused_trigger_is_reported_and_rejects_the_part) {
    run();
    sensor.no_buffer = true;
    part();
    ASSERT_EQ(observer.troubles.size(), 1U);
    EXPECT_EQ(observer.troubles[0].what, "no free buffer");
    EXPECT_EQ(station->snapshot().counters.unfit, 1U);
}

TEST_F(StationTest, a_frame_or_light_that_misses_its_time_is_told_with_the_key_to_change) {
    run();
    part();
    loop.run_for(milliseconds(40));
    const auto& pulse = strobe.pulses.back();
    strobe.listener->on_strobe({pulse.exposure, true, pulse.start - milliseconds(5), pulse.width});
    ASSERT_EQ(observer.troubles.size(), 1U);
    EXPECT_THAT(observer.troubles[0].what,
                HasSubstr("the light of part 1 began 5 ms before it was due; the tolerance is 0.1 ms "
                          "(timing.strobe_window_us)"));
    sensor.deliver(sensor.requests.back().start + milliseconds(23));
    EXPECT_EQ(observer.troubles.size(), 1U) << "no part waits any more";
    loop.run_for(milliseconds(360));
    rejector.listener->on_reject({1, hal::RejectReport::Outcome::confirmed, loop.now()});
    loop.run_for(milliseconds(600));
    part();
    loop.run_for(milliseconds(40));
    sensor.deliver(sensor.requests.back().start + milliseconds(23));
    sensor.deliver(sensor.requests.back().start + milliseconds(24));
    ASSERT_EQ(observer.troubles.size(), 2U) << "once a second";
    EXPECT_THAT(observer.troubles[1].what, HasSubstr("a frame was exposed 23 ms after the trigger of part 2"));
    EXPECT_THAT(observer.troubles[1].what, HasSubstr("the window is 2 ms (timing.frame_window_us)"));
}

TEST_F(StationTest, a_part_that_is_at_the_camera_before_its_exposure_is_asked_for_is_told_by_how_much) {
    run();
    loop.run_for(milliseconds(20));
    part_sensor.listener->on_edge({hal::PartEdge::Kind::arrives, loop.now() - milliseconds(12), ++edges, {}});
    ASSERT_EQ(observer.troubles.size(), 1U);
    EXPECT_THAT(observer.troubles[0].what, HasSubstr("part 1 was at the camera 7 ms before the station could ask"));
    EXPECT_TRUE(strobe.pulses.empty());
    EXPECT_NE(station->snapshot().faults_active & kFaultOverrun, 0U);
}

TEST_F(StationTest, a_light_that_did_not_come_is_told_with_its_part) {
    run();
    part();
    const auto& pulse = strobe.pulses.back();
    strobe.listener->on_strobe({pulse.exposure, false, pulse.start + milliseconds(3), {}});
    ASSERT_EQ(observer.troubles.size(), 1U);
    EXPECT_THAT(observer.troubles[0].what,
                HasSubstr("the light of part 1 did not come: the strobe said so 3 ms after it was due"));
    loop.run_for(milliseconds(1));
    EXPECT_EQ(station->snapshot().counters.unfit, 1U);
}

TEST_F(StationTest, parts_that_are_too_close_are_told_with_the_key_once_a_second) {
    run();
    part();
    loop.run_for(milliseconds(12));
    part();
    loop.run_for(milliseconds(12));
    part();
    ASSERT_EQ(observer.troubles.size(), 1U);
    EXPECT_THAT(observer.troubles[0].what,
                HasSubstr("12 ms after the one ahead; one that is closer than 20 ms (line.min_gap_ms) is rejected"));
    loop.run_for(milliseconds(21));
    part();
    EXPECT_EQ(observer.troubles.size(), 1U);
    EXPECT_EQ(station->snapshot().counters.seen, 4U);
}

TEST_F(StationTest, a_light_that_is_too_short_or_too_long_is_told_by_how_much) {
    run();
    for (const auto& [longer, said] :
         {std::pair{milliseconds(-1), "was 1 ms shorter than"}, {milliseconds(1), "was 1 ms longer than"}}) {
        part();
        const auto& pulse = strobe.pulses.back();
        strobe.listener->on_strobe({pulse.exposure, true, pulse.start, pulse.width + longer});
        EXPECT_THAT(observer.troubles.back().what, HasSubstr(said));
        loop.run_for(milliseconds(375));
        rejector.listener->on_reject(
            {rejector.commands.back().part, hal::RejectReport::Outcome::confirmed, loop.now()});
        loop.run_for(std::chrono::seconds(2));
    }
    EXPECT_EQ(observer.troubles.size(), 2U);
}

TEST_F(StationTest, an_absent_part_sensor_is_named_and_arming_refused_until_a_reset_finds_it) {
    part_sensor.absent = true;
    ASSERT_EQ(station->request(Command::initialise), Answer::done);
    rejector.link(true);
    EXPECT_EQ(observer.troubles.at(0).what, "line 4 of gpiochip0");
    EXPECT_EQ(station->request(Command::arm), Answer::device_down);
    part_sensor.absent = false;
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(station->request(Command::arm), Answer::done);
}

TEST_F(StationTest, each_lost_device_is_named_and_brings_error) {
    const std::pair<std::uint32_t, std::function<void()>> losses[] = {
        {kFaultPartSensor,
         [&] {
             part_sensor.listener->on_part_sensor_lost({ErrorCode::disconnected, "it", ""});
         }},
        {kFaultStrobe,
         [&] {
             strobe.listener->on_strobe_lost({ErrorCode::disconnected, "it", ""});
         }},
        {kFaultSensor, [&] {
             sensor.listener->on_sensor_lost({ErrorCode::disconnected, "it", ""});
         }}};
    for (const auto& [fault, lose] : losses) {
        SCOPED_TRACE(fault);
        run();
        observer.troubles.clear();
        lose();
        EXPECT_EQ(station->snapshot().state, State::error);
        EXPECT_NE(station->snapshot().faults_active & fault, 0U);
        ASSERT_EQ(observer.troubles.size(), 1U);
        EXPECT_EQ(observer.troubles[0].what, "it");
        station->request(Command::halt);
        loop.run_for(milliseconds(250));
        ASSERT_EQ(station->request(Command::reset), Answer::done);
    }
}

TEST_F(StationTest, a_refused_light_is_reported_and_rejects_the_part) {
    run();
    strobe.hot = true;
    part();
    ASSERT_EQ(observer.troubles.size(), 1U);
    EXPECT_EQ(observer.troubles[0].what, "the light has not rested");
    EXPECT_EQ(station->snapshot().counters.unfit, 1U);
    loop.run_for(milliseconds(600));
    ASSERT_EQ(observer.results.size(), 1U);
    EXPECT_EQ(observer.results[0].reason, PartReason::strobe_failed);
}

TEST_F(StationTest, why_a_rejection_failed_is_told_and_alone_changes_nothing) {
    run();
    rejector.listener->on_reject_failed({ErrorCode::refused, "coil 0 reads back 0", "check the profile"});
    EXPECT_EQ(observer.troubles.back().what, "coil 0 reads back 0");
    EXPECT_EQ(station->snapshot().state, State::continuous_execution);
    EXPECT_EQ(rejector.permits, (std::vector<bool>{true}));
}

}  // namespace
}  // namespace hord::firmware
