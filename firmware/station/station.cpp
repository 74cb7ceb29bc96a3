#include "firmware/station/station.h"

#include <algorithm>
#include <utility>

#include "firmware/station/timing_mismatch.h"

namespace hord::firmware {
namespace {

bool near(Duration a, Duration b, Duration tolerance) { return a - b <= tolerance && b - a <= tolerance; }

CoreConfig with_frame_size(CoreConfig config, const hal::SensorFormat& format) {
    if (config.frame_bytes == 0) {
        config.frame_bytes = static_cast<std::size_t>(format.width_px) * static_cast<std::size_t>(format.height_px) *
            (format.bits > 8 ? 2U : 1U);
    }
    return config;
}

}  // namespace

// Turns reports of devices into events.
struct Station::DeviceListener final : hal::PartSensor::Listener,
                                       hal::Strobe::Listener,
                                       hal::Sensor::Listener,
                                       hal::Rejector::Listener,
                                       Inspector::Listener {
    explicit DeviceListener(Station& owner) : station(owner) {}

    void on_edge(const hal::PartEdge& edge) override {
        station.tell(edge);
        station.process(edge);
    }
    void on_encoder(const hal::EncoderReading& reading) override { station.process(reading); }
    void on_part_sensor_lost(const Error& error) override { lost(Device::part_sensor, error); }
    void on_strobe(const hal::StrobeReport& report) override {
        if (report.exposure == Station::kTestPart) return station.test_lit(report);
        station.tell(report);
        station.process(report);
    }
    void on_strobe_lost(const Error& error) override { lost(Device::strobe, error); }
    void on_frame(hal::FrameLease frame) override {
        const hal::FrameInfo info = frame.info();
        if (station.test_frame(frame)) return;
        station.tell(info);
        station.process(FrameArrived{station.lend(std::move(frame)), info});
    }
    void on_sensor_lost(const Error& error) override { lost(Device::sensor, error); }
    void on_reject(const hal::RejectReport& report) override { station.process(report); }
    void on_rejector_link(bool up, const Error& why_down) override {
        if (!up) return lost(Device::rejector, why_down);
        station.process(DeviceUp{Device::rejector});
    }
    void on_reject_failed(const Error& why) override { station.report(why); }
    void on_judged(const Judged& judged) override {
        if (judged.part == Station::kTestPart) return station.test_judged(judged);
        station.process(judged);
    }

    void lost(Device device, const Error& error) {
        station.report(error);
        station.process(DeviceLost{device});
    }

    Station& station;
};

Station::Station(const CoreConfig& config, const Cell& cell, StationObserver* observer)
    : cell_(cell), observer_(observer), core_(with_frame_size(config, cell.sensor.format())),
      listener_(std::make_unique<DeviceListener>(*this)) {
    waiting_.reserve(64);
    loans_.reserve(static_cast<std::size_t>(std::max(cell.sensor.format().buffers, 1)) + 1);
}

Station::~Station() {
    observer_ = nullptr;
    if (test_) cell_.loop.cancel(test_->patience);
    test_.reset();
    process(Command::halt);
    stop_devices();
    cell_.loop.cancel(timer_);
}

Answer Station::request(Command command) {
    if (command == Command::stop || command == Command::abort || command == Command::disarm ||
        command == Command::halt) {
        wants_to_run_ = false;
    }
    const Answer answer = process(command);
    if (command == Command::start_continuous && answer == Answer::done) wants_to_run_ = autostart_;
    return answer;
}

void Station::run() {
    autostart_ = wants_to_run_ = true;
    if (core_.state() == State::preoperational) {
        process(Command::initialise);
    } else {
        try_to_run();
    }
}

void Station::outside_faults(std::uint32_t active) { process(OutsideFaults{active}); }

void Station::plc_lost() {
    if (core_.config().plc_policy == PlcPolicy::stop) wants_to_run_ = false;
    process(PlcLost{});
}

void Station::plc_back() { process(PlcBack{}); }

void Station::line_unknown() { process(LineUnknown{}); }

void Station::end() {
    core_.end();
    request(Command::halt);
    while (core_.next_wake() <= cell_.loop.now()) process(Tick{});  // one step has no room for all
}

// Events that come during a step are queued until its end: steps do not nest.
Answer Station::process(const Event& event) {
    if (stepping_) {
        waiting_.push_back(event);
        return Answer::done;
    }
    stepping_ = true;
    const Answer answer = step(event);
    for (std::size_t k = 0; k < waiting_.size(); ++k) {
        const Event next = waiting_[k];
        step(next);
    }
    waiting_.clear();
    stepping_ = false;
    if (wants_to_run_) try_to_run();
    set_timer();
    return answer;
}

void Station::try_to_run() {
    if (core_.state() == State::initialized && !stepping_) {
        const bool wanted = std::exchange(wants_to_run_, false);  // no recursion
        if (process(Command::arm) == Answer::done) process(Command::start_continuous);
        wants_to_run_ = wanted;
    }
}

Answer Station::step(const Event& event) {
    const State before = core_.state();
    const std::uint32_t latched = core_.faults_latched();
    const TimePoint now = cell_.loop.now();
    const Answer answer = core_.step(event, now, actions_);
    tell(now);
    for (const Action& action : actions_) std::visit([this](const auto& a) { carry_out(a); }, action);
    const std::uint32_t raised = core_.faults_latched() & ~latched;
    if (observer_ != nullptr && raised != 0) observer_->on_fault(raised, core_.snapshot());
    if (observer_ != nullptr && core_.state() != before) observer_->on_state(before, core_.state());
    if (observer_ != nullptr) observer_->on_step(before, event);
    return answer;
}

void Station::carry_out(const StartDevice& action) {
    Result<void> done;
    switch (action.device) {
        case Device::part_sensor:
            cell_.part_sensor.stop();
            done = cell_.part_sensor.start(*listener_);
            break;
        case Device::strobe:
            cell_.strobe.stop();
            done = cell_.strobe.start(*listener_);
            break;
        case Device::sensor:
            cell_.inspector.start(*listener_);
            cell_.sensor.stop();
            done = cell_.sensor.start(*listener_);
            break;
        case Device::rejector:  // connects by itself and reports its link
            if (rejector_started_) return;
            done = cell_.rejector.start(*listener_);
            rejector_started_ = done.has_value();
            if (done) return;
            break;
    }
    if (!done) report(done.error());
    process(done ? Event(DeviceUp{action.device}) : Event(DeviceLost{action.device}));
}

void Station::carry_out(const StopDevices&) { stop_devices(); }

void Station::stop_devices() {
    cell_.rejector.set_run_permit(false);
    cell_.strobe.stop();
    cell_.part_sensor.stop();
    cell_.sensor.stop();
    cell_.inspector.stop();
    cell_.rejector.stop();
    rejector_started_ = false;
}

// Reports a refusal to the observer and to the core.
void Station::check(const Result<void>& done, const Event& refused) {
    if (done) return;
    report(done.error());
    process(refused);
}

void Station::carry_out(const hal::ExposureRequest& request) {
    check(cell_.sensor.trigger(request), TriggerRefused{request.exposure});
}

void Station::carry_out(const hal::StrobePulse& pulse) {
    check(cell_.strobe.fire(pulse), StrobeRefused{pulse.exposure});
}

void Station::carry_out(const Inspect& inspect) {
    check(cell_.inspector.submit(inspect.part, take_back(inspect.frame)), InspectRefused{inspect.part});
}

void Station::carry_out(const hal::RejectCommand& command) {
    check(cell_.rejector.reject(command), RejectRefused{command.part});
}

void Station::carry_out(const ReleaseFrame& release) { take_back(release.frame); }

void Station::carry_out(const SetRunPermit& action) { cell_.rejector.set_run_permit(action.permit); }

void Station::carry_out(const PartResult& result) {
    if (observer_ != nullptr) observer_->on_result(result);
}

// -- flash test; the core is not involved

bool Station::test_possible() const {
    const State state = core_.state();
    return (state == State::initialized || state == State::ready) && core_.all_devices_up() &&
        core_.line().size() == 0 && !test_;
}

void Station::test_flash(Duration patience, std::function<void(const FlashTest&)> done) {
    const CoreConfig& config = core_.config();
    test_ = Test{};
    test_->exposure_start = cell_.loop.now() + std::max(config.trigger_lead, milliseconds(1));
    test_->done = std::move(done);
    test_->patience = cell_.loop.call_after(patience, [this] { end_test(); });
    const hal::ExposureRequest exposure{kTestPart, test_->exposure_start, config.exposure};
    const hal::StrobePulse pulse{kTestPart, config.strobe_channels, exposure.start + config.strobe_delay,
                                 config.strobe};
    auto triggered = cell_.sensor.trigger(exposure);
    if (triggered) triggered = cell_.strobe.fire(pulse);
    if (!triggered) {
        report(triggered.error());
        cell_.loop.cancel(test_->patience);
        test_->patience = cell_.loop.call_after(Duration::zero(), [this] { end_test(); });
    }
}

void Station::test_lit(const hal::StrobeReport& report) {
    if (!test_ || !std::exchange(test_->light_due, false)) return;
    const CoreConfig& config = core_.config();
    test_->result.lit = report.lit && near(report.width, config.strobe, config.strobe_window) &&
        near(report.start - TimePoint{}, test_->exposure_start + config.strobe_delay - TimePoint{},
             config.strobe_window);
    end_test_when_complete();
}

bool Station::test_frame(hal::FrameLease& frame) {
    const CoreConfig& config = core_.config();
    const hal::FrameInfo& info = frame.info();
    if (!test_ || !test_->frame_due || info.nobodys || (info.exposure != 0 && info.exposure != kTestPart) ||
        !near(frame.info().exposure_start - TimePoint{}, test_->exposure_start - TimePoint{}, config.frame_window)) {
        return false;
    }
    test_->frame_due = false;
    test_->result.frame = !frame.info().corrupt && frame.info().bytes_used >= config.frame_bytes;
    if (test_->result.frame) {
        if (auto done = cell_.inspector.submit(kTestPart, std::move(frame)); !done) {
            report(done.error());
            test_->judgement_due = false;
        }
    } else {
        test_->judgement_due = false;
        hal::FrameLease gone = std::move(frame);
    }
    end_test_when_complete();
    return true;
}

void Station::test_judged(const Judged& judged) {
    if (!test_ || !std::exchange(test_->judgement_due, false)) return;
    test_->result.judged = !judged.failed;
    test_->result.reason = judged.reason;
    end_test_when_complete();
}

void Station::end_test_when_complete() {
    if (!test_->light_due && !test_->judgement_due) end_test();
}

void Station::end_test() {
    if (!test_) return;
    const Test test = std::move(*test_);
    test_.reset();
    cell_.loop.cancel(test.patience);
    test.done(test.result);
}

void Station::set_timer() {
    const TimePoint due = core_.next_wake();
    if (due == timer_due_ && timer_ != hal::EventLoop::TimerId::none) return;
    cell_.loop.cancel(timer_);
    timer_due_ = due;
    timer_ = cell_.loop.call_at(due, [this] {
        timer_ = hal::EventLoop::TimerId::none;
        process(Tick{});
    });
}

// Once a second at most: the next part's is the same.
template <class Told>
void Station::tell(const Told& told) {
    const TimePoint now = cell_.loop.now();
    if (now < quiet_until_) return;
    const auto mismatch = mismatch_of(told, core_.line(), core_.config());
    if (!mismatch) return;
    quiet_until_ = now + milliseconds(1000);
    report(*mismatch);
}

void Station::report(const Error& error) {
    if (observer_ != nullptr) observer_->on_trouble(error);
}

FrameHandle Station::lend(hal::FrameLease frame) {
    const auto free = std::find_if(loans_.begin(), loans_.end(), [](const hal::FrameLease& loan) { return !loan; });
    const auto handle = static_cast<FrameHandle>(free - loans_.begin());
    if (free == loans_.end()) loans_.push_back(std::move(frame));
    else *free = std::move(frame);
    return handle;
}

hal::FrameLease Station::take_back(FrameHandle handle) { return std::move(loans_[handle]); }

}  // namespace hord::firmware
