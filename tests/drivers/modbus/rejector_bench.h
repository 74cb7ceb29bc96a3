// The rejector driver on the service's event loop, in real time, with a simulated module that can misbehave.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/modbus/modbus_rejector.h"
#include "tests/support/modbus_module/modbus_module.h"

namespace hord::drivers {

using namespace std::chrono_literals;
using test::ModuleFault;
using testing::AllOf;
using testing::Each;
using testing::HasSubstr;
using Outcome = hal::RejectReport::Outcome;

constexpr int kEjector = 0, kPermit = 1;
constexpr hal::Duration kTimeout = 400ms;  // well above what a busy machine adds to a local answer
constexpr hal::Duration kWindow = 2s;

struct Ear final : hal::Rejector::Listener {
    void on_reject(const hal::RejectReport& report) override { reports.push_back(report); }
    void on_rejector_link(bool is_up, const Error& why) override {
        up = is_up;
        ++changes;
        if (!is_up) losses.push_back((why_down = why).what);
    }
    void on_reject_failed(const Error& why) override { failures.push_back(why); }
    std::vector<hal::RejectReport> reports;
    std::vector<Error> failures;
    bool up = false;
    int changes = 0;
    Error why_down;
    std::vector<std::string> losses;  // why the link was lost, each time
};

class RejectorBench : public testing::Test {
  protected:
    explicit RejectorBench(const test::ModbusModuleOptions& module = {})
        : loop_(std::move(*firmware::SdEventLoop::open())) {
        connect_to(module);
    }
    ~RejectorBench() override {
        if (rejector_) rejector_->stop();
    }
    void connect_to(test::ModbusModuleOptions module) {
        module_.reset();
        module.realtime = 10;  // a busy machine delays the driver, not the module that it drives
        auto opened = test::ModbusModule::open(*loop_, module);
        if (!opened) throw std::runtime_error(opened.error().message());
        module_ = std::move(*opened);
        options_.address.port = module_->port();
        if (module.serial) {
            options_.address.serial =
                SerialSettings{.device = module_->device(), .baud = 115200, .parity = 'N', .rs485 = false};
            options_.address.unit = module.unit;
        }
        options_.response_timeout = kTimeout;
        options_.reconnect_every = 20ms;
        options_.check_every = 50ms;
    }
    void start() {
        rejector_.emplace(*loop_, options_);
        ASSERT_TRUE(rejector_->start(ear_));
    }
    void start_and_wait() {
        start();
        ASSERT_TRUE(run_until([&] { return ear_.up; })) << ear_.why_down.message();
    }
    bool run_until(const std::function<bool()>& done) { return loop_->run_until(done, 60s); }
    // Sends a command whose window begins now, and waits for its report.
    Outcome reject(std::uint32_t part, hal::Duration window = kWindow) {
        const std::size_t before = ear_.reports.size();
        EXPECT_TRUE(rejector_->reject({part, loop_->now(), window}));
        EXPECT_TRUE(run_until([&] { return ear_.reports.size() > before; }));
        EXPECT_EQ(ear_.reports.back().part, part);
        return ear_.reports.back().outcome;
    }
    int times_on(int coil) {
        int count = 0;
        for (const auto& move : module_->history()) count += move.coil == coil && move.on ? 1 : 0;
        return count;
    }
    // Checks that the link is up again, the ejector is at rest and a command is confirmed.
    void expect_recovered() {
        EXPECT_TRUE(run_until([&] { return ear_.up && !module_->coil(kEjector); }));
        EXPECT_EQ(reject(99), Outcome::confirmed);
    }

    std::unique_ptr<firmware::SdEventLoop> loop_;
    std::unique_ptr<test::ModbusModule> module_;
    ModbusRejectorOptions options_;
    Ear ear_;
    std::optional<ModbusRejector> rejector_;
};

}  // namespace hord::drivers
