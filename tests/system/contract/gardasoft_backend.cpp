// The strobe behind a Gardasoft controller in the contract suite: on a simulated controller, triggered by command over
// TCP, and by a line that drives its input.
#include "drivers/gardasoft/gardasoft_strobe.h"
#include "drivers/gpio/gpio_strobe.h"
#include "hal_sim/strobe_controller/strobe_controller.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;
using namespace drivers;

// Long enough for a thread on a busy machine.
constexpr hal::Duration kPulse = 400ms;

// A rising line is a trigger at the controller's input.
class Wire final : public GpioOutputs {
  public:
    explicit Wire(sim::StrobeController& controller) : controller_(controller) {}
    Result<void> set(std::uint32_t active) override {
        if ((active & ~was_ & 1U) != 0) controller_.trigger(1);
        was_ = active;
        return {};
    }

  private:
    sim::StrobeController& controller_;
    std::uint32_t was_ = 0;
};

class GardasoftHarness final : public StrobeHarness {
  public:
    explicit GardasoftHarness(bool by_line) : StrobeHarness(real_loop()) {
        controller_ = std::move(*sim::StrobeController::open(loop(), {.outputs = 1}));
        GardasoftStrobeOptions options;
        options.host = "127.0.0.1";
        options.port = controller_->port();
        options.pulse = kPulse;
        options.channels = {{.output = 1, .rated_ma = 500, .limits = {kPulse, 5ms, 1}}};
        std::unique_ptr<hal::Strobe> trigger;
        if (by_line) {
            auto lines = GpioStrobe::open(
                loop(), {GardasoftStrobe::trigger_limits(options.channels[0], options)},
                [this]() -> Result<std::unique_ptr<GpioOutputs>> { return std::make_unique<Wire>(*controller_); });
            EXPECT_TRUE(lines) << lines.error().message();
            trigger = std::move(*lines);
        }
        auto opened = GardasoftStrobe::open(loop(), options, std::move(trigger));
        EXPECT_TRUE(opened) << opened.error().message();
        strobe_ = std::move(*opened);
        EXPECT_FALSE(lit_between_pulses());
    }
    ~GardasoftHarness() override {
        strobe_.reset();
        EXPECT_FALSE(lit_between_pulses());
    }
    hal::Strobe& device() override { return *strobe_; }
    std::optional<hal::Duration> light() override {
        hal::Duration all{};
        for (const auto& pulse : controller_->pulses()) all += pulse.width;
        return all;
    }
    bool lose() override {
        controller_->plug(false);
        return true;
    }
    void bring_back() override { controller_->plug(true); }

  private:
    [[nodiscard]] bool lit_between_pulses() const { return controller_->continuous(); }
    std::unique_ptr<sim::StrobeController> controller_;
    std::unique_ptr<GardasoftStrobe> strobe_;
};

INSTANTIATE_TEST_SUITE_P(
    Gardasoft, StrobeContract,
    testing::Values(Backend<StrobeHarness>{"command", [] { return std::make_unique<GardasoftHarness>(false); }, ""},
                    Backend<StrobeHarness>{"line", [] { return std::make_unique<GardasoftHarness>(true); }, ""}),
    name_of<StrobeHarness>);

}  // namespace
}  // namespace hord::contract
