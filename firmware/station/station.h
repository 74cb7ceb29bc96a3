// The station: connects the core with the devices. Reports of devices become events; actions become calls of devices.
//
// The same class in the service (sd-event, real drivers) and in simulation (virtual time, simulated devices). It runs
// on the loop's thread only. It never blocks except in halt (the rejector's last write).
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"
#include "firmware/core/core.h"
#include "firmware/station/inspector.h"

namespace hord::firmware {

// All outlive the station.
struct Cell {
    hal::EventLoop& loop;
    hal::PartSensor& part_sensor;
    hal::Strobe& strobe;
    hal::Sensor& sensor;
    hal::Rejector& rejector;
    Inspector& inspector;
};

// Called on the loop's thread. Must not call the station directly, only by the loop (post()).
class StationObserver {
  public:
    virtual ~StationObserver() = default;
    virtual void on_result(const PartResult& result) = 0;  // final: passed, or the outcome of its rejection is known
    // The FaultBits `raised` were latched; before on_state() of the same step.
    virtual void on_fault(std::uint32_t /*raised*/, const Snapshot& /*now*/) {}
    virtual void on_state(State /*from*/, State /*to*/) {}
    virtual void on_step(State /*before*/, const Event& /*event*/) {}  // after every step of the core and its actions
    virtual void on_trouble(const Error& /*error*/) {}                 // a device failed or refused: to be logged once
};

class Station {
  public:
    // `config` has no problems(); frame_bytes 0 is taken from the sensor's format.
    Station(const CoreConfig& config, const Cell& cell, StationObserver* observer = nullptr);
    ~Station();  // halts
    Station(const Station&) = delete;
    Station& operator=(const Station&) = delete;

    Answer request(Command command);  // loop thread

    // Automatic operation: initialises; arms and starts as soon as every device is up, and again after a reset. It is
    // suspended by stop, abort, disarm, halt and resumed by start_continuous. Without run() nothing starts by itself.
    void run();

    // Loop thread. The PLC's heartbeat has stopped, or is back. The effect: CoreConfig::plc_policy.
    void plc_lost();
    void plc_back();

    // The bits of kOutsideFaults that are active now.
    void outside_faults(std::uint32_t active);

    // Flash test: one flash and one frame of the empty line, judged like a part's and not counted. Only while
    // test_possible(). `done` is called once, on the loop's thread, after `patience` at the latest.
    struct FlashTest {
        bool lit = false;     // the light came at its time and width
        bool frame = false;   // the frame came, whole and of this exposure
        bool judged = false;  // the inspection gave an answer
        algo::Reason reason = algo::Reason::none;
    };
    static constexpr std::uint32_t kTestPart = 0xFFFFFFFF;  // its part number in InspectionObserver
    // Initialized or Ready, every device up, nothing on the line, no test under way.
    [[nodiscard]] bool test_possible() const;
    void test_flash(Duration patience, std::function<void(const FlashTest&)> done);

    // Unknown parts may be on the line (nothing proves that it was empty when the process before this one ended): line
    // stop until a person has looked and resets. Called before run(), and when the line starts without that proof
    // withdrawn.
    void line_unknown();

    // Halts, and gives every part on the line its result at once: what halt would give it when its time is over. For
    // the end of the process: only the destructor may follow.
    void end();

    [[nodiscard]] Snapshot snapshot() const { return core_.snapshot(); }
    [[nodiscard]] const Core& core() const { return core_; }

  private:
    struct DeviceListener;  // listens to every device

    Answer process(const Event& event);
    Answer step(const Event& event);
    void carry_out(const std::monostate&) {}
    void carry_out(const StartDevice& action);
    void carry_out(const StopDevices& action);
    void carry_out(const hal::ExposureRequest& request);
    void carry_out(const hal::StrobePulse& pulse);
    void carry_out(const Inspect& inspect);
    void carry_out(const ReleaseFrame& release);
    void carry_out(const hal::RejectCommand& command);
    void carry_out(const SetRunPermit& action);
    void carry_out(const PartResult& result);
    void check(const Result<void>& done, const Event& refused);
    void stop_devices();
    void test_lit(const hal::StrobeReport& report);
    [[nodiscard]] bool test_frame(hal::FrameLease& frame);  // true: it was the test's frame, and `frame` was moved from
    void test_judged(const Judged& judged);
    void end_test_when_complete();
    void end_test();
    void set_timer();
    void report(const Error& error);
    template <class Told>
    void tell(const Told& told);  // by how much a frame or light missed its time
    void try_to_run();
    [[nodiscard]] FrameHandle lend(hal::FrameLease frame);
    hal::FrameLease take_back(FrameHandle handle);

    Cell cell_;
    StationObserver* observer_;
    Core core_;
    Actions actions_;
    std::unique_ptr<DeviceListener> listener_;
    std::vector<Event> waiting_;  // events that came during a step
    bool stepping_ = false;
    bool autostart_ = false;  // run() was called
    bool wants_to_run_ = false;
    bool rejector_started_ = false;
    std::vector<hal::FrameLease> loans_;  // by FrameHandle
    TimePoint quiet_until_{};             // for tell()
    struct Test {
        FlashTest result;
        TimePoint exposure_start;
        bool light_due = true, frame_due = true, judgement_due = true;
        hal::EventLoop::TimerId patience = hal::EventLoop::TimerId::none;
        std::function<void(const FlashTest&)> done;
    };
    std::optional<Test> test_;
    hal::EventLoop::TimerId timer_ = hal::EventLoop::TimerId::none;
    TimePoint timer_due_ = TimePoint::max();
};

}  // namespace hord::firmware
