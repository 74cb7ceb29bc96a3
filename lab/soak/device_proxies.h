// Between the station and the cell: the observer sees everything that passes, and a crash cuts it off.
//
// One set of gates a process. After cut() nothing passes in either direction: what the station still says in its
// destructor goes nowhere, as when a process dies; the devices close as the kernel closes them.
#pragma once

#include <functional>
#include <utility>

#include "firmware/station/station.h"
#include "hal_sim/cell/cell.h"
#include "lab/soak/invariants.h"

namespace hord::lab {

using namespace firmware;

class DeviceProxies {
  public:
    // All outlive the gates.
    DeviceProxies(sim::SimulatedCell& cell, Invariants& invariants);

    // The process is gone. The rejector's module notices by itself, later: close_rejector().
    void cut();
    // Runs `what` at the n-th call of a device from now on, before it is carried out: in the middle of a step.
    void after_calls(int n, std::function<void()> what);
    void close_rejector() { cell_.rejector().stop(); }

    [[nodiscard]] hal::PartSensor& part_sensor() { return part_sensor_; }
    [[nodiscard]] hal::Strobe& strobe() { return strobe_; }
    [[nodiscard]] hal::Sensor& sensor() { return sensor_; }
    [[nodiscard]] hal::Rejector& rejector() { return rejector_; }

  private:
    struct PartSensorProxy final : hal::PartSensor, hal::PartSensor::Listener {
        explicit PartSensorProxy(DeviceProxies& g) : gates(g) {}
        Result<void> do_start(hal::PartSensor::Listener& to) override;
        void do_stop() override;
        void on_edge(const hal::PartEdge& edge) override;
        void on_encoder(const hal::EncoderReading& reading) override { listener->on_encoder(reading); }
        void on_part_sensor_lost(const Error& error) override { listener->on_part_sensor_lost(error); }
        DeviceProxies& gates;
        hal::PartSensor::Listener* listener = nullptr;
    };
    struct StrobeProxy final : hal::Strobe, hal::Strobe::Listener {
        explicit StrobeProxy(DeviceProxies& g) : gates(g) {}
        Result<void> do_start(hal::Strobe::Listener& to) override;
        Result<void> do_fire(const hal::StrobePulse& pulse) override;
        void do_stop() override;
        [[nodiscard]] hal::StrobeLimits do_limits() const override { return gates.cell_.strobe().limits(); }
        void on_strobe(const hal::StrobeReport& report) override;
        void on_strobe_lost(const Error& error) override {
            if (!gates.cut_) listener->on_strobe_lost(error);
        }
        DeviceProxies& gates;
        hal::Strobe::Listener* listener = nullptr;
    };
    // Frames are lent by the sensor itself: the gate only passes them on.
    struct SensorProxy final : hal::Sensor, hal::Sensor::Listener {
        explicit SensorProxy(DeviceProxies& g) : gates(g) {}
        [[nodiscard]] hal::SensorFormat do_format() const override { return gates.cell_.sensor().format(); }
        Result<void> do_start(hal::Sensor::Listener& to) override;
        Result<void> do_trigger(const hal::ExposureRequest& request) override;
        void do_stop() override;
        void do_give_back(std::uint32_t) noexcept override {}
        void on_frame(hal::FrameLease frame) override { listener->on_frame(std::move(frame)); }
        void on_sensor_lost(const Error& error) override { listener->on_sensor_lost(error); }
        DeviceProxies& gates;
        hal::Sensor::Listener* listener = nullptr;
    };
    struct RejectorProxy final : hal::Rejector, hal::Rejector::Listener {
        explicit RejectorProxy(DeviceProxies& g) : gates(g) {}
        Result<void> do_start(hal::Rejector::Listener& to) override;
        Result<void> do_reject(const hal::RejectCommand& command) override;
        void do_set_run_permit(bool permit) override;
        void do_stop() override;
        void on_reject(const hal::RejectReport& report) override {
            if (!gates.cut_) listener->on_reject(report);
        }
        void on_rejector_link(bool up, const Error& why_down) override {
            if (!gates.cut_) listener->on_rejector_link(up, why_down);
        }
        DeviceProxies& gates;
        hal::Rejector::Listener* listener = nullptr;
    };
    friend struct PartSensorProxy;

    sim::SimulatedCell& cell_;
    Invariants& invariants_;
    void count_call();
    bool cut_ = false;
    int calls_left_ = 0;
    std::function<void()> then_;
    PartSensorProxy part_sensor_{*this};
    StrobeProxy strobe_{*this};
    SensorProxy sensor_{*this};
    RejectorProxy rejector_{*this};
};

}  // namespace hord::lab
