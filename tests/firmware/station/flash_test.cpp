// The flash test: one exposure, one flash, one judgement.
#include <tuple>

#include "tests/firmware/station/station_fixture.h"

namespace hord::firmware {
namespace {

using State = firmware::State;

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

}  // namespace
}  // namespace hord::firmware
