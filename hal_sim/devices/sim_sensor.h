// The simulated lenslet sensor: an exposure shows the part that was in view when the strobe was lit.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <memory>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"
#include "hal_sim/devices/sim_strobe.h"
#include "hal_sim/world/fault_injection.h"
#include "hal_sim/world/frame_source.h"
#include "hal_sim/world/latency.h"
#include "hal_sim/world/world.h"

namespace hord::sim {

struct SensorOptions {
    int buffers = 4;
    LatencyOptions readout{std::chrono::milliseconds(3), {}};  // end of the exposure to delivery
};

class SimSensor final : public hal::Sensor {
  public:
    SimSensor(hal::EventLoop& loop, World& world, const SimStrobe& strobe, FrameSource& source, InjectionPlan& faults,
              const SensorOptions& options, std::uint64_t seed);
    ~SimSensor() override { stop(); }
    [[nodiscard]] hal::SensorFormat format() const override;

    // The world's number of the part in a frame, by the frame's sequence. 0: no part, dark, or older than 64 frames.
    [[nodiscard]] std::uint64_t true_part_of(std::uint32_t sequence) const {
        const Seen& seen = seen_[sequence % seen_.size()];
        return seen.sequence == sequence ? seen.part : 0;
    }

    // ExposureRequest::exposure whose trigger made it, by the frame's sequence; 0: older than 64 frames.
    [[nodiscard]] std::uint32_t true_trigger_of(std::uint32_t sequence) const {
        const Seen& seen = seen_[sequence % seen_.size()];
        return seen.sequence == sequence ? seen.trigger : 0;
    }

    // The device is unplugged now; start() fails for this long.
    void unplug(hal::Duration gone_for) {
        if (listener_ != nullptr) lose(gone_for);
    }

  private:
    enum class State : std::uint8_t { free, exposing, reading, lent };
    struct Slot {
        std::atomic<State> state{State::free};
        std::vector<std::byte> samples;
        FrameView view;
        hal::FrameInfo info;
        std::uint32_t trigger = 0;
        hal::TimePoint end;
        hal::EventLoop::TimerId timer{};
    };
    struct Seen {
        std::uint32_t sequence = 0;
        std::uint64_t part = 0;
        std::uint32_t trigger = 0;
    };
    Result<void> do_start(Listener& listener) override;
    Result<void> do_trigger(const hal::ExposureRequest& request) override;
    void do_stop() override;
    void do_give_back(std::uint32_t slot) noexcept override {
        slots_[slot].state.store(State::free, std::memory_order_release);
    }

    [[nodiscard]] Slot* take_free();
    [[nodiscard]] std::uint32_t number_of(const Slot& slot) const {
        return static_cast<std::uint32_t>(&slot - slots_.get());
    }
    void exposed(std::uint32_t number);
    void deliver(std::uint32_t number);
    void deliver_later(Slot& slot, hal::TimePoint due);
    void duplicate(const Slot& slot, hal::TimePoint due);
    void lose(hal::Duration gone_for);

    hal::EventLoop& loop_;
    World& world_;
    const SimStrobe& strobe_;
    FrameSource& source_;
    InjectionPlan& faults_;
    SensorOptions options_;
    std::uint64_t seed_;
    Latency latency_;
    Listener* listener_ = nullptr;
    bool lost_ = false;
    hal::TimePoint back_at_{};
    hal::EventLoop::TimerId lost_timer_{};
    std::unique_ptr<Slot[]> slots_;
    std::uint32_t sequence_ = 0;
    std::uint64_t exposures_ = 0;
    std::array<Seen, 64> seen_{};

    // The frame before this one, kept only if the plan has stale frames.
    std::vector<std::byte> last_samples_;
    hal::FrameInfo last_info_;
    std::uint64_t last_part_ = 0;
    std::uint32_t last_trigger_ = 0;
};

}  // namespace hord::sim
