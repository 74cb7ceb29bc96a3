// What the interfaces check for every backend.
#include <vector>

#include <gtest/gtest.h>

#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"

namespace hord::hal {
namespace {

using namespace std::chrono_literals;

constexpr TimePoint at(Duration t) { return TimePoint(10s + t); }

struct Lights final : Strobe, StrobeListener {
    int channels = 2;
    bool works = true;
    std::vector<StrobePulse> fired;
    StrobeLimits limits() const override { return {2ms, 5ms, channels}; }
    Result<void> do_start(Listener&) override { return {}; }
    void do_stop() override {}
    Result<void> do_fire(const StrobePulse& pulse) override {
        if (!works) return fail(ErrorCode::io, "no light", "");
        fired.push_back(pulse);
        return {};
    }
    void on_strobe(const StrobeReport&) override {}
    void on_strobe_lost(const Error&) override {}
    ErrorCode refusal(const StrobePulse& pulse) {
        const auto done = fire(pulse);
        return done ? ErrorCode::internal : done.error().code;
    }
};

TEST(Strobe, only_channels_that_exist_are_lit) {
    Lights lights;
    EXPECT_EQ(lights.refusal({1, 1, at({}), 1ms}), ErrorCode::disconnected);
    ASSERT_TRUE(lights.start(lights));
    for (const std::uint32_t wrong : {0U, 4U, 5U, 0x80000000U})
        EXPECT_EQ(lights.refusal({1, wrong, at({}), 1ms}), ErrorCode::invalid_argument) << wrong;
    EXPECT_TRUE(lights.fire({1, 3, at({}), 1ms}));
    lights.channels = 31;
    EXPECT_EQ(lights.refusal({1, 0x80000000U, at(1s), 1ms}), ErrorCode::invalid_argument);
    lights.channels = 32;
    EXPECT_TRUE(lights.fire({1, 0xFFFFFFFFU, at(1s), 1ms}));
    EXPECT_EQ(lights.fired.size(), 2U);
}

TEST(Strobe, a_pulse_has_a_length_within_the_limit) {
    Lights lights;
    ASSERT_TRUE(lights.start(lights));
    for (const Duration wrong : {Duration(0), Duration(-1), Duration(2ms) + Duration(1)})
        EXPECT_EQ(lights.refusal({1, 1, at({}), wrong}), ErrorCode::invalid_argument);
    EXPECT_TRUE(lights.fire({1, 1, at({}), 2ms}));
    EXPECT_TRUE(lights.fire({1, 1, at(1s), Duration(1)}));
}

TEST(Strobe, the_light_rests_between_two_pulses) {
    Lights lights;
    ASSERT_TRUE(lights.start(lights));
    ASSERT_TRUE(lights.fire({1, 1, TimePoint{}, 1ms})) << "the first may be at any time";
    EXPECT_EQ(lights.refusal({2, 1, TimePoint(6ms) - Duration(1), 1ms}), ErrorCode::busy);
    lights.works = false;
    EXPECT_EQ(lights.refusal({2, 1, TimePoint(6ms), 1ms}), ErrorCode::io);
    lights.works = true;
    EXPECT_TRUE(lights.fire({2, 1, TimePoint(6ms), 1ms})) << "what was not lit needs no rest";
    EXPECT_EQ(lights.refusal({3, 1, TimePoint(12ms) - Duration(1), 1ms}), ErrorCode::busy);
}

struct Outputs final : Rejector, RejectorListener {
    std::vector<bool> permits;
    int commands = 0, starts = 0, stops = 0;
    bool absent = false;
    Result<void> do_start(Listener&) override {
        ++starts;
        if (absent) return fail(ErrorCode::not_found, "no module", "");
        return {};
    }
    void do_stop() override { ++stops; }
    Result<void> do_reject(const RejectCommand&) override {
        ++commands;
        return {};
    }
    void do_set_run_permit(bool permit) override { permits.push_back(permit); }
    void on_reject(const RejectReport&) override {}
    void on_rejector_link(bool, const Error&) override {}
};

TEST(Rejector, nothing_reaches_a_device_that_is_not_started) {
    Outputs outputs;
    EXPECT_EQ(outputs.reject({1, at({}), 1ms}).error().code, ErrorCode::disconnected);
    outputs.set_run_permit(true);
    outputs.stop();
    EXPECT_EQ(outputs.stops, 0);
    outputs.absent = true;
    EXPECT_FALSE(outputs.start(outputs));
    EXPECT_EQ(outputs.reject({1, at({}), 1ms}).error().code, ErrorCode::disconnected);
    outputs.absent = false;
    ASSERT_TRUE(outputs.start(outputs));
    EXPECT_EQ(outputs.start(outputs).error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(outputs.starts, 2);
    EXPECT_TRUE(outputs.reject({1, at({}), 1ms}));
    outputs.set_run_permit(true);
    outputs.stop();
    outputs.stop();
    EXPECT_EQ(outputs.stops, 1);
    outputs.set_run_permit(true);
    EXPECT_EQ(outputs.permits.size(), 1U);
    EXPECT_EQ(outputs.commands, 1);
}

TEST(Rejector, a_pulse_has_a_length) {
    Outputs outputs;
    ASSERT_TRUE(outputs.start(outputs));
    EXPECT_EQ(outputs.reject({1, at({}), 0ms}).error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(outputs.reject({1, at({}), -1ms}).error().code, ErrorCode::invalid_argument);
    EXPECT_TRUE(outputs.reject({1, at({}), Duration(1)}));
    EXPECT_EQ(outputs.commands, 1);
}

struct Camera final : Sensor, SensorListener {
    int triggers = 0;
    SensorFormat format() const override { return {}; }
    Result<void> do_start(Listener&) override { return {}; }
    void do_stop() override {}
    Result<void> do_trigger(const ExposureRequest&) override {
        ++triggers;
        return {};
    }
    void do_give_back(std::uint32_t) noexcept override {}
    void on_frame(FrameLease) override {}
    void on_sensor_lost(const Error&) override {}
};

TEST(Sensor, an_exposure_has_a_length_and_a_started_camera) {
    Camera camera;
    EXPECT_EQ(camera.trigger({1, at({}), 1ms}).error().code, ErrorCode::disconnected);
    ASSERT_TRUE(camera.start(camera));
    EXPECT_EQ(camera.trigger({1, at({}), 0ms}).error().code, ErrorCode::invalid_argument);
    EXPECT_TRUE(camera.trigger({1, at({}), Duration(1)}));
    EXPECT_EQ(camera.triggers, 1);
}

}  // namespace
}  // namespace hord::hal
