// What every backend of the seam brings to the contract suites: a way to pass time, and the other side of the device.
//
// A suite is generic: it knows the interface's header and this file. A backend adds one .cpp that makes a harness and
// names it with INSTANTIATE_TEST_SUITE_P. What a backend cannot show (a lost device, an observed light) it says by
// returning false from the harness's question, and the check is skipped by name.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"

namespace hord::contract {

// What a call failed with; none when it succeeded.
template <class T>
std::optional<ErrorCode> code_of(const Result<T>& result) {
    return result ? std::nullopt : std::optional(result.error().code);
}

// Runs a loop. In virtual time waiting costs nothing; in real time run_until polls the condition.
class LoopRunner {
  public:
    virtual ~LoopRunner() = default;
    [[nodiscard]] virtual hal::EventLoop& loop() = 0;
    // True as soon as `done`; false when it is not within `at_most`.
    virtual bool run_until(const std::function<bool()>& done, hal::Duration at_most) = 0;
    // Lets `duration` pass, to see that nothing happens.
    virtual void run_for(hal::Duration duration) = 0;
};
std::unique_ptr<LoopRunner> virtual_loop();
std::unique_ptr<LoopRunner> real_loop();  // sd-event

// Long enough for any device on a busy machine; a condition that holds ends the wait at once.
inline constexpr hal::Duration kPatience = std::chrono::seconds(5);
// Long enough for a backend that would wrongly call, to call.
inline constexpr hal::Duration kQuiet = std::chrono::milliseconds(60);

class Harness {
  public:
    explicit Harness(std::unique_ptr<LoopRunner> runner) : runner_(std::move(runner)) {}
    virtual ~Harness() = default;
    [[nodiscard]] hal::EventLoop& loop() { return runner_->loop(); }
    [[nodiscard]] hal::TimePoint now() { return loop().now(); }
    bool run_until(const std::function<bool()>& done) { return runner_->run_until(done, kPatience); }
    void run_for(hal::Duration duration) { runner_->run_for(duration); }

    // The device goes, as a cable pulled out would make it; false: cannot be shown here.
    virtual bool lose() { return false; }
    // It is back; start() works again.
    virtual void bring_back() {}

  private:
    std::unique_ptr<LoopRunner> runner_;
};

class PartSensorHarness : public Harness {
  public:
    using Harness::Harness;
    [[nodiscard]] virtual hal::PartSensor& device() = 0;
    virtual void pass_part() = 0;  // begins to: a front edge, then a back edge, soon
};

class StrobeHarness : public Harness {
  public:
    using Harness::Harness;
    [[nodiscard]] virtual hal::Strobe& device() = 0;
    // How long the light was truly on since the harness was made; none: not observed.
    [[nodiscard]] virtual std::optional<hal::Duration> light() { return std::nullopt; }
};

class SensorHarness : public Harness {
  public:
    using Harness::Harness;
    [[nodiscard]] virtual hal::Sensor& device() = 0;
};

class RejectorHarness : public Harness {
  public:
    using Harness::Harness;
    [[nodiscard]] virtual hal::Rejector& device() = 0;
    struct Actuation {
        hal::TimePoint from;
        std::optional<hal::TimePoint> until;  // none: still on
    };
    [[nodiscard]] virtual std::vector<Actuation> actuations() = 0;  // what the ejector truly did
    [[nodiscard]] virtual bool permit() = 0;                        // the permit, at the module's output
    // How late the backend may be in real time; zero in virtual time.
    [[nodiscard]] virtual hal::Duration slack() const { return hal::Duration::zero(); }
    // A window long enough for the backend to write in, on a busy machine.
    [[nodiscard]] virtual hal::Duration window() const { return std::chrono::milliseconds(20); }
};

// One backend: a name without spaces, and a harness a test. A null harness skips the test with `why_not`.
template <class H>
struct Backend {
    std::string name;
    std::function<std::unique_ptr<H>()> make;
    std::string why_not;
};
template <class H>
void PrintTo(const Backend<H>& backend, std::ostream* out) {
    *out << backend.name;
}
template <class H>
std::string name_of(const testing::TestParamInfo<Backend<H>>& info) {
    return info.param.name;
}

template <class H>
class Contract : public testing::TestWithParam<Backend<H>> {
  protected:
    void SetUp() override {
        h_ = this->GetParam().make();
        if (!h_) GTEST_SKIP() << this->GetParam().name << ": " << this->GetParam().why_not;
    }
    std::unique_ptr<H> h_;
};

class EventLoopContract : public Contract<Harness> {};
class PartSensorContract : public Contract<PartSensorHarness> {};
class StrobeContract : public Contract<StrobeHarness> {};
class SensorContract : public Contract<SensorHarness> {};
struct RejectorEar final : hal::Rejector::Listener {
    void on_reject(const hal::RejectReport& report) override {
        reports.push_back(report);
        if (then) then();
    }
    void on_rejector_link(bool is_up, const Error& why) override {
        up = is_up;
        ++changes;
        if (!is_up) why_down = why;
    }
    [[nodiscard]] std::vector<std::uint32_t> parts() const {
        std::vector<std::uint32_t> out;
        for (const auto& report : reports) out.push_back(report.part);
        return out;
    }
    std::vector<hal::RejectReport> reports;
    bool up = false;
    int changes = 0;
    Error why_down;
    std::function<void()> then;
};

class RejectorContract : public Contract<RejectorHarness> {
  protected:
    void start_and_wait() {
        ASSERT_TRUE(h_->device().start(ear_));
        ASSERT_TRUE(h_->run_until([&] { return ear_.up; }));
    }
    hal::RejectCommand command(std::uint32_t part, hal::Duration ahead = std::chrono::milliseconds(20)) {
        return {.part = part, .start = h_->now() + ahead, .width = h_->window()};
    }
    bool all_off() {
        for (const auto& act : h_->actuations()) {
            if (!act.until) return false;
        }
        return true;
    }
    RejectorEar ear_;
};

}  // namespace hord::contract
