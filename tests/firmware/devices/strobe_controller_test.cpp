// A strobe controller from its lines in the configuration: opened, fired, probed, and set dark after a station's death.
#include "hal_sim/strobe_controller/strobe_controller.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/core/faults.h"
#include "firmware/devices/device_factory.h"
#include "firmware/devices/device_probe.h"
#include "firmware/devices/safe_state.h"

namespace hord::firmware {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

struct Ear final : hal::Strobe::Listener {
    void on_strobe(const hal::StrobeReport& report) override { reports.push_back(report); }
    void on_strobe_lost(const Error& error) override { ADD_FAILURE() << error.message(); }
    std::vector<hal::StrobeReport> reports;
};

class StrobeControllerConfig : public ::testing::Test {
  protected:
    StrobeControllerConfig() : loop_(std::move(*SdEventLoop::open())) {
        controller_ = std::move(*sim::StrobeController::open(*loop_, {.outputs = 2}));
        const auto parsed = parse_config(
            "[timing]\nexposure_us = 40000\nstrobe_us = 30000\n[line]\nmin_gap_ms = 200\n[strobe]\n"
            "backend = \"gardasoft\"\ntrigger = \"command\"\nhost = \"127.0.0.1\"\nport = " +
                std::to_string(controller_->port()) +
                "\nmax_on_us = 30000\n[[strobe.channel]]\noutput = 2\nrated_ma = 400\nbrightness_percent = 50\n",
            "cell.toml", "/etc/hord", NamedBackends::optional);
        EXPECT_TRUE(parsed) << parsed.error().message();
        if (parsed) config_ = *parsed;
    }
    std::unique_ptr<SdEventLoop> loop_;
    std::unique_ptr<sim::StrobeController> controller_;
    Config config_;
};

TEST_F(StrobeControllerConfig, the_factory_opens_it_and_it_lights_what_the_configuration_says) {
    EXPECT_EQ(simulated_devices(config_, {}) & kFaultStrobe, 0U);
    auto strobe = open_strobe(*loop_, config_);
    ASSERT_TRUE(strobe) << strobe.error().message();
    Ear ear;
    ASSERT_TRUE((*strobe)->start(ear));
    ASSERT_TRUE((*strobe)->fire({1, config_.core.strobe_channels, loop_->now() + 5ms, config_.core.strobe}));
    ASSERT_TRUE(loop_->run_until([&] { return !ear.reports.empty(); }, 10s));
    if (!ear.reports[0].lit) GTEST_SKIP() << "this machine did not run the strobe's thread for 30 ms";
    const auto pulses = controller_->pulses();
    ASSERT_EQ(pulses.size(), 1U);
    EXPECT_EQ(pulses[0].output, 2);
    EXPECT_EQ(pulses[0].width, config_.core.strobe);
    EXPECT_DOUBLE_EQ(pulses[0].amperes, 0.2);
}

TEST_F(StrobeControllerConfig, selftest_names_it_by_address_and_by_what_it_says_of_itself) {
    const auto each = open_each_device(*loop_, config_, {}, {}, false);
    ASSERT_TRUE(each) << each.error().message();
    EXPECT_THAT(each->cell.strobe.name, HasSubstr(":" + std::to_string(controller_->port()) + ", RT220-20 (HW02)"));
    EXPECT_TRUE(each->cell.strobe.device) << each->cell.strobe.device.error().message();
}

TEST_F(StrobeControllerConfig, a_dead_stations_lights_go_dark_and_a_controller_that_is_gone_is_said) {
    config_.strobe.controller->gardasoft.channels.push_back({.output = 1, .rated_ma = 500, .limits = {}});
    ASSERT_TRUE(controller_->continuous());
    ASSERT_TRUE(make_safe(config_, 1s));
    EXPECT_FALSE(controller_->continuous());
    controller_.reset();
    const auto gone = make_safe(config_, 1s);
    ASSERT_FALSE(gone);
    EXPECT_THAT(gone.error().message(), HasSubstr("strobe controller"));
}

}  // namespace
}  // namespace hord::firmware
