// The simulated collimator LEDs. A pulse that is commanded in time begins and ends exactly as commanded.
#pragma once

#include <deque>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/strobe.h"
#include "hal_sim/devices/pending.h"
#include "hal_sim/world/fault_injection.h"
#include "hal_sim/world/latency.h"

namespace hord::sim {

struct StrobeOptions {
    hal::StrobeLimits limits{std::chrono::milliseconds(1), std::chrono::milliseconds(1), 1};
    hal::Duration nominal_pulse = std::chrono::microseconds(50);  // gives light 1
    LatencyOptions report;                                        // end of the pulse to its report
};

class SimStrobe final : public hal::Strobe {
  public:
    SimStrobe(hal::EventLoop& loop, InjectionPlan& faults, const StrobeOptions& options, std::uint64_t seed)
        : loop_(loop), faults_(faults), options_(options), latency_(options.report, seed, 0x57B0),
          pending_(loop, [this](const hal::StrobeReport& done) { listener_->on_strobe(done); }) {}
    ~SimStrobe() override;
    [[nodiscard]] hal::StrobeLimits limits() const override { return options_.limits; }

    // The light in [from, until), 1 for a nominal pulse wholly inside, and its time.
    struct Light {
        double amount = 0;
        hal::TimePoint at;  // middle of the first pulse's part inside; meaningless without light
    };
    [[nodiscard]] Light light_between(hal::TimePoint from, hal::TimePoint until) const;

    // For checks: the longest time the light was on.
    [[nodiscard]] hal::Duration longest_on() const { return longest_on_; }

    // The device is unplugged now; start() fails for this long.
    void unplug(hal::Duration gone_for) {
        if (listener_ != nullptr) lose(gone_for);
    }

  private:
    struct Lit {
        hal::TimePoint from, until;
        double brightness;
    };
    Result<void> do_start(Listener& listener) override;
    Result<void> do_fire(const hal::StrobePulse& pulse) override;
    void do_stop() override;
    void light(hal::TimePoint from, hal::Duration width, double brightness);
    void dark_from(hal::TimePoint at);
    void lose(hal::Duration gone_for);

    hal::EventLoop& loop_;
    InjectionPlan& faults_;
    StrobeOptions options_;
    Latency latency_;
    Listener* listener_ = nullptr;
    bool lost_ = false;
    hal::TimePoint back_at_{};
    std::deque<Lit> lit_;  // pulses of the last second and future ones
    Pending<hal::StrobeReport> pending_;
    hal::EventLoop::TimerId lost_timer_{};
    hal::Duration longest_on_{};
};

}  // namespace hord::sim
