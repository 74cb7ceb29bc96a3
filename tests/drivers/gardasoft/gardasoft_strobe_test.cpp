// The strobe behind a Gardasoft controller, on a simulated controller over real sockets and a pseudo-terminal.
#include "drivers/gardasoft/gardasoft_strobe.h"

#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/gpio/gpio_strobe.h"
#include "hal_sim/strobe_controller/strobe_controller.h"
#include "tests/drivers/gpio/scripted_lines.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using firmware::SdEventLoop;
using sim::StrobeController;
using testing::HasSubstr;
using Fault = StrobeController::Fault;

// Long pulses: a busy machine may begin them late.
constexpr hal::Duration kPulse = 400ms;

struct Ear final : hal::Strobe::Listener {
    void on_strobe(const hal::StrobeReport& report) override { reports.push_back(report); }
    void on_strobe_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::StrobeReport> reports;
    std::vector<Error> losses;
};

class GardasoftStrobeTest : public testing::Test {
  protected:
    void SetUp() override {
        loop_ = std::move(*SdEventLoop::open());
        plug_in({.outputs = 2});
    }
    void plug_in(StrobeController::Options options) {
        controller_ = std::move(*StrobeController::open(*loop_, options));
        options_.host = options.serial ? "" : "127.0.0.1";
        options_.port = controller_->port();
        options_.device = controller_->device();
        options_.pulse = kPulse;
        options_.channels = {{.output = 1, .rated_ma = 500, .limits = {1s, 5ms, 1}},
                             {.output = 2, .rated_ma = 400, .brightness_percent = 50, .limits = {1s, 5ms, 1}}};
    }
    auto open(std::unique_ptr<hal::Strobe> trigger = nullptr) {
        return GardasoftStrobe::open(*loop_, options_, std::move(trigger));
    }
    // Throws if it does not start: a test that went on would have no strobe.
    void open_and_start() {
        auto opened = open();
        if (!opened) throw std::runtime_error(opened.error().message());
        strobe_ = std::move(*opened);
        if (const auto started = strobe_->start(ear_); !started) throw std::runtime_error(started.error().message());
    }
    Result<void> fire(std::uint32_t channels = 1, hal::Duration ahead = 5ms) {
        return strobe_->fire({++exposure_, channels, loop_->now() + ahead, kPulse});
    }
    bool until(const std::function<bool()>& done) { return loop_->run_until(done, 10s); }
    // Starts again as soon as the driver has set the controller up.
    bool recovers() {
        strobe_->stop();
        return until([&] { return strobe_->start(ear_).has_value(); });
    }

    std::unique_ptr<SdEventLoop> loop_;
    std::unique_ptr<StrobeController> controller_;
    GardasoftStrobeOptions options_;
    std::unique_ptr<GardasoftStrobe> strobe_;
    Ear ear_;
    std::uint32_t exposure_ = 0;
};

TEST_F(GardasoftStrobeTest, the_controller_is_dark_set_up_and_fires_with_length_and_current_as_configured) {
    EXPECT_TRUE(controller_->continuous());  // as it came from the factory
    open_and_start();
    EXPECT_FALSE(controller_->continuous());
    EXPECT_TRUE(controller_->pulses().empty());
    ASSERT_TRUE(fire(0b11));
    ASSERT_TRUE(until([&] { return !ear_.reports.empty(); }));
    EXPECT_TRUE(ear_.reports[0].lit);
    EXPECT_EQ(ear_.reports[0].width, kPulse);
    const auto pulses = controller_->pulses();
    ASSERT_EQ(pulses.size(), 2U);
    EXPECT_EQ(pulses[0].output, 1);
    EXPECT_DOUBLE_EQ(pulses[0].amperes, 0.5);
    EXPECT_EQ(pulses[1].output, 2);
    EXPECT_DOUBLE_EQ(pulses[1].amperes, 0.2);
    for (const auto& pulse : pulses) {
        EXPECT_EQ(pulse.width, kPulse);
        EXPECT_LE(pulse.at, ear_.reports[0].start);  // the report has the latest time at which it can have begun
    }
    strobe_.reset();
    EXPECT_FALSE(controller_->continuous());
    controller_->trigger(1);  // nobody is there: a stray trigger lights nothing
    EXPECT_EQ(controller_->pulses().size(), 2U);
}

TEST_F(GardasoftStrobeTest, limits_hold_below_every_caller) {
    options_.channels[0].limits.min_rest = 500ms;
    options_.channels[1].limits.min_rest = 500ms;
    open_and_start();
    EXPECT_EQ(strobe_->fire({1, 1, loop_->now() + 5ms, kPulse + 1ms}).error().code, ErrorCode::invalid_argument);
    const auto shorter = strobe_->fire({1, 1, loop_->now() + 5ms, kPulse / 2});
    ASSERT_FALSE(shorter);
    EXPECT_THAT(shorter.error().message(), HasSubstr("timing.strobe_us"));
    const hal::TimePoint start = loop_->now() + 5ms;
    ASSERT_TRUE(strobe_->fire({2, 1, start, kPulse}));
    EXPECT_EQ(strobe_->fire({3, 1, start + kPulse + 499ms, kPulse}).error().code, ErrorCode::busy);
    ASSERT_TRUE(until([&] { return !ear_.reports.empty(); }));
    // The last guard: whoever triggers, the controller keeps the rest.
    controller_->trigger(1);
    EXPECT_EQ(controller_->pulses().size(), 1U);
    EXPECT_EQ(controller_->ignored(), 1);
}

TEST_F(GardasoftStrobeTest, options_that_hurt_a_light_are_refused_all_at_once_and_nothing_is_sent) {
    options_.channels[0].rated_ma = 5000;
    options_.channels[1].brightness_percent = 200;
    options_.delay = 1ms + 1ns;
    const auto opened = open();
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, ErrorCode::invalid_argument);
    EXPECT_THAT(opened.error().what,
                testing::AllOf(HasSubstr("rated_ma"), HasSubstr("brightness"), HasSubstr("delay")));
    EXPECT_EQ(controller_->connections(), 0);
}

TEST_F(GardasoftStrobeTest, an_output_that_the_controller_has_not_is_refused_with_the_cure) {
    options_.channels[1].output = 3;
    const auto opened = open();
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, ErrorCode::refused);
    EXPECT_THAT(opened.error().message(), testing::AllOf(HasSubstr("RS3"), HasSubstr("fewer outputs")));
}

TEST_F(GardasoftStrobeTest, a_controller_that_does_not_answer_as_it_should_is_refused) {
    const std::vector<std::tuple<Fault, ErrorCode, const char*>> cases = {
        {Fault::silent, ErrorCode::timeout, "does not answer"},
        {Fault::busy, ErrorCode::timeout, "within 100 ms"},
        {Fault::garbage, ErrorCode::unreadable, "answers \"RS1,0\" with"},
        {Fault::endless, ErrorCode::unreadable, "without an end"},
        {Fault::adjusts, ErrorCode::refused, "changed a value"},
        {Fault::rounds, ErrorCode::refused, "its pulse is 800 ms, not 400 ms"},
        {Fault::wrong_output, ErrorCode::refused, "answers for output"},
        {Fault::stays_on, ErrorCode::refused, "not in pulse mode"},
    };
    for (const auto& [fault, code, says] : cases) {
        controller_->misbehave(fault);
        const auto opened = open();
        ASSERT_FALSE(opened) << says;
        EXPECT_EQ(opened.error().code, code) << opened.error().message();
        EXPECT_THAT(opened.error().message(), HasSubstr(says));
        EXPECT_FALSE(opened.error().cure.empty());
        controller_->misbehave(Fault::none);
        ASSERT_TRUE(until([&] { return open().has_value(); }));  // a busy one answers what has waited first
    }
    EXPECT_TRUE(controller_->pulses().empty());
}

TEST_F(GardasoftStrobeTest, a_refused_set_up_leaves_every_output_dark_whatever_was_refused) {
    const std::vector<std::pair<Fault, const char*>> cases = {
        {Fault::stays_on, ""}, {Fault::rounds, ""},    {Fault::adjusts, ""},    {Fault::wrong_output, ""},
        {Fault::silent, "VL"}, {Fault::silent, "ST2"}, {Fault::garbage, "RT2"}, {Fault::endless, "ST1"}};
    for (const auto& [fault, at] : cases) {
        controller_->power_cycle();
        controller_->misbehave(fault, at);
        const auto opened = open();
        ASSERT_FALSE(opened) << at;
        ASSERT_TRUE(until([&] { return !controller_->continuous(); })) << static_cast<int>(fault) << at;
        for (const int output : {1, 2}) controller_->trigger(output);  // a stray one lights nothing
        EXPECT_TRUE(controller_->pulses().empty()) << static_cast<int>(fault) << at;
    }
}

TEST_F(GardasoftStrobeTest, bytes_that_mean_nothing_are_an_answer_to_no_command) {
    options_.response_timeout = 5s;  // garbage comes at once, but this machine may be busy
    for (const char* command : {"RS", "TT", "GT", "GR", "VL", "RT", "ST"}) {
        controller_->misbehave(Fault::garbage, command);
        const auto opened = open();
        ASSERT_FALSE(opened) << command;
        EXPECT_EQ(opened.error().code, ErrorCode::unreadable) << opened.error().message();
    }
    controller_->misbehave(Fault::garbage, "VR");
    EXPECT_EQ(identify(options_).error().code, ErrorCode::unreadable);
    controller_->power_cycle();
    controller_->misbehave(Fault::garbage, "RS1");  // output 2 gets dark all the same
    EXPECT_FALSE(set_dark(options_));
    EXPECT_FALSE(controller_->continuous());
    controller_->misbehave(Fault::none);
    open_and_start();
    controller_->misbehave(Fault::garbage, "GR");
    ASSERT_TRUE(until([&] { return !ear_.losses.empty(); }));
    EXPECT_EQ(ear_.losses[0].code, ErrorCode::unreadable) << ear_.losses[0].message();
    strobe_.reset();
    controller_->misbehave(Fault::garbage, "TR");
    ear_ = {};
    open_and_start();
    ASSERT_TRUE(fire());
    ASSERT_TRUE(until([&] { return !ear_.losses.empty() && !ear_.reports.empty(); }))
        << ear_.losses.size() << " losses, " << ear_.reports.size() << " reports";
    EXPECT_EQ(ear_.losses[0].code, ErrorCode::unreadable) << ear_.losses[0].message();
    EXPECT_FALSE(ear_.reports[0].lit);  // nobody knows whether it was
}

TEST_F(GardasoftStrobeTest, no_controller_at_the_address_is_said_with_the_address) {
    controller_.reset();
    const auto opened = open();
    ASSERT_FALSE(opened);
    EXPECT_THAT(opened.error().message(), HasSubstr("127.0.0.1:" + std::to_string(options_.port)));
    EXPECT_THAT(opened.error().cure, HasSubstr("strobe.host"));
}

TEST_F(GardasoftStrobeTest, a_power_cycled_controller_is_dark_again_by_itself_and_the_line_learns_of_the_loss) {
    open_and_start();
    controller_->power_cycle();
    EXPECT_TRUE(controller_->continuous());
    ASSERT_TRUE(until([&] { return !ear_.losses.empty(); }));
    EXPECT_EQ(fire().error().code, ErrorCode::disconnected);
    ASSERT_TRUE(until([&] { return !controller_->continuous(); }));
    EXPECT_EQ(ear_.losses.size(), 1U);
    ASSERT_TRUE(recovers());
    ASSERT_TRUE(fire(1, 500ms));
    ASSERT_TRUE(until([&] { return !ear_.reports.empty(); }));
    EXPECT_TRUE(ear_.reports[0].lit);
}

TEST_F(GardasoftStrobeTest, a_setting_that_is_changed_at_the_panel_is_a_loss_that_names_it) {
    open_and_start();
    controller_->turn_knob(2, 60);
    ASSERT_TRUE(until([&] { return !ear_.losses.empty(); }));
    EXPECT_THAT(ear_.losses[0].message(), testing::AllOf(HasSubstr("output 2"), HasSubstr("60 %, not 50 %")));
    ASSERT_TRUE(recovers());
}

TEST_F(GardasoftStrobeTest, an_error_of_the_controller_is_a_loss_with_its_reason) {
    open_and_start();
    controller_->misbehave(Fault::overheated);
    ASSERT_TRUE(until([&] { return !ear_.losses.empty(); }));
    EXPECT_THAT(ear_.losses[0].message(), HasSubstr("too hot"));
}

TEST_F(GardasoftStrobeTest, a_trigger_without_its_answer_is_reported_as_not_lit_and_is_a_loss) {
    for (const Fault fault : {Fault::silent, Fault::refuses, Fault::busy}) {
        strobe_.reset();
        controller_->misbehave(Fault::none);
        ear_ = {};
        open_and_start();
        ASSERT_TRUE(fire());
        controller_->misbehave(fault);
        ASSERT_TRUE(until([&] { return !ear_.losses.empty(); }));
        ASSERT_EQ(ear_.reports.size(), 1U);
        EXPECT_FALSE(ear_.reports[0].lit);
    }
}

TEST_F(GardasoftStrobeTest, pulses_that_wait_when_the_controller_is_lost_are_reported_as_not_lit) {
    open_and_start();
    ASSERT_TRUE(fire(1, 5s));
    ASSERT_TRUE(fire(2, 8s));
    controller_->plug(false);
    ASSERT_TRUE(until([&] { return !ear_.losses.empty(); }));
    ASSERT_EQ(ear_.reports.size(), 2U);
    EXPECT_FALSE(ear_.reports[0].lit || ear_.reports[1].lit);
    controller_->plug(true);
    ASSERT_TRUE(recovers());
    EXPECT_TRUE(controller_->pulses().empty());
}

TEST_F(GardasoftStrobeTest, a_serial_line_does_the_same) {
    plug_in({.outputs = 2, .serial = true});
    options_.response_timeout = 5s;  // a kernel thread carries a pseudo-terminal's bytes: late on a busy machine
    ASSERT_NO_FATAL_FAILURE(open_and_start());
    EXPECT_FALSE(controller_->continuous());
    ASSERT_TRUE(fire());
    ASSERT_TRUE(until([&] { return !ear_.reports.empty(); }));
    EXPECT_TRUE(ear_.reports[0].lit);
    EXPECT_EQ(controller_->pulses().size(), 1U);
    controller_->power_cycle();  // no connection falls: only its settings tell
    ASSERT_TRUE(until([&] { return !ear_.losses.empty(); }));
    EXPECT_THAT(ear_.losses[0].message(), HasSubstr("not in pulse mode"));
    ASSERT_TRUE(until([&] { return !controller_->continuous(); }));
}

TEST_F(GardasoftStrobeTest, a_serial_line_that_is_not_there_or_none_is_said) {
    options_.host.clear();
    options_.device = "/dev/no-such-line";
    EXPECT_EQ(open().error().code, ErrorCode::not_found);
    options_.device = "/dev/null";
    const auto none = open();
    ASSERT_FALSE(none);
    EXPECT_THAT(none.error().message(), HasSubstr("no serial line"));
}

// A GPIO line drives the controller's input: it flashes when the line rises.
class Wire final : public GpioOutputs {
  public:
    explicit Wire(StrobeController& controller) : controller_(controller) {}
    Result<void> set(std::uint32_t active) override {
        for (int k = 0; k < 2; ++k) {
            if (((active & ~was_) >> k & 1U) != 0) controller_.trigger(k + 1);
        }
        was_ = active;
        return {};
    }

  private:
    StrobeController& controller_;
    std::uint32_t was_ = 0;
};

TEST_F(GardasoftStrobeTest, a_line_triggers_and_the_report_has_the_light_and_not_the_line) {
    std::vector<hal::LightLimits> limits;
    for (const auto& channel : options_.channels) limits.push_back(GardasoftStrobe::trigger_limits(channel, options_));
    auto lines = GpioStrobe::open(
        *loop_, limits, [&]() -> Result<std::unique_ptr<GpioOutputs>> { return std::make_unique<Wire>(*controller_); });
    ASSERT_TRUE(lines) << lines.error().message();
    auto opened = open(std::move(*lines));
    ASSERT_TRUE(opened) << opened.error().message();
    strobe_ = std::move(*opened);
    ASSERT_TRUE(strobe_->start(ear_));
    const hal::TimePoint start = loop_->now() + 5ms;
    ASSERT_TRUE(strobe_->fire({1, 0b10, start, kPulse}));
    ASSERT_TRUE(strobe_->fire({2, 0b01, start + kPulse + 5ms, kPulse}));
    ASSERT_TRUE(until([&] { return ear_.reports.size() == 2; }));
    const auto pulses = controller_->pulses();
    ASSERT_EQ(pulses.size(), 2U);
    EXPECT_EQ(pulses[0].output, 2);
    EXPECT_EQ(pulses[1].output, 1);
    for (const auto& report : ear_.reports) {
        EXPECT_TRUE(report.lit);
        EXPECT_EQ(report.width, kPulse);
    }
    EXPECT_GE(ear_.reports[0].start, start);
    // The controller is lost while the line still works: a pulse of the line is no light.
    controller_->power_cycle();
    ASSERT_TRUE(until([&] { return !ear_.losses.empty(); }));
    EXPECT_EQ(fire().error().code, ErrorCode::disconnected);
    ASSERT_TRUE(recovers());
}

TEST_F(GardasoftStrobeTest, a_dead_stations_controller_is_set_dark) {
    controller_->turn_knob(1, 100);
    ASSERT_TRUE(set_dark(options_));
    EXPECT_FALSE(controller_->continuous());
    EXPECT_EQ(identify(options_).value(), "RT220-20 (HW02) V031");
}

}  // namespace
}  // namespace hord::drivers
