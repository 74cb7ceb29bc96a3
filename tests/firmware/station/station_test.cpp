// The station between devices and core: parts, losses, recovery, stops.
#include "tests/firmware/station/station_fixture.h"

namespace hord::firmware {
namespace {

using ::testing::HasSubstr;
using State = firmware::State;

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
    observer.states.clear();
    observer.faults.clear();
    station.reset();
    EXPECT_TRUE(observer.states.empty() && observer.faults.empty()) << "its observer may be gone";
    EXPECT_EQ(part_sensor.listener, nullptr);
    EXPECT_EQ(strobe.listener, nullptr);
    EXPECT_EQ(sensor.listener, nullptr);
    EXPECT_EQ(rejector.listener, nullptr);
    EXPECT_EQ(rejector.permits.back(), false);
    EXPECT_EQ(sensor.given_back, 1);
    loop.run_for(std::chrono::seconds(5));  // nothing is left on the loop
    EXPECT_EQ(loop.pending(), 0U);
}

// -- automatic operation

TEST_F(StationTest, only_run_makes_it_run_again_after_a_reset) {
    ASSERT_EQ(station->request(Command::initialise), Answer::done);
    rejector.link(true);
    ASSERT_EQ(station->request(Command::arm), Answer::done);
    ASSERT_EQ(station->request(Command::start_continuous), Answer::done);
    sensor.listener->on_sensor_lost({});
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(station->snapshot().state, State::initialized);
    station->run();  // and it does so in any state, not only at first
    EXPECT_EQ(station->snapshot().state, State::continuous_execution);
}

TEST_F(StationTest, what_a_person_stopped_does_not_run_again_by_itself_until_it_is_started) {
    for (const Command command : {Command::stop, Command::abort, Command::disarm, Command::halt}) {
        SCOPED_TRACE(name_of(command));
        run();
        if (command == Command::disarm) {
            ASSERT_EQ(station->request(Command::abort), Answer::done);
        }
        ASSERT_EQ(station->request(command), Answer::done);
        const State left = station->snapshot().state;
        loop.run_for(milliseconds(500));
        EXPECT_EQ(station->snapshot().state, left);
        if (left == State::ready) {
            ASSERT_EQ(station->request(Command::disarm), Answer::done);
        } else if (left == State::halted) {
            ASSERT_EQ(station->request(Command::reset), Answer::done);
            ASSERT_EQ(station->request(Command::initialise), Answer::done);
            rejector.link(true);
        }
        EXPECT_EQ(station->snapshot().state, State::initialized);
        ASSERT_EQ(station->request(Command::arm), Answer::done);
        ASSERT_EQ(station->request(Command::start_continuous), Answer::done);
        sensor.listener->on_sensor_lost({});
        ASSERT_EQ(station->request(Command::reset), Answer::done);
        EXPECT_EQ(station->snapshot().state, State::continuous_execution) << "start_continuous resumes it";
        station->request(Command::halt);
        ASSERT_EQ(station->request(Command::reset), Answer::done);
    }
}

TEST_F(StationTest, a_refused_start_resumes_nothing) {
    run();
    station->request(Command::stop);
    sensor.listener->on_sensor_lost({});
    ASSERT_EQ(station->snapshot().state, State::error);
    EXPECT_EQ(station->request(Command::start_continuous), Answer::not_in_this_state);
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(station->snapshot().state, State::initialized);
}

class StationWithPlc : public StationTest {
  protected:
    void with(PlcPolicy policy) {
        CoreConfig config;
        config.plc_policy = policy;
        station.reset();
        station.emplace(config, Cell{loop, part_sensor, strobe, sensor, rejector, *inspector}, &observer);
        run();
    }
    State after_loss_and_reset() {
        station->plc_lost();
        sensor.listener->on_sensor_lost({});
        station->plc_back();
        EXPECT_EQ(station->request(Command::reset), Answer::done);
        return station->snapshot().state;
    }
};

TEST_F(StationWithPlc, a_line_that_stopped_without_its_plc_waits_for_a_start) {
    with(PlcPolicy::stop);
    station->plc_lost();
    EXPECT_EQ(station->snapshot().state, State::ready);
    EXPECT_EQ(station->snapshot().faults_active, std::uint32_t{kFaultPlc});
    EXPECT_EQ(after_loss_and_reset(), State::initialized);
}

TEST_F(StationWithPlc, other_policies_do_not_suspend_automatic_operation) {
    with(PlcPolicy::reject_all);
    EXPECT_EQ(after_loss_and_reset(), State::continuous_execution);
    with(PlcPolicy::none);
    EXPECT_EQ(after_loss_and_reset(), State::continuous_execution);
}

TEST_F(StationTest, faults_from_outside_and_an_unknown_line_reach_the_core) {
    run();
    station->outside_faults(kFaultStore);
    EXPECT_EQ(station->snapshot().faults_active, std::uint32_t{kFaultStore});
    EXPECT_EQ(station->snapshot().state, State::continuous_execution);
    station->outside_faults(0);
    EXPECT_EQ(station->snapshot().faults_active, 0U);
    station->line_unknown();
    EXPECT_TRUE(station->snapshot().line_stop);
    EXPECT_EQ(rejector.permits.back(), false);
}

// -- devices

TEST_F(StationTest, a_part_sensor_that_is_absent_at_a_reset_leaves_the_station_initialized) {
    run();
    part_sensor.listener->on_part_sensor_lost({});
    part_sensor.absent = true;
    loop.run_for(milliseconds(250));
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(station->snapshot().state, State::initialized);
    EXPECT_NE(station->snapshot().faults_active & kFaultPartSensor, 0U);
}

TEST_F(StationTest, the_rejectors_link_is_needed_and_its_loss_drops_the_permit) {
    run();
    rejector.link(false);
    EXPECT_EQ(station->snapshot().state, State::error);
    EXPECT_EQ(observer.troubles.back().what, "module at 10.0.0.7");
    EXPECT_EQ(rejector.permits, (std::vector<bool>{true, false}));
    rejector.link(true);
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(rejector.permits, (std::vector<bool>{true, false, true}));
}

TEST_F(StationTest, a_rejector_that_is_still_away_at_a_reset_is_not_opened_twice) {
    run();
    rejector.link(false);
    const std::size_t told = observer.troubles.size();
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(station->snapshot().state, State::initialized);
    EXPECT_EQ(observer.troubles.size(), told);
    EXPECT_EQ(rejector.starts, 1);
    rejector.link(true);
    EXPECT_EQ(station->snapshot().state, State::continuous_execution);
}

TEST_F(StationTest, the_place_of_a_frame_that_is_given_back_is_used_again) {
    run();
    for (int k = 0; k < 20; ++k) {
        part();
        loop.run_for(milliseconds(10));
        light_and_frame();
        loop.run_for(milliseconds(40));
    }
    ASSERT_EQ(observer.frames.size(), 20U);
    EXPECT_THAT(observer.frames, testing::Each(FrameHandle{0}));
    EXPECT_EQ(sensor.given_back, 20);
}

// More results than one step of the core has room for: the rest follows at the same moment.
TEST_F(StationTest, a_silent_encoder_gives_up_a_long_line_at_once) {
    constexpr int kParts = 150;
    CoreConfig config;
    config.by_encoder = true;
    config.transport_counts = 1'000'000;
    config.max_parts = 200;
    config.max_failures_in_a_row = 0;
    station.reset();
    station.emplace(config, Cell{loop, part_sensor, strobe, sensor, rejector, *inspector}, &observer);
    run();
    for (int k = 0; k < kParts; ++k) {
        part_sensor.listener->on_edge({hal::PartEdge::Kind::arrives, loop.now(), ++edges, 300 * k});
        loop.run_for(milliseconds(30));
    }
    EXPECT_TRUE(observer.results.empty());
    loop.run_for(config.encoder_timeout);
    EXPECT_EQ(observer.results.size(), std::size_t{kParts});
    EXPECT_TRUE(station->snapshot().line_stop);
}

TEST_F(StationTest, a_halt_with_a_part_on_the_line_tells_the_fault_and_why_before_it_is_halted) {
    run();
    EXPECT_TRUE(observer.faults.empty()) << "devices that were not open yet are no fault";
    part();
    ASSERT_EQ(station->request(Command::halt), Answer::done);
    ASSERT_EQ(observer.faults.size(), 1U);
    EXPECT_EQ(observer.faults[0].first, std::uint32_t{kFaultRejectUnconfirmed});
    EXPECT_EQ(observer.faults[0].second,
              "the line had no run permit while part 1 came or was on its way: its place is not known");
    EXPECT_EQ(observer.states.back(), State::halted);
    loop.run_for(milliseconds(300));
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(observer.faults.size(), 1U);
    EXPECT_EQ(text_of(station->snapshot().line_stop_why), "");
}

// More parts than one step of the core has room for: passed, to be rejected, commanded, and not yet judged.
TEST_F(StationTest, its_end_gives_every_part_on_the_line_its_one_result) {
    constexpr int kParts = 150;
    CoreConfig config;
    config.transport = std::chrono::seconds(10);
    config.max_parts = 200;
    station.reset();
    station.emplace(config, Cell{loop, part_sensor, strobe, sensor, rejector, *inspector}, &observer);
    run();
    answer.judged.verdict = algo::Verdict::reject;
    for (int k = 0; k < kParts; ++k) {
        part();
        loop.run_for(milliseconds(10));
        light_and_frame();
        loop.run_for(milliseconds(40));
    }
    part();
    EXPECT_TRUE(observer.results.empty());
    station->end();
    ASSERT_EQ(observer.results.size(), std::size_t{kParts} + 1);
    for (std::uint32_t k = 0; k <= kParts; ++k) {
        EXPECT_EQ(observer.results[k].part, k + 1);
        EXPECT_EQ(observer.results[k].verdict, k < kParts ? PartVerdict::reject : PartVerdict::unfit);
        EXPECT_EQ(observer.results[k].reject, RejectState::failed);
    }
    EXPECT_EQ(observer.states.back(), State::halted);
    EXPECT_NE(station->snapshot().faults_active & kFaultRejectUnconfirmed, 0U);
    station.reset();
    EXPECT_EQ(observer.results.size(), std::size_t{kParts} + 1);
}

TEST_F(StationTest, halt_closes_what_reset_and_initialise_open_again) {
    run();
    ASSERT_EQ(station->request(Command::halt), Answer::done);
    EXPECT_EQ(part_sensor.listener, nullptr);
    EXPECT_EQ(strobe.listener, nullptr);
    EXPECT_EQ(sensor.listener, nullptr);
    EXPECT_EQ(rejector.stops, 1);
    EXPECT_EQ(rejector.permits.back(), false);
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    ASSERT_EQ(station->request(Command::initialise), Answer::done);
    EXPECT_EQ(rejector.starts, 2);
    EXPECT_NE(part_sensor.listener, nullptr);
}

TEST_F(StationTest, takes_the_frame_size_from_the_sensor) {
    for (const auto& [bits, bytes] : {std::pair{8, 96U}, {9, 192U}, {16, 192U}}) {
        sensor.shape = {12, 8, bits, 4};
        const Station other(CoreConfig{}, Cell{loop, part_sensor, strobe, sensor, rejector, *inspector}, &observer);
        EXPECT_EQ(other.core().config().frame_bytes, bytes) << bits;
    }
}

}  // namespace
}  // namespace hord::firmware
