// The station between devices and core, in virtual time, with devices controlled by the test.
#include "firmware/station/station.h"

#include <tuple>

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
    std::vector<std::pair<std::uint32_t, std::string>> faults;  // raised, and why the line is stopped
    std::vector<FrameHandle> frames;                            // that the core was told of
    void on_step(State, const Event& event) override {
        if (const auto* frame = std::get_if<FrameArrived>(&event)) frames.push_back(frame->frame);
    }
    void on_result(const PartResult& result) override { results.push_back(result); }
    void on_fault(std::uint32_t raised, const Snapshot& now) override {
        faults.emplace_back(raised, text_of(now.line_stop_why));
    }
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

TEST_F(StationTest, a_part_sensor_that_is_absent_at_a_reset_leaves_the_station_initialized) {
    run();
    part_sensor.listener->on_part_sensor_lost({});
    part_sensor.absent = true;
    loop.run_for(milliseconds(250));
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    EXPECT_EQ(station->snapshot().state, State::initialized);
    EXPECT_NE(station->snapshot().faults_active & kFaultPartSensor, 0U);
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

// -- the flash test

class FlashTest : public StationTest {
  protected:
    void SetUp() override {
        ASSERT_EQ(station->request(Command::initialise), Answer::done);
        rejector.link(true);
        ASSERT_TRUE(station->test_possible());
    }
    void begin(Duration patience = milliseconds(400)) {
        began = loop.now();
        station->test_flash(patience, [this](const Station::FlashTest& flash) {
            ++ends;
            result = flash;
            ended = loop.now();
        });
    }
    void light(Duration late = {}, Duration longer = {}, bool lit = true) {
        const auto& pulse = strobe.pulses.back();
        strobe.listener->on_strobe({pulse.exposure, lit, pulse.start + late, pulse.width + longer});
    }
    hal::TimePoint began, ended;
    Station::FlashTest result;
    int ends = 0;
};

TEST_F(FlashTest, one_exposure_one_flash_one_judgement_and_nothing_counted) {
    const CoreConfig config;
    answer.judged.reason = algo::Reason::no_part;
    begin();
    EXPECT_FALSE(station->test_possible()) << "one at a time";
    ASSERT_EQ(sensor.requests.size(), 1U);
    ASSERT_EQ(strobe.pulses.size(), 1U);
    EXPECT_EQ(sensor.requests[0].start, began + config.trigger_lead);
    EXPECT_EQ(sensor.requests[0].length, config.exposure);
    EXPECT_EQ(strobe.pulses[0].start, began + config.trigger_lead + config.strobe_delay);
    EXPECT_EQ(strobe.pulses[0].width, config.strobe);
    loop.run_for(milliseconds(10));
    light();
    sensor.deliver(sensor.requests[0].start);
    EXPECT_EQ(ends, 0);
    loop.run_for(milliseconds(20));
    ASSERT_EQ(ends, 1);
    EXPECT_TRUE(result.lit && result.frame && result.judged);
    EXPECT_EQ(result.reason, algo::Reason::no_part);
    EXPECT_EQ(sensor.given_back, 1);
    EXPECT_TRUE(station->test_possible());
    EXPECT_TRUE(observer.frames.empty()) << "the core is not told of its frame";
    EXPECT_EQ(station->snapshot().counters.seen + station->snapshot().counters.inspected, 0U);
    EXPECT_TRUE(observer.results.empty());
    loop.run_for(std::chrono::seconds(2));
    EXPECT_EQ(ends, 1) << "the patience is over for nobody";
}

TEST_F(FlashTest, light_at_the_edges_of_its_tolerance_counts_and_beyond_does_not) {
    const Duration window = CoreConfig{}.strobe_window;
    const std::tuple<Duration, Duration, bool, bool> cases[] = {{window, {}, true, true},
                                                                {-window, {}, true, true},
                                                                {{}, window, true, true},
                                                                {{}, -window, true, true},
                                                                {window + Duration(1), {}, true, false},
                                                                {-window - Duration(1), {}, true, false},
                                                                {{}, window + Duration(1), true, false},
                                                                {{}, -window - Duration(1), true, false},
                                                                {{}, {}, false, false}};
    for (const auto& [late, longer, lit, good] : cases) {
        SCOPED_TRACE(late.count());
        begin();
        light(late, longer, lit);
        sensor.deliver(sensor.requests.back().start);
        loop.run_for(milliseconds(20));
        EXPECT_EQ(result.lit, good);
        EXPECT_TRUE(result.judged);
    }
    EXPECT_EQ(ends, 9);
}

TEST_F(FlashTest, a_frame_of_another_exposure_or_not_whole_is_not_its_frame) {
    const Duration window = CoreConfig{}.frame_window;
    begin();
    light();
    sensor.deliver(sensor.requests.back().start + window + Duration(1));
    sensor.deliver(sensor.requests.back().start - window - Duration(1));
    EXPECT_EQ(ends, 0);
    EXPECT_EQ(sensor.given_back, 2);
    loop.run_for(milliseconds(400));
    ASSERT_EQ(ends, 1);
    EXPECT_EQ(ended, began + milliseconds(400));
    EXPECT_TRUE(result.lit);
    EXPECT_FALSE(result.frame || result.judged);

    begin();
    light();
    sensor.deliver(sensor.requests.back().start + window, 63);  // short
    EXPECT_EQ(ends, 2);
    EXPECT_FALSE(result.frame || result.judged);
    loop.run_for(milliseconds(20));  // the light rests
    begin();
    sensor.deliver(sensor.requests.back().start - window, 64, true);  // corrupt
    EXPECT_EQ(ends, 2) << "the light is not reported yet";
    light();
    EXPECT_EQ(ends, 3);
    EXPECT_FALSE(result.frame || result.judged);
    EXPECT_EQ(sensor.given_back, 4);
}

TEST_F(FlashTest, a_second_frame_of_its_exposure_is_not_inspected) {
    begin();
    light();
    sensor.deliver(sensor.requests.back().start);
    sensor.deliver(sensor.requests.back().start);
    EXPECT_EQ(sensor.given_back, 1);
    loop.run_for(milliseconds(20));
    EXPECT_EQ(ends, 1);
    EXPECT_TRUE(result.judged);
    EXPECT_EQ(sensor.given_back, 2);
}

TEST_F(FlashTest, light_that_never_comes_ends_with_the_patience) {
    begin(milliseconds(60));
    sensor.deliver(sensor.requests.back().start);
    loop.run_for(milliseconds(60));
    ASSERT_EQ(ends, 1);
    EXPECT_TRUE(result.frame && result.judged);
    EXPECT_FALSE(result.lit);
    light();  // too late: nobody waits for it
    loop.run_for(milliseconds(60));
    EXPECT_EQ(ends, 1);
}

TEST_F(FlashTest, what_devices_refuse_ends_it_at_once) {
    strobe.hot = true;
    begin();
    loop.run_for({});
    ASSERT_EQ(ends, 1);
    EXPECT_EQ(ended, began);
    EXPECT_EQ(observer.troubles.back().what, "the light has not rested");
    sensor.no_buffer = true;
    begin();
    loop.run_for({});
    ASSERT_EQ(ends, 2);
    EXPECT_FALSE(result.lit || result.frame || result.judged);
    EXPECT_EQ(observer.troubles.back().what, "no free buffer");
    EXPECT_TRUE(strobe.pulses.empty()) << "no light without an exposure";
}

TEST_F(FlashTest, an_inspection_that_fails_or_is_full_is_no_judgement) {
    answer.judged.failed = true;
    begin();
    light();
    sensor.deliver(sensor.requests.back().start);
    loop.run_for(milliseconds(20));
    ASSERT_EQ(ends, 1);
    EXPECT_TRUE(result.lit && result.frame);
    EXPECT_FALSE(result.judged);

    begin();
    inspector->stop();  // it refuses
    sensor.deliver(sensor.requests.back().start);
    EXPECT_EQ(ends, 1);
    EXPECT_EQ(observer.troubles.size(), 1U);
    light();
    ASSERT_EQ(ends, 2);
    EXPECT_TRUE(result.frame);
    EXPECT_FALSE(result.judged);
    EXPECT_EQ(sensor.given_back, 2);
}

TEST_F(FlashTest, is_possible_only_on_an_empty_line_that_stands_with_every_device) {
    rejector.link(false);
    EXPECT_FALSE(station->test_possible());
    rejector.link(true);
    ASSERT_EQ(station->request(Command::arm), Answer::done);
    EXPECT_TRUE(station->test_possible());
    part();
    EXPECT_FALSE(station->test_possible()) << "a part is on the line";
    loop.run_for(std::chrono::seconds(1));
    station->request(Command::halt);
    EXPECT_FALSE(station->test_possible());
    ASSERT_EQ(station->request(Command::reset), Answer::done);
    station->run();
    rejector.link(true);
    EXPECT_EQ(station->snapshot().state, State::continuous_execution);
    EXPECT_FALSE(station->test_possible());
}

TEST_F(FlashTest, the_end_of_the_station_forgets_it) {
    begin();
    sensor.deliver(sensor.requests.back().start);
    station.reset();
    EXPECT_EQ(sensor.given_back, 1);
    loop.run_for(std::chrono::seconds(1));
    EXPECT_EQ(ends, 0);
    EXPECT_EQ(loop.pending(), 0U);
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
