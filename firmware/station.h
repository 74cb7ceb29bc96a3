// The station: carries what devices say into the core, and what the core wants to the devices.
//
// The same class in the service (sd-event, real drivers) and in simulation (virtual time, simulated devices). It runs on
// the loop's thread alone and never blocks, but in halt() (the rejector's last write).
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"
#include "firmware/core/core.h"
#include "firmware/inspector.h"

namespace hord::firmware {

// What the station talks to. All outlive it.
struct Cell {
    hal::EventLoop& loop;
    hal::PartSensor& part_sensor;
    hal::Strobe& strobe;
    hal::Sensor& sensor;
    hal::Rejector& rejector;
    Inspector& inspector;
};

// Told on the loop's thread. Must not call back into the station but through the loop.
class StationObserver {
  public:
    virtual ~StationObserver() = default;
    virtual void on_result(const PartResult& result) = 0;  // a part's story is complete: passed, or its rejection is known
    virtual void on_state(State /*from*/, State /*to*/) {}
    virtual void on_trouble(const Error& /*error*/) {}     // a device failed or refused: to be logged, once, with its cure
};

class Station {
  public:
    // `config` has no problems(); frame_bytes 0 is taken from the sensor's format.
    Station(const CoreConfig& config, const Cell& cell, StationObserver* observer = nullptr);
    ~Station();  // halts
    Station(const Station&) = delete;
    Station& operator=(const Station&) = delete;

    // Loop thread. Fails with refused, naming the state and what can be done, or what is missing (arm with a device down).
    Result<void> command(Command command);

    // Initialises, and arms and starts as soon as every device is up; stays away from a station in Error.
    void run();

    [[nodiscard]] Snapshot snapshot() const { return core_.snapshot(); }
    [[nodiscard]] const Core& core() const { return core_; }

  private:
    struct Ears;  // the listeners of the seam
    struct Loan {
        hal::FrameLease frame;
        FrameHandle next_free = 0;
    };

    void take(const Event& event);
    Answer step(const Event& event);
    void carry_out(const Action& action);
    void carry_out_start(Device device);
    void stop_devices();
    void set_timer();
    void report(const Error& error);
    void try_to_run();
    [[nodiscard]] FrameHandle lend(hal::FrameLease frame);
    [[nodiscard]] hal::FrameLease take_back(FrameHandle handle);

    Cell cell_;
    StationObserver* observer_;
    Core core_;
    Actions actions_;
    std::unique_ptr<Ears> ears_;
    std::vector<Event> waiting_;  // events that actions of the running step brought about
    bool stepping_ = false;
    bool wants_to_run_ = false;
    std::vector<Loan> loans_;
    FrameHandle first_free_ = 0;
    hal::EventLoop::TimerId timer_ = hal::EventLoop::TimerId::none;
    TimePoint timer_due_ = TimePoint::max();
};

}  // namespace hord::firmware
