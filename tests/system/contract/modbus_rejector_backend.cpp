// The Modbus rejector in the contract suite, with a simulated module on loopback and on a serial line, in
// real time.
#include "drivers/modbus/modbus_rejector.h"
#include "hal_sim/coil_module/coil_module.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;

class ModbusHarness final : public RejectorHarness {
  public:
    explicit ModbusHarness(bool serial) : RejectorHarness(real_loop()) {
        auto opened = sim::CoilModule::open(loop(), {.serial = serial});
        EXPECT_TRUE(opened) << opened.error().message();
        module_ = std::move(*opened);
        drivers::ModbusRejectorOptions options;
        options.address.port = module_->port();
        if (serial)
            options.address = {.serial = drivers::SerialSettings{module_->device(), 115200, 'N', false}, .unit = 1};
        options.response_timeout = serial ? 300ms : 1s;  // generous: the machine may be busy with other tests
        options.reconnect_every = 20ms;
        device_.emplace(loop(), options);
    }
    hal::Rejector& device() override { return *device_; }
    std::vector<Actuation> actuations() override {
        std::vector<Actuation> out;
        for (const auto& move : module_->history()) {
            if (move.coil != 0) continue;
            if (move.on) out.push_back({move.at, std::nullopt});
            else out.back().until = move.at;
        }
        return out;
    }
    bool permit() override { return module_->coil(1); }
    hal::Duration slack() const override { return window(); }
    hal::Duration window() const override { return 300ms; }
    bool lose() override {
        module_->power_off();
        return true;
    }
    void bring_back() override { EXPECT_TRUE(module_->power_on()); }

  private:
    std::unique_ptr<sim::CoilModule> module_;
    std::optional<drivers::ModbusRejector> device_;
};

INSTANTIATE_TEST_SUITE_P(
    ModbusRejector, RejectorContract,
    testing::Values(Backend<RejectorHarness>{"loopback", [] { return std::make_unique<ModbusHarness>(false); }, ""},
                    Backend<RejectorHarness>{"serial", [] { return std::make_unique<ModbusHarness>(true); }, ""}),
    name_of<RejectorHarness>);

}  // namespace
}  // namespace hord::contract
