// Proxies between the station and the simulated devices. They report each call to the invariants, and a crash of the
// process cuts them off.
//
// One set for each process. After cut() nothing passes in either direction, so calls from the station's destructor have
// no effect, as when a process dies. The devices close, as the kernel would close them.
#pragma once

#include <functional>
#include <utility>

#include "firmware/station/station.h"
#include "hal_sim/cell/cell.h"
#include "lab/soak/invariants.h"

namespace hord::lab {

class DeviceProxies {
  public:
    // Both outlive the proxies.
    DeviceProxies(sim::SimulatedCell& cell, Invariants& invariants);

    // The process died. The rejector's module notices this later by its own watchdog: close_rejector().
    void cut();
    // Runs `action` at the n-th call of a device from now on, before the call is carried out: in the middle of a step.
    void after_calls(int n, std::function<void()> action);
    void close_rejector() { cell_.rejector().stop(); }

    [[nodiscard]] hal::PartSensor& part_sensor() { return part_sensor_; }
    [[nodiscard]] hal::Strobe& strobe() { return strobe_; }
    [[nodiscard]] hal::Sensor& sensor() { return sensor_; }
    [[nodiscard]] hal::Rejector& rejector() { return rejector_; }

  private:
    struct PartSensorProxy final : hal::PartSensor, hal::PartSensor::Listener {
        explicit PartSensorProxy(DeviceProxies& g) : proxies(g) {}
        Result<void> do_start(hal::PartSensor::Listener& to) override;
        void do_stop() override;
        void on_edge(const hal::PartEdge& edge) override;
        void on_encoder(const hal::EncoderReading& reading) override { listener->on_encoder(reading); }
        void on_part_sensor_lost(const Error& error) override { listener->on_part_sensor_lost(error); }
        DeviceProxies& proxies;
        hal::PartSensor::Listener* listener = nullptr;
    };
    struct StrobeProxy final : hal::Strobe, hal::Strobe::Listener {
        explicit StrobeProxy(DeviceProxies& g) : proxies(g) {}
        Result<void> do_start(hal::Strobe::Listener& to) override;
        Result<void> do_fire(const hal::StrobePulse& pulse) override;
        void do_stop() override;
        [[nodiscard]] hal::StrobeLimits limits() const override { return proxies.cell_.strobe().limits(); }
        void on_strobe(const hal::StrobeReport& report) override;
        void on_strobe_lost(const Error& error) override {
            if (!proxies.cut_) listener->on_strobe_lost(error);
        }
        DeviceProxies& proxies;
        hal::Strobe::Listener* listener = nullptr;
    };
    // The sensor itself lends the frames; the proxy only forwards them.
    struct SensorProxy final : hal::Sensor, hal::Sensor::Listener {
        explicit SensorProxy(DeviceProxies& g) : proxies(g) {}
        [[nodiscard]] hal::SensorFormat format() const override { return proxies.cell_.sensor().format(); }
        Result<void> do_start(hal::Sensor::Listener& to) override;
        Result<void> do_trigger(const hal::ExposureRequest& request) override;
        void do_stop() override;
        void do_give_back(std::uint32_t) noexcept override {}
        void on_frame(hal::FrameLease frame) override { listener->on_frame(std::move(frame)); }
        void on_sensor_lost(const Error& error) override { listener->on_sensor_lost(error); }
        DeviceProxies& proxies;
        hal::Sensor::Listener* listener = nullptr;
    };
    struct RejectorProxy final : hal::Rejector, hal::Rejector::Listener {
        explicit RejectorProxy(DeviceProxies& g) : proxies(g) {}
        Result<void> do_start(hal::Rejector::Listener& to) override;
        Result<void> do_reject(const hal::RejectCommand& command) override;
        void do_set_run_permit(bool permit) override;
        void do_stop() override;
        void on_reject(const hal::RejectReport& report) override {
            if (proxies.cut_) return;
            proxies.invariants_.reject_reported(report);
            listener->on_reject(report);
        }
        void on_rejector_link(bool up, const Error& why_down) override {
            if (!proxies.cut_) listener->on_rejector_link(up, why_down);
        }
        DeviceProxies& proxies;
        hal::Rejector::Listener* listener = nullptr;
    };
    friend struct PartSensorProxy;

    sim::SimulatedCell& cell_;
    Invariants& invariants_;
    void count_call();
    bool cut_ = false;
    int calls_left_ = 0;
    std::function<void()> after_calls_;
    PartSensorProxy part_sensor_{*this};
    StrobeProxy strobe_{*this};
    SensorProxy sensor_{*this};
    RejectorProxy rejector_{*this};
};

}  // namespace hord::lab
