// The simulated light barrier, with an optional encoder.
#pragma once

#include "drivers/hal/event_loop.h"
#include "drivers/hal/part_sensor.h"
#include "hal_sim/devices/pending.h"
#include "hal_sim/world/fault_injection.h"
#include "hal_sim/world/world.h"

namespace hord::sim {

struct PartSensorOptions {
    hal::Duration latency{};           // edge to delivery
    double encoder_counts_per_mm = 0;  // 0: no encoder
    hal::Duration encoder_every = std::chrono::milliseconds(10);
};

class SimPartSensor final : public hal::PartSensor {
  public:
    SimPartSensor(hal::EventLoop& loop, World& world, InjectionPlan& faults, const PartSensorOptions& options)
        : loop_(loop), world_(world), faults_(faults), options_(options),
          pending_(loop, [this](const hal::PartEdge& edge) { deliver(edge); }) {}
    ~SimPartSensor() override { stop(); }

    // Called by the world: a part's front (arrives) or back edge crosses the sensor.
    void part_edge(bool arrives, hal::TimePoint at);

    // The device is unplugged now; start() fails for this long.
    void unplug(hal::Duration gone_for) {
        if (listener_ != nullptr) lose(gone_for);
    }

  private:
    using Kind = hal::PartEdge::Kind;
    Result<void> do_start(Listener& listener) override;
    void do_stop() override;
    void deliver(hal::PartEdge edge);
    void emit(Kind kind, hal::TimePoint at);
    void read_encoder();
    void lose(hal::Duration gone_for);
    [[nodiscard]] std::int64_t counts_at(hal::TimePoint at);

    hal::EventLoop& loop_;
    World& world_;
    InjectionPlan& faults_;
    PartSensorOptions options_;
    Listener* listener_ = nullptr;
    Pending<hal::PartEdge> pending_;
    std::uint32_t sequence_ = 0;
    double slipped_mm_ = 0;
    double zero_mm_ = 0;  // where the encoder counts from: it starts at 0 with the device, as that of a GPIO line
    bool swallow_departure_ = false;
    hal::TimePoint back_at_{}, silent_until_{};
    hal::EventLoop::TimerId encoder_timer_{}, lost_timer_{};
};

}  // namespace hord::sim
