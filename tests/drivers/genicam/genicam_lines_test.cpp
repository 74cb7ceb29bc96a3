// The camera's lines: its light, a wire that triggers it, a light barrier.
#include "drivers/camera_process/camera_part_sensor.h"
#include "drivers/camera_process/camera_strobe.h"
#include "tests/drivers/genicam/genicam_fixture.h"

namespace hord::drivers {
namespace {

using test::FakeGige;
using testing::AllOf;
using testing::HasSubstr;

struct LightEar final : hal::Strobe::Listener {
    void on_strobe(const hal::StrobeReport& report) override { reports.push_back(report); }
    void on_strobe_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::StrobeReport> reports;
    std::vector<Error> losses;
};

// The camera's output is set to its exposures; the pulse makes it expose, and the frame is the light's report.
TEST_F(Genicam, its_own_light_is_fired_by_the_strobe_and_reported_by_the_frame) {
    const FakeGige camera({"127.0.0.1", "S1", "lines"});
    GenicamSensorOptions options = software();
    options.light_line = "Line2";
    options.light_us = 200'000;
    start(options);
    CameraStrobe light(*loop_, *sensor_, {200ms, 100ms, 1}, 200ms);
    LightEar ear;
    ASSERT_TRUE(light.start(ear));
    // The sensor alone lights nothing, and so brings no frame.
    ASSERT_TRUE(sensor_->trigger({.exposure = 1, .start = loop_->now() + 1ms, .length = 200ms}));
    loop_->run_until([] { return false; }, 300ms);
    EXPECT_TRUE(ear_.frames.empty());
    const hal::TimePoint start_at = loop_->now() + 5ms;
    ASSERT_TRUE(light.fire({7, 1, start_at, 200ms}));
    EXPECT_EQ(light.fire({8, 1, start_at + 250ms, 200ms}).error().code, ErrorCode::busy);
    EXPECT_EQ(light.fire({8, 1, start_at + 1s, 100ms}).error().code, ErrorCode::invalid_argument);
    ASSERT_TRUE(run_until([&] { return !ear.reports.empty() && !ear_.frames.empty(); }));
    EXPECT_TRUE(ear.reports[0].lit);
    EXPECT_EQ(ear.reports[0].exposure, 7U);
    EXPECT_EQ(ear.reports[0].start, ear_.frames[0].info().exposure_start);  // the same exposure
    EXPECT_EQ(ear.reports[0].width, 200ms);
    light.stop();
}

TEST_F(Genicam, an_output_or_a_length_that_the_camera_has_not_is_refused_for_its_light) {
    const FakeGige camera({"127.0.0.1", "S1", "lines"});
    GenicamSensorOptions options = software();
    options.light_line = "Line7";
    options.light_us = 500;
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("LineSelector"), HasSubstr("Line1, Line2")));
    options.light_line = "Line2";
    options.light_us = 100'000'000'000;
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("ExposureTimeAbs"), HasSubstr(" to ")));
}

TEST_F(Genicam, a_camera_without_outputs_cannot_light) {
    const FakeGige camera;
    GenicamSensorOptions options = software();
    options.light_line = "Line2";
    options.light_us = 500;
    EXPECT_THAT(refusal(options).message(), HasSubstr("LineSelector"));
}

TEST_F(Genicam, its_light_without_a_frame_is_not_lit_and_a_lost_camera_is_a_lost_light) {
    FakeGige camera({"127.0.0.1", "S1", "lines", "mtu=20"});  // no packet passes
    GenicamSensorOptions options = software();
    options.light_line = "Line2";
    options.light_us = 20'000;
    start(options);
    CameraStrobe light(*loop_, *sensor_, {20ms, 10ms, 1}, 20ms);
    LightEar ear;
    ASSERT_TRUE(light.start(ear));
    ASSERT_TRUE(light.fire({1, 1, loop_->now() + 5ms, 20ms}));
    ASSERT_TRUE(run_until([&] { return !ear.reports.empty(); }));
    EXPECT_FALSE(ear.reports[0].lit);
    ASSERT_TRUE(light.fire({2, 1, loop_->now() + 20s, 20ms}));
    camera.lose();
    ASSERT_TRUE(run_until([&] { return !ear.losses.empty(); }, 60s));
    ASSERT_EQ(ear.reports.size(), 2U);
    EXPECT_FALSE(ear.reports[1].lit);
    EXPECT_EQ(light.fire({3, 1, loop_->now() + 30s, 20ms}).error().code, ErrorCode::disconnected);
    light.stop();
}

// The wire exposes, and nothing else: the fake camera ignores software triggers here.
TEST_F(Genicam, that_a_wire_triggers_brings_a_frame_for_each_pulse_of_it) {
    FakeGige camera({"127.0.0.1", "S1", "wire"});
    GenicamSensorOptions options = software();
    options.trigger = CameraTrigger::line;
    options.trigger_source = "Line1";
    start(options);
    ASSERT_TRUE(sensor_->trigger({.exposure = 1, .start = loop_->now(), .length = 1ms}));
    run_until([&] { return !ear_.frames.empty(); }, 200ms);
    EXPECT_TRUE(ear_.frames.empty()) << "without a pulse";
    for (std::uint32_t k = 1; k <= 5; ++k) {
        const hal::TimePoint asked = loop_->now();
        if (k > 1) {
            ASSERT_TRUE(sensor_->trigger({.exposure = k, .start = asked, .length = 1ms}));
        }
        camera.set_input(true);
        ASSERT_TRUE(run_until([&] { return !ear_.frames.empty(); })) << k;
        EXPECT_EQ(ear_.frames[0].info().sequence, k);
        EXPECT_GE(ear_.frames[0].info().exposure_start, asked);
        EXPECT_LE(ear_.frames[0].info().exposure_start, loop_->now());
        EXPECT_TRUE(is_one_frame(ear_.frames[0].view()));
        ear_.frames.clear();
        camera.set_input(false);
    }
}

struct BarrierEar final : hal::PartSensor::Listener {
    void on_edge(const hal::PartEdge& edge) override { edges.push_back(edge); }
    void on_encoder(const hal::EncoderReading&) override {}
    void on_part_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::PartEdge> edges;
    std::vector<Error> losses;
};

class GenicamBarrier : public Genicam {
  protected:
    static GenicamSensorOptions with_barrier() {
        GenicamSensorOptions options = software();
        options.barrier_line = "Line1";
        return options;
    }
    void listen(bool active_low = false) {
        ASSERT_TRUE(sensor_);
        barrier_ = std::make_unique<CameraPartSensor>(*loop_, *sensor_, active_low);
        ASSERT_TRUE(barrier_->start(ear_of_barrier_));
    }
    void TearDown() override {
        barrier_.reset();
        Genicam::TearDown();
    }
    // Edges one after the other, from an active one; each is awaited, but the `lost`-th.
    void pass_edges(FakeGige& camera, std::size_t count, std::size_t lost = 0) {
        std::size_t expected = ear_of_barrier_.edges.size();
        for (std::size_t k = 1; k <= count; ++k) {
            camera.set_input(k % 2 == 1);
            if (k != lost) ++expected;
            ASSERT_TRUE(run_until([&] { return ear_of_barrier_.edges.size() >= expected; })) << k;
            if (k == lost) run_until([] { return false; }, 100ms);
        }
    }
    std::vector<std::uint32_t> sequences() const {
        std::vector<std::uint32_t> out;
        for (const hal::PartEdge& edge : ear_of_barrier_.edges) out.push_back(edge.sequence);
        return out;
    }
    std::unique_ptr<CameraPartSensor> barrier_;
    BarrierEar ear_of_barrier_;
};

// The request numbers of the fake camera's messages begin near 65535.
TEST_F(GenicamBarrier, edges_are_told_with_the_cameras_time_and_without_a_gap) {
    for (const char* numbers : {"events", "events=value"}) {
        FakeGige camera({"127.0.0.1", "S1", numbers});
        start(with_barrier());
        listen();
        ASSERT_FALSE(HasFatalFailure());
        const hal::TimePoint before = loop_->now();
        pass_edges(camera, 8);
        EXPECT_EQ(sequences(), (std::vector<std::uint32_t>{1, 2, 3, 4, 5, 6, 7, 8})) << numbers;
        for (std::size_t k = 0; k < 8; ++k) {
            const hal::PartEdge& edge = ear_of_barrier_.edges[k];
            EXPECT_EQ(edge.kind, k % 2 == 0 ? hal::PartEdge::Kind::arrives : hal::PartEdge::Kind::leaves);
            EXPECT_GE(edge.at, (k == 0 ? before : ear_of_barrier_.edges[k - 1].at) - 50ms);
            EXPECT_LE(edge.at, loop_->now());
        }
        EXPECT_TRUE(frame()) << "frames come beside edges";
        barrier_.reset();
        ear_of_barrier_.edges.clear();
        sensor_->stop();
    }
}

TEST_F(GenicamBarrier, a_lost_message_leaves_a_gap_and_one_that_comes_twice_is_one_edge) {
    FakeGige camera({"127.0.0.1", "S1", "events", "twice", "lose-event=3"});
    start(with_barrier());
    listen();
    ASSERT_FALSE(HasFatalFailure());
    pass_edges(camera, 6, 3);
    EXPECT_EQ(sequences(), (std::vector<std::uint32_t>{1, 2, 4, 5, 6}));
}

TEST_F(GenicamBarrier, of_an_input_that_is_active_low_a_falling_edge_is_an_arrival) {
    FakeGige camera({"127.0.0.1", "S1", "events"});
    start(with_barrier());
    listen(true);
    ASSERT_FALSE(HasFatalFailure());
    pass_edges(camera, 2);
    EXPECT_EQ(ear_of_barrier_.edges[0].kind, hal::PartEdge::Kind::leaves);
    EXPECT_EQ(ear_of_barrier_.edges[1].kind, hal::PartEdge::Kind::arrives);
}

TEST_F(GenicamBarrier, a_camera_that_cannot_tell_the_edges_is_refused_with_a_cure) {
    {
        const FakeGige camera;
        EXPECT_THAT(refusal(with_barrier()).message(), AllOf(HasSubstr("no events"), HasSubstr("GPIO line")));
    }
    const FakeGige camera({"127.0.0.1", "S1", "events"});
    GenicamSensorOptions options = with_barrier();
    options.barrier_line = "Line7";
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("EventSelector"), HasSubstr("Line1RisingEdge")));
}

}  // namespace
}  // namespace hord::drivers
