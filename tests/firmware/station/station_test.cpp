// The station between devices and core, in virtual time, with devices controlled by the test.
#include "firmware/station/station.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "lab/stand_in/stand_in_inspector.h"
#include "lab/virtual_time/virtual_time.h"
#include "tests/firmware/station/fake_devices.h"

namespace hord::firmware {
namespace {

using ::testing::HasSubstr;
using State = firmware::State;

struct Observer final : StationObserver {
    std::vector<PartResult> results;
    std::vector<State> states;
    std::vector<Error> troubles;
    void on_result(const PartResult& result) override { results.push_back(result); }
    void on_state(State, State to) override { states.push_back(to); }
    void on_trouble(const Error& error) override { troubles.push_back(error); }
};

class StationTest : public ::testing::Test {
  protected:
    StationTest() {
        // Good light and a pass 20 ms after the frame, unless a test says otherwise.
        inspector =
            lab::make_stand_in_inspector(loop, 2, [this](std::uint32_t, const hal::FrameLease&) { return answer; });
        station.emplace(CoreConfig{}, Cell{loop, part_sensor, strobe, sensor, rejector, *inspector}, &observer);
    }
    void run() {
        station->run();
        rejector.link(true);
        ASSERT_EQ(station->snapshot().state, State::continuous_execution);
    }
    void part() { part_sensor.listener->on_edge({hal::PartEdge::Kind::arrives, loop.now(), ++edges, {}}); }
    void light_and_frame() {
        const auto& pulse = strobe.pulses.back();
        strobe.listener->on_strobe({pulse.exposure, true, pulse.start, pulse.width});
        sensor.deliver(sensor.requests.back().start);
    }

    lab::VirtualTime loop;
    FakePartSensor part_sensor;
    FakeStrobe strobe;
    FakeSensor sensor;
    FakeRejector rejector;
    lab::StandInAnswer answer{Judged{0, false, algo::Verdict::pass, algo::Reason::none, 0, 0.5F}, milliseconds(20)};
    std::unique_ptr<Inspector> inspector;
    Observer observer;
    std::optional<Station> station;
    std::uint32_t edges = 0;
};

TEST_F(StationTest, runs_as_soon_as_the_rejector_is_found) {
    station->run();
    EXPECT_EQ(station->snapshot().state, State::initialized);
    EXPECT_EQ(station->snapshot().faults_active, std::uint32_t{kFaultRejector});
    loop.run_for(std::chrono::seconds(10));
    EXPECT_EQ(station->snapshot().state, State::initialized);
    rejector.link(true);
    EXPECT_EQ(station->snapshot().state, State::continuous_execution);
    EXPECT_EQ(rejector.permits, std::vector<bool>{true});
}

TEST_F(StationTest, carries_a_good_part_through) {
    run();
    part();
    ASSERT_EQ(sensor.requests.size(), 1U);
    ASSERT_EQ(strobe.pulses.size(), 1U);
    loop.run_for(milliseconds(10));
    light_and_frame();
    EXPECT_EQ(sensor.given_back, 0);
    loop.run_for(milliseconds(20));
    ASSERT_EQ(observer.results.size(), 1U);
    EXPECT_EQ(observer.results[0].verdict, PartVerdict::pass);
    EXPECT_EQ(observer.results[0].latency_us, 30'000U);
    EXPECT_EQ(sensor.given_back, 1);
    loop.run_for(std::chrono::seconds(1));
    EXPECT_TRUE(rejector.commands.empty());
    EXPECT_EQ(station->snapshot().parts_on_line, 0U);
}

TEST_F(StationTest, carries_a_bad_part_to_the_ejector) {
    answer.judged.verdict = algo::Verdict::reject;
    answer.judged.reason = algo::Reason::deflection_gradient;
    run();
    const hal::TimePoint edge = loop.now();
    part();
    loop.run_for(milliseconds(10));
    light_and_frame();
    loop.run_for(milliseconds(364));
    EXPECT_TRUE(rejector.commands.empty());
    loop.run_for(milliseconds(1));
    ASSERT_EQ(rejector.commands.size(), 1U);
    EXPECT_EQ(rejector.commands[0].start, edge + milliseconds(395));
    rejector.listener->on_reject({1, hal::RejectReport::Outcome::confirmed, loop.now()});
    ASSERT_EQ(observer.results.size(), 1U);
    EXPECT_EQ(observer.results[0].reject, RejectState::confirmed);
}

TEST_F(StationTest, a_refused_trigger_is_reported_and_rejects_the_part) {
    run();
    sensor.no_buffer = true;
    part();
    ASSERT_EQ(observer.troubles.size(), 1U);
    EXPECT_EQ(observer.troubles[0].what, "no free buffer");
    EXPECT_EQ(station->snapshot().counters.unfit, 1U);
}

TEST_F(StationTest, a_full_inspector_rejects_and_gives_the_frame_back) {
    answer.after = milliseconds(300);
    run();
    for (int k = 0; k < 3; ++k) {
        part();
        loop.run_for(milliseconds(10));
        light_and_frame();
        loop.run_for(milliseconds(40));
    }
    EXPECT_EQ(sensor.given_back, 1);
    EXPECT_EQ(station->snapshot().counters.unfit, 1U);
    ASSERT_EQ(observer.troubles.size(), 1U);
    EXPECT_THAT(observer.troubles[0].message(), HasSubstr("queue is full"));
}

TEST_F(StationTest, a_rejector_that_refuses_stops_the_line) {
    answer.judged.verdict = algo::Verdict::reject;
    run();
    rejector.full = true;
    part();
    loop.run_for(milliseconds(10));
    light_and_frame();
    loop.run_for(milliseconds(500));
    EXPECT_TRUE(station->snapshot().line_stop);
    EXPECT_EQ(station->snapshot().state, State::error);
    EXPECT_EQ(rejector.permits, (std::vector<bool>{true, false}));
}

TEST_F(StationTest, recovers_from_a_lost_device_after_a_reset_and_runs_again) {
    run();
    sensor.listener->on_sensor_lost({ErrorCode::disconnected, "/dev/video0", "plug it in"});
    EXPECT_EQ(station->snapshot().state, State::error);
    EXPECT_EQ(observer.troubles.back().what, "/dev/video0");
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(station->snapshot().state, State::continuous_execution);
    EXPECT_EQ(rejector.starts, 1);  // the rejector was not restarted
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

TEST_F(StationTest, a_stopped_station_stays_stopped) {
    run();
    ASSERT_EQ(station->request(Command::stop), Answer::done);
    EXPECT_EQ(station->snapshot().state, State::ready);
    loop.run_for(std::chrono::seconds(5));
    EXPECT_EQ(station->snapshot().state, State::ready);
}

TEST_F(StationTest, its_end_closes_every_device_and_gives_every_frame_back) {
    answer.after = milliseconds(300);
    run();
    part();
    loop.run_for(milliseconds(10));
    light_and_frame();
    station.reset();
    EXPECT_EQ(part_sensor.listener, nullptr);
    EXPECT_EQ(strobe.listener, nullptr);
    EXPECT_EQ(sensor.listener, nullptr);
    EXPECT_EQ(rejector.listener, nullptr);
    EXPECT_EQ(rejector.permits.back(), false);
    EXPECT_EQ(sensor.given_back, 1);
    loop.run_for(std::chrono::seconds(5));  // nothing is left on the loop
    EXPECT_EQ(loop.pending(), 0U);
}

TEST_F(StationTest, takes_the_frame_size_from_the_sensor) { EXPECT_EQ(station->core().config().frame_bytes, 64U); }

}  // namespace
}  // namespace hord::firmware
