// The part sensor on scripted lines: what the contract suite, which also runs on it, does not test.
#include "drivers/gpio/gpio_part_sensor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "tests/drivers/gpio/scripted_lines.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using hal::PartEdge;
using testing::HasSubstr;

constexpr hal::Duration kPatience = 120s;

struct Ear final : hal::PartSensor::Listener {
    void on_edge(const PartEdge& edge) override { edges.push_back(edge); }
    void on_encoder(const hal::EncoderReading& reading) override { readings.push_back(reading); }
    void on_part_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<PartEdge> edges;
    std::vector<hal::EncoderReading> readings;
    std::vector<Error> losses;
};

struct GpioPartSensorTest : testing::Test {
    void open(bool with_encoder = false) {
        GpioPartSensorOptions options;
        options.line.line = "BARRIER";
        options.debounce = 1ms;
        if (with_encoder) {
            options.encoder.emplace();
            options.encoder->line = "ENCODER";
        }
        auto opened = GpioPartSensor::open(*loop, options, [this](const GpioLine& line, GpioEdges edges) {
            EXPECT_EQ(edges, line.line == "ENCODER" ? GpioEdges::activations : GpioEdges::both);
            return scripted::Input::request(line.line == "ENCODER" ? encoder : barrier);
        });
        ASSERT_TRUE(opened) << opened.error().message();
        sensor = std::move(*opened);
        ASSERT_TRUE(sensor->start(ear));
    }
    bool run_until(const std::function<bool()>& done) { return loop->run_until(done, kPatience); }

    std::unique_ptr<firmware::SdEventLoop> loop = std::move(*firmware::SdEventLoop::open());
    std::shared_ptr<scripted::Wire> barrier = std::make_shared<scripted::Wire>(),
                                    encoder = std::make_shared<scripted::Wire>();
    Ear ear;
    std::unique_ptr<GpioPartSensor> sensor;
};

TEST_F(GpioPartSensorTest, bounces_are_taken_out_and_the_edge_has_the_time_of_the_first) {
    open();
    const hal::TimePoint at = loop->now() - 10ms;
    barrier->change(true, at);
    barrier->change(false, at + 300us);
    barrier->change(true, at + 500us);
    barrier->change(false, at + 8ms);
    ASSERT_TRUE(run_until([&] { return ear.edges.size() == 2; }));
    EXPECT_EQ(ear.edges[0].at, at);
    EXPECT_EQ(ear.edges[0].kind, PartEdge::Kind::arrives);
    EXPECT_EQ(ear.edges[1].at, at + 8ms);
    EXPECT_EQ(ear.edges[1].sequence, 2U);
    sensor->stop();
}

TEST_F(GpioPartSensorTest, an_edge_that_nobody_saw_is_found_at_the_next_look_and_leaves_a_gap) {
    open();
    barrier->change_unseen(true);
    ASSERT_TRUE(run_until([&] { return !ear.edges.empty(); }));
    EXPECT_EQ(ear.edges[0].sequence, 2U);
    sensor->stop();
}

TEST_F(GpioPartSensorTest, edges_that_the_kernel_lost_leave_a_gap) {
    open();
    barrier->level = true;
    barrier->tell({true, loop->now(), 3});
    ASSERT_TRUE(run_until([&] { return !ear.edges.empty(); }));
    EXPECT_EQ(ear.edges[0].sequence, 4U);
    sensor->stop();
}

TEST_F(GpioPartSensorTest, a_part_that_covers_it_at_the_start_shows_only_its_back_edge) {
    barrier->level = true;
    open();
    barrier->change(false, loop->now());
    ASSERT_TRUE(run_until([&] { return !ear.edges.empty(); }));
    EXPECT_EQ(ear.edges[0].kind, PartEdge::Kind::leaves);
    EXPECT_EQ(ear.edges[0].sequence, 1U);
    sensor->stop();
}

TEST_F(GpioPartSensorTest, a_line_that_does_not_come_to_rest_is_a_lost_sensor) {
    open();
    const hal::TimePoint at = loop->now() - 1s;
    for (int k = 0; k <= 501; ++k) barrier->change(k % 2 == 0, at + k * 100us);
    ASSERT_TRUE(run_until([&] { return !ear.losses.empty(); }));
    EXPECT_THAT(ear.losses[0].what, HasSubstr("does not come to rest"));
    EXPECT_TRUE(ear.edges.empty());
    sensor->stop();
}

TEST_F(GpioPartSensorTest, a_chip_that_went_away_is_noticed_although_nobody_is_woken) {
    open();
    barrier->there = false;
    ASSERT_TRUE(run_until([&] { return !ear.losses.empty(); }));
    EXPECT_EQ(ear.losses[0].code, ErrorCode::disconnected);
    sensor->stop();
    EXPECT_FALSE(sensor->start(ear));
    barrier->there = true;
    EXPECT_TRUE(sensor->start(ear));
    sensor->stop();
}

TEST_F(GpioPartSensorTest, each_edge_has_the_encoders_position_at_its_time) {
    open(true);
    const hal::TimePoint at = loop->now() - 20ms;
    for (int k = 1; k <= 10; ++k) encoder->change(true, at + k * 1ms);
    barrier->change(true, at + 4500us);
    barrier->change(false, at + 8ms);
    ASSERT_TRUE(
        run_until([&] { return ear.edges.size() == 2 && !ear.readings.empty() && ear.readings.back().counts == 10; }));
    EXPECT_EQ(ear.edges[0].counts, 4);
    EXPECT_EQ(ear.edges[1].counts, 8);
    sensor->stop();
}

TEST_F(GpioPartSensorTest, lost_counts_lose_the_position_and_so_the_sensor) {
    open(true);
    encoder->tell({true, loop->now(), 1});
    ASSERT_TRUE(run_until([&] { return !ear.losses.empty(); }));
    EXPECT_THAT(ear.losses[0].what, HasSubstr("counts were lost"));
    sensor->stop();
}

TEST(GpioLines, a_chip_that_is_not_there_is_named_with_those_that_are) {
    GpioLine line;
    line.chip = "no-such-chip";
    line.line = "6";
    const auto input = request_input(line, GpioEdges::both);
    ASSERT_FALSE(input);
    EXPECT_THAT(input.error().what, HasSubstr("no-such-chip"));
    EXPECT_FALSE(input.error().cure.empty());
    EXPECT_FALSE(request_outputs({line}));
}

TEST(GpioLines, an_offset_is_digits_alone) {
    EXPECT_EQ(gpio::offset_of("17"), 17);
    EXPECT_EQ(gpio::offset_of("GPIO17"), -1);
    EXPECT_EQ(gpio::offset_of("-1"), -1);
    EXPECT_EQ(gpio::offset_of(""), -1);
    EXPECT_EQ(gpio::offset_of("99999999999999999999"), -1);
}

}  // namespace
}  // namespace hord::drivers
