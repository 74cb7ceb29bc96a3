// What a backend provides for the contract suites: an event loop that runs, and control over the physical side of the
// device.
//
// A suite is generic: it includes the interface's header and this file. A backend adds one .cpp that makes a harness
// and registers it with INSTANTIATE_TEST_SUITE_P. A harness that cannot do or observe something (lose the device,
// measure the light) returns false or none; the check is then skipped with a message.
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

// The error code of a call; none: it succeeded.
template <class T>
std::optional<ErrorCode> code_of(const Result<T>& result) {
    return result ? std::nullopt : std::optional(result.error().code);
}

// Runs a loop. Waiting in virtual time takes no real time; in real time run_until() polls the condition.
class LoopRunner {
  public:
    virtual ~LoopRunner() = default;
    [[nodiscard]] virtual hal::EventLoop& loop() = 0;
    // True as soon as done(); false if it is not within `at_most`.
    virtual bool run_until(const std::function<bool()>& done, hal::Duration at_most) = 0;
    // Lets `duration` pass, to check that nothing happens.
    virtual void run_for(hal::Duration duration) = 0;
};
std::unique_ptr<LoopRunner> virtual_loop();
std::unique_ptr<LoopRunner> real_loop();  // sd-event

// Long enough for any device on a busy machine; run_until() ends earlier when the condition holds.
inline constexpr hal::Duration kPatience = std::chrono::seconds(5);
// Long enough to detect a callback that must not come.
inline constexpr hal::Duration kQuiet = std::chrono::milliseconds(60);

class Harness {
  public:
    explicit Harness(std::unique_ptr<LoopRunner> runner) : runner_(std::move(runner)) {}
    virtual ~Harness() = default;
    [[nodiscard]] hal::EventLoop& loop() { return runner_->loop(); }
    [[nodiscard]] hal::TimePoint now() { return loop().now(); }
    bool run_until(const std::function<bool()>& done) { return runner_->run_until(done, kPatience); }
    void run_for(hal::Duration duration) { runner_->run_for(duration); }

    // Disconnects the device, as pulling its cable does; false: not possible here.
    virtual bool lose() { return false; }
    // Connects it again; start() works again.
    virtual void bring_back() {}

  private:
    std::unique_ptr<LoopRunner> runner_;
};

class PartSensorHarness : public Harness {
  public:
    using Harness::Harness;
    [[nodiscard]] virtual hal::PartSensor& device() = 0;
    virtual void pass_part() = 0;  // a front edge soon, then a back edge
};

class StrobeHarness : public Harness {
  public:
    using Harness::Harness;
    [[nodiscard]] virtual hal::Strobe& device() = 0;
    // For how long the light was really on since the harness was made; none: not measured.
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
    [[nodiscard]] virtual std::vector<Actuation> actuations() = 0;  // of the real ejector
    [[nodiscard]] virtual bool permit() = 0;                        // at the module's output
    // How late the backend may be in real time; zero in virtual time.
    [[nodiscard]] virtual hal::Duration slack() const { return hal::Duration::zero(); }
    // A window in which the backend can write on a busy machine.
    [[nodiscard]] virtual hal::Duration window() const { return std::chrono::milliseconds(20); }
};

// One backend: a name without spaces, and a factory of harnesses, one a test. A null harness skips the test with
// `why_not`.
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
