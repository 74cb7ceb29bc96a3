// The Modbus rejector in the contract suite, in real time: with the simulated module of tests on loopback and on a
// serial line, and with the station's own simulated module.
#include <mutex>

#include "drivers/modbus/modbus_rejector.h"
#include "hal_sim/coil_module/coil_module.h"
#include "tests/support/modbus_module/modbus_module.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;

class ModbusHarness final : public RejectorHarness {
  public:
    explicit ModbusHarness(bool serial) : RejectorHarness(real_loop()) {
        auto opened = test::ModbusModule::open(loop(), {.serial = serial, .realtime = 10});
        EXPECT_TRUE(opened) << opened.error().message();
        module_ = std::move(*opened);
        drivers::ModbusRejectorOptions options;
        options.address.port = module_->port();
        if (serial)
            options.address = {.serial = drivers::SerialSettings{module_->device(), 115200, 'N', false}, .unit = 1};
        options.response_timeout = serial ? 300ms : 1s;  // long: the machine may be busy with other tests
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
    std::unique_ptr<test::ModbusModule> module_;
    std::optional<drivers::ModbusRejector> device_;
};

class OwnModuleHarness final : public RejectorHarness {
  public:
    OwnModuleHarness() : RejectorHarness(real_loop()) {
        auto opened = sim::CoilModule::open(loop());
        EXPECT_TRUE(opened) << opened.error().message();
        module_ = std::move(*opened);
        module_->on_coil([this](int coil, bool on, hal::TimePoint at) {
            const std::scoped_lock lock(mutex_);
            if (coil == 1) permit_ = on;
            if (coil != 0) return;
            if (on) actuations_.push_back({at, std::nullopt});
            else actuations_.back().until = at;
        });
        drivers::ModbusRejectorOptions options;
        options.address.port = module_->port();
        options.response_timeout = 1s;
        options.reconnect_every = 20ms;
        device_.emplace(loop(), options);
    }
    ~OwnModuleHarness() override {
        device_.reset();
        module_.reset();
    }
    hal::Rejector& device() override { return *device_; }
    std::vector<Actuation> actuations() override {
        const std::scoped_lock lock(mutex_);
        return actuations_;
    }
    bool permit() override {
        const std::scoped_lock lock(mutex_);
        return permit_;
    }
    hal::Duration slack() const override { return window(); }
    hal::Duration window() const override { return 300ms; }
    bool lose() override { return false; }
    void bring_back() override {}

  private:
    std::mutex mutex_;
    std::vector<Actuation> actuations_;
    bool permit_ = false;
    std::unique_ptr<sim::CoilModule> module_;
    std::optional<drivers::ModbusRejector> device_;
};

INSTANTIATE_TEST_SUITE_P(
    ModbusRejector, RejectorContract,
    testing::Values(Backend<RejectorHarness>{"loopback", [] { return std::make_unique<ModbusHarness>(false); }, ""},
                    Backend<RejectorHarness>{"own_module", [] { return std::make_unique<OwnModuleHarness>(); }, ""},
                    Backend<RejectorHarness>{"serial", [] { return std::make_unique<ModbusHarness>(true); }, ""}),
    name_of<RejectorHarness>);

}  // namespace
}  // namespace hord::contract
