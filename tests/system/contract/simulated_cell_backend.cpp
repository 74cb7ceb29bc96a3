// The simulated cell in the contract suites, in virtual and in real time.
#include "hal_sim/cell/cell.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;
using sim::InjectedFault;

constexpr hal::Duration kGoneFor = 200ms;

template <class H>
class InCell : public H {
  public:
    explicit InCell(std::unique_ptr<LoopRunner> runner, const sim::CellOptions& options = {}) : H(std::move(runner)) {
        auto made = sim::SimulatedCell::make(this->loop(), frames_, options);
        EXPECT_TRUE(made) << made.error().message();
        cell_ = std::move(*made);
    }

  protected:
    bool lose_by(InjectedFault fault) {
        cell_->faults().fire_next(fault, kGoneFor);
        return true;
    }
    sim::TokenFrames frames_{{27, 18, 12}};
    std::unique_ptr<sim::SimulatedCell> cell_;
};

class SimPartSensorHarness final : public InCell<PartSensorHarness> {
  public:
    SimPartSensorHarness(std::unique_ptr<LoopRunner> runner, double counts_per_mm)
        : InCell(std::move(runner), options(counts_per_mm)) {
        cell_->start();
    }
    hal::PartSensor& device() override { return cell_->part_sensor(); }
    void pass_part() override {}  // the cell sends a part every 30 ms
    bool lose() override { return lose_by(InjectedFault::part_sensor_lost); }

  private:
    static sim::CellOptions options(double counts_per_mm) {
        sim::CellOptions o;
        o.part_sensor.encoder_counts_per_mm = counts_per_mm;
        o.part_sensor.latency = 100us;
        o.conveyor.speed_mm_s = 2000;
        o.schedule.pitch_mm = 60;
        return o;
    }
};

class SimStrobeHarness final : public InCell<StrobeHarness> {
  public:
    SimStrobeHarness(std::unique_ptr<LoopRunner> runner, int channels) : InCell(std::move(runner), options(channels)) {}
    hal::Strobe& device() override { return cell_->strobe(); }
    std::optional<hal::Duration> light() override {
        const double pulses = cell_->strobe().light_between({}, now() + 1h).amount;
        return std::chrono::round<hal::Duration>(
            pulses * std::chrono::duration<double, std::nano>(sim::StrobeOptions{}.nominal_pulse));
    }
    bool lose() override { return lose_by(InjectedFault::strobe_lost); }

  private:
    static sim::CellOptions options(int channels) {
        sim::CellOptions o;
        o.strobe.limits.channels = channels;
        o.strobe.report = {20us, 10us};
        return o;
    }
};

class SimSensorHarness final : public InCell<SensorHarness> {
  public:
    explicit SimSensorHarness(std::unique_ptr<LoopRunner> runner) : InCell(std::move(runner)) { cell_->start(); }
    hal::Sensor& device() override { return cell_->sensor(); }
    bool lose() override { return lose_by(InjectedFault::sensor_lost); }
};

class SimRejectorHarness final : public InCell<RejectorHarness> {
  public:
    explicit SimRejectorHarness(std::unique_ptr<LoopRunner> runner) : InCell(std::move(runner)) {
        cell_->start();
        cell_->watch({.part_edge = {}, .part_gone = {}, .ejector = [this](bool open, hal::TimePoint at) {
                          if (open) acts_.push_back({at, std::nullopt});
                          else acts_.back().until = at;
                      }});
    }
    hal::Rejector& device() override { return cell_->rejector(); }
    std::vector<Actuation> actuations() override { return acts_; }
    bool permit() override { return cell_->rejector().run_permit(); }
    bool lose() override { return lose_by(InjectedFault::rejector_down); }

  private:
    std::vector<Actuation> acts_;
};

// Every backend on both loops.
template <class H, class T, class... Options>
auto on_both(const std::string& name, Options... options) {
    return testing::Values(
        Backend<H>{name + "_virtual_time", [=] { return std::make_unique<T>(virtual_loop(), options...); }, ""},
        Backend<H>{name + "_real_time", [=] { return std::make_unique<T>(real_loop(), options...); }, ""});
}

INSTANTIATE_TEST_SUITE_P(SimulatedCell, PartSensorContract,
                         (on_both<PartSensorHarness, SimPartSensorHarness>("plain", 0.0)), name_of<PartSensorHarness>);
INSTANTIATE_TEST_SUITE_P(SimulatedCellWithEncoder, PartSensorContract,
                         (on_both<PartSensorHarness, SimPartSensorHarness>("encoder", 20.0)),
                         name_of<PartSensorHarness>);
INSTANTIATE_TEST_SUITE_P(SimulatedCell, StrobeContract, (on_both<StrobeHarness, SimStrobeHarness>("one_channel", 1)),
                         name_of<StrobeHarness>);
INSTANTIATE_TEST_SUITE_P(SimulatedCellAllChannels, StrobeContract,
                         (on_both<StrobeHarness, SimStrobeHarness>("channels", 32)), name_of<StrobeHarness>);
INSTANTIATE_TEST_SUITE_P(SimulatedCell, SensorContract, (on_both<SensorHarness, SimSensorHarness>("tokens")),
                         name_of<SensorHarness>);
INSTANTIATE_TEST_SUITE_P(SimulatedCell, RejectorContract, (on_both<RejectorHarness, SimRejectorHarness>("in_process")),
                         name_of<RejectorHarness>);

}  // namespace
}  // namespace hord::contract
