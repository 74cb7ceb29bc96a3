// The GPIO drivers in the contract suites: with scripted lines on every machine, with a gpio-sim chip where there is
// one. HORD_GPIO_SIM is the chip's folder in configfs (/sys/kernel/config/gpio-sim/NAME), with the lines COLLIMATOR_A,
// COLLIMATOR_B, BARRIER and ENCODER.
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "drivers/gpio/gpio_part_sensor.h"
#include "drivers/gpio/gpio_strobe.h"
#include "tests/drivers/gpio/scripted_lines.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;
using namespace drivers;

// Pulses long enough for a thread on a busy machine.
const std::vector<LightLimits> kLimits(2, {.max_on = 500ms, .min_rest = 5ms, .max_duty = 1});

// ---- scripted lines

class ScriptedStrobeHarness final : public StrobeHarness {
  public:
    ScriptedStrobeHarness() : StrobeHarness(real_loop()) {
        auto opened = GpioStrobe::open(loop(), kLimits, [lamps = lamps_] { return scripted::Outputs::request(lamps); });
        EXPECT_TRUE(opened) << opened.error().message();
        strobe_ = std::move(*opened);
    }
    hal::Strobe& device() override { return *strobe_; }
    bool lose() override {
        lamps_->be_there(false);
        return true;
    }
    void bring_back() override { lamps_->be_there(true); }

  private:
    std::shared_ptr<scripted::Lamps> lamps_ = std::make_shared<scripted::Lamps>(loop());
    std::unique_ptr<GpioStrobe> strobe_;
};

class ScriptedPartSensorHarness final : public PartSensorHarness {
  public:
    explicit ScriptedPartSensorHarness(bool with_encoder) : PartSensorHarness(real_loop()) {
        GpioPartSensorOptions options;
        if (with_encoder) options.encoder.emplace();
        auto opened = GpioPartSensor::open(loop(), options, [this](const GpioLine&, GpioEdges edges) {
            return scripted::Input::request(edges == GpioEdges::both ? barrier_ : encoder_);
        });
        EXPECT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
    }
    hal::PartSensor& device() override { return *sensor_; }
    void pass_part() override {
        barrier_->change(true, now());
        for (int k = 1; k <= 3; ++k) {
            loop().call_after(k * 2ms, [this] { encoder_->change(true, now()); });
        }
        loop().call_after(8ms, [this] { barrier_->change(false, now()); });
    }
    bool lose() override {
        barrier_->there = encoder_->there = false;
        return true;
    }
    void bring_back() override { barrier_->there = encoder_->there = true; }

  private:
    std::shared_ptr<scripted::Wire> barrier_ = std::make_shared<scripted::Wire>(),
                                    encoder_ = std::make_shared<scripted::Wire>();
    std::unique_ptr<GpioPartSensor> sensor_;
};

// ---- a gpio-sim chip

void put(const std::filesystem::path& file, const std::string& text) { std::ofstream(file) << text << std::flush; }

std::string word_of(const std::filesystem::path& file) {
    std::string word;
    std::ifstream(file) >> word;
    return word;
}

struct SimulatedChip {
    std::filesystem::path config = std::getenv("HORD_GPIO_SIM");
    std::string label = word_of(config / "bank0" / "label");

    [[nodiscard]] GpioLine line(const char* name) const {
        GpioLine line;
        line.chip = label;
        line.line = name;
        return line;
    }
    [[nodiscard]] std::filesystem::path folder_of(const std::string& name) const {
        for (int k = 0;; ++k) {
            const std::string number = std::to_string(k);
            const auto line = config / "bank0" / ("line" + number);
            if (!std::filesystem::exists(line)) throw std::runtime_error("the simulated chip has no line " + name);
            if (word_of(line / "name") != name) continue;
            const std::filesystem::path device =
                std::filesystem::path("/sys/devices/platform") / word_of(config / "dev_name");
            return device / word_of(config / "bank0" / "chip_name") / ("sim_gpio" + number);
        }
    }
    void plug(bool in) const { put(config / "live", in ? "1" : "0"); }
    void drive(const char* name, bool high) const { put(folder_of(name) / "pull", high ? "pull-up" : "pull-down"); }
    [[nodiscard]] bool high(const char* name) const { return word_of(folder_of(name) / "value") == "1"; }
};

class ChipStrobeHarness final : public StrobeHarness {
  public:
    ChipStrobeHarness() : StrobeHarness(real_loop()) {
        auto opened = GpioStrobe::open(
            loop(), {{chip_.line("COLLIMATOR_A"), kLimits[0]}, {chip_.line("COLLIMATOR_B"), kLimits[1]}});
        EXPECT_TRUE(opened) << opened.error().message();
        strobe_ = std::move(*opened);
        EXPECT_FALSE(lit());
    }
    ~ChipStrobeHarness() override {
        EXPECT_FALSE(lit());  // also before the lines are released
        strobe_.reset();
        EXPECT_FALSE(lit());
    }
    hal::Strobe& device() override { return *strobe_; }
    bool lose() override {
        chip_.plug(false);
        return true;
    }
    void bring_back() override { chip_.plug(true); }

  private:
    [[nodiscard]] bool lit() const { return chip_.high("COLLIMATOR_A") || chip_.high("COLLIMATOR_B"); }
    SimulatedChip chip_;
    std::unique_ptr<GpioStrobe> strobe_;
};

class ChipPartSensorHarness final : public PartSensorHarness {
  public:
    explicit ChipPartSensorHarness(bool with_encoder) : PartSensorHarness(real_loop()) {
        chip_.drive("BARRIER", false);
        GpioPartSensorOptions options;
        options.line = chip_.line("BARRIER");
        if (with_encoder) options.encoder = chip_.line("ENCODER");
        auto opened = GpioPartSensor::open(loop(), options);
        EXPECT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
    }
    hal::PartSensor& device() override { return *sensor_; }
    void pass_part() override {
        // After the last part: a simulated line that changes before its interrupt is handled loses edges.
        const hal::TimePoint begin = std::max(now(), gone_ + 300ms);
        gone_ = begin + 140ms;
        loop().call_at(begin, [this] { chip_.drive("BARRIER", true); });
        for (int k = 1; k <= 6; ++k) {
            loop().call_at(begin + k * 20ms, [this, k] { chip_.drive("ENCODER", k % 2 == 1); });
        }
        loop().call_at(gone_, [this] { chip_.drive("BARRIER", false); });
    }
    bool lose() override {
        chip_.plug(false);
        return true;
    }
    void bring_back() override {
        chip_.plug(true);
        chip_.drive("BARRIER", false);
    }

  private:
    SimulatedChip chip_;
    hal::TimePoint gone_{};  // when the last part has passed
    std::unique_ptr<GpioPartSensor> sensor_;
};

template <class H, class Chip, class... Options>
std::unique_ptr<H> on_chip(Options... options) {
    if (std::getenv("HORD_GPIO_SIM") == nullptr) return nullptr;
    return std::make_unique<Chip>(options...);
}
const char* const kNoChip = "HORD_GPIO_SIM names no simulated GPIO chip on this machine";

INSTANTIATE_TEST_SUITE_P(
    Gpio, StrobeContract,
    testing::Values(Backend<StrobeHarness>{"scripted_lines", [] { return std::make_unique<ScriptedStrobeHarness>(); },
                                           ""},
                    Backend<StrobeHarness>{"chip", on_chip<StrobeHarness, ChipStrobeHarness>, kNoChip}),
    name_of<StrobeHarness>);
INSTANTIATE_TEST_SUITE_P(
    Gpio, PartSensorContract,
    testing::Values(Backend<PartSensorHarness>{"scripted_lines",
                                               [] { return std::make_unique<ScriptedPartSensorHarness>(false); }, ""},
                    Backend<PartSensorHarness>{"scripted_lines_encoder",
                                               [] { return std::make_unique<ScriptedPartSensorHarness>(true); }, ""},
                    Backend<PartSensorHarness>{
                        "chip", [] { return on_chip<PartSensorHarness, ChipPartSensorHarness>(false); }, kNoChip},
                    Backend<PartSensorHarness>{"chip_encoder",
                                               [] { return on_chip<PartSensorHarness, ChipPartSensorHarness>(true); },
                                               kNoChip}),
    name_of<PartSensorHarness>);

}  // namespace
}  // namespace hord::contract
