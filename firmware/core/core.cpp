// Commands, devices and faults: the state machine. The transitions themselves are in states.h.
#include "firmware/core/core.h"

#include <algorithm>
#include <utility>

namespace hord::firmware {
Answer Core::step(const Event& event, TimePoint now, Actions& actions) {
    actions.clear();
    actions_ = &actions;
    answer_ = Answer::done;
    const TimePoint before = std::exchange(now_, std::max(now, now_));
    line_stop_unseen_ -= std::min({now_ - before, kMaxTurn, line_stop_unseen_});
    if (next_heartbeat_ == TimePoint{}) next_heartbeat_ = now_ + config_.station_heartbeat;
    if (now_ >= next_heartbeat_) {
        const auto beats = 1 + (now_ - next_heartbeat_) / config_.station_heartbeat;
        heartbeat_ = static_cast<std::uint16_t>(heartbeat_ + beats);
        next_heartbeat_ += beats * config_.station_heartbeat;
    }
    std::visit([this](const auto& e) { on(e); }, event);
    settle();

    // The line may run while the station executes and can reject, and after a stop until it is empty.
    const bool emptying = state_ == State::ready && run_permit_ && line_.size() > 0;
    const bool permit = (executing(state_) || emptying) && !line_stop_ && up(Device::rejector);
    if (permit != run_permit_) {
        run_permit_ = permit;
        actions.push(SetRunPermit{permit});
        if (permit) permitted_since_ = now_;
        else lose_permit();
    }
    if (line_stop_unseen_ > Duration::zero())
        next_wake_ = std::min(next_wake_, now_ + std::min(line_stop_unseen_, kMaxTurn));
    actions_ = nullptr;
    return answer_;
}

void Core::on(Command command) {
    if (!next_state(state_, command)) {
        answer_ = Answer::not_in_this_state;
        return;
    }
    if (command == Command::arm && !all_devices_up()) {
        answer_ = Answer::device_down;
        return;
    }
    if ((command == Command::start_single || command == Command::start_continuous) && without_plc(PlcPolicy::stop)) {
        answer_ = Answer::plc_lost;
        return;
    }
    const bool unseen_stop = command == Command::reset && line_stop_unseen_ > Duration::zero();
    if (unseen_stop || (command == Command::arm && now_ < ejector_rests_at_)) {
        answer_ = Answer::not_yet;
        return;
    }
    go(command);
}

void Core::go(Cause cause) {
    const auto to = next_state(state_, cause);
    if (!to) return;
    const State from = state_;
    state_ = *to;
    if (const auto* command = std::get_if<Command>(&cause)) carry_out(*command, from);
}

void Core::carry_out(Command command, State from) {
    switch (command) {
        case Command::initialise:
            started_ = true;
            for (int d = 0; d < kDevices; ++d) actions_->push(StartDevice{static_cast<Device>(d)});
            break;
        case Command::start_single:
        case Command::start_continuous:
            started_at_ = now_;
            draining_ = false;
            single_taken_ = false;
            failures_in_a_row_ = 0;
            break;
        case Command::stop: draining_ = true; break;
        case Command::abort: flush(PartReason::station_not_running); break;
        case Command::halt:
            flush(PartReason::station_not_running);
            if (started_) actions_->push(StopDevices{});
            started_ = false;
            up_ = 0;
            if (run_permit_) lose_permit();
            run_permit_ = false;  // StopDevices switches the output off
            break;
        case Command::reset:
            if (line_stop_) looked_after_at_ = now_;
            abandon_lost_places();
            reset_faults();
            if (from != State::halted) {  // start the devices that are down
                started_ = true;
                for (int d = 0; d < kDevices; ++d) {
                    if (!up(static_cast<Device>(d))) actions_->push(StartDevice{static_cast<Device>(d)});
                }
            }
            break;
        case Command::arm:
        case Command::disarm:
        case Command::commit_recipe:
        case Command::teach:
        case Command::self_test:
        case Command::use_recipe: break;
    }
}

// Gives every part without a verdict `unfit`. The reject commands follow when they are due.
void Core::flush(PartReason reason) {
    for (std::uint32_t k = 0; k < line_.size(); ++k) decide(line_[k], PartVerdict::unfit, reason);
}

void Core::reset_faults() {
    line_stop_ = false;
    line_stop_why_ = {};
    trouble_ = 0;
    faults_latched_ = 0;
    first_fault_ = 0;
    fault(active_faults());
}

void Core::on(const DeviceUp& event) {
    if (!started_) return;  // a report from before the halt
    up_ |= fault_of(event.device);
    if (event.device == Device::part_sensor) {  // its sequence numbers begin at 1 again, and its counts at 0
        last_edge_ = 0;
        last_kind_ = hal::PartEdge::Kind::leaves;
        last_edge_at_ = TimePoint::min();
        covered_ = false;
        if (config_.by_encoder) lose_position();
    }
    if (event.device == Device::sensor) frames_seen_ = false;
}

void Core::on(const DeviceLost& event) {
    if (!started_) return;
    up_ &= ~fault_of(event.device);
    fault(fault_of(event.device));
    for (std::uint32_t k = 0; k < line_.size(); ++k) {
        Part& part = line_[k];
        const bool needs_sensor = part.frame_due || !part.exposed;
        const bool needs_strobe = part.light_due || !part.exposed;
        if ((event.device == Device::sensor && needs_sensor) || (event.device == Device::strobe && needs_strobe)) {
            decide(part, PartVerdict::unfit, PartReason::device_lost);
        }
    }
    if (event.device == Device::part_sensor) {
        if (config_.by_encoder) lose_position();
        if (executing(state_)) stop_the_line({LineStopCause::part_sensor_lost});  // parts may pass undetected
    }
    go(Trigger::fault);
}

void Core::on(const PlcLost&) {
    plc_lost_ = true;
    if (config_.plc_policy == PlcPolicy::none) return;
    fault(kFaultPlc);
    if (without_plc(PlcPolicy::stop) && executing(state_)) go(Command::stop);
    if (without_plc(PlcPolicy::reject_all)) flush(PartReason::plc_lost);
}

void Core::on(const OutsideFaults& event) {
    outside_ = event.active & kOutsideFaults;
    fault(outside_);
}

bool Core::accepting() const {
    return executing(state_) && !draining_ && !(state_ == State::single_execution && single_taken_);
}

std::uint32_t Core::active_faults() const {
    std::uint32_t active = trouble_ | (line_stop_ ? std::uint32_t{kFaultRejectUnconfirmed} : 0U) | outside_;
    if (plc_lost_ && config_.plc_policy != PlcPolicy::none) active |= kFaultPlc;
    if (started_) active |= kDeviceFaults & ~up_;
    return active;
}

// Raises faults that stay active until a reset, or until count_trouble() sees that every device works.
void Core::keep_active(std::uint32_t bits) {
    trouble_ |= bits;
    fault(bits);
}

// Latches faults and remembers the first one.
void Core::fault(std::uint32_t bits) {
    faults_latched_ |= bits;
    if (first_fault_ != 0 || bits == 0) return;
    first_fault_ = 1;
    while ((bits & 1U) == 0) {
        bits >>= 1;
        ++first_fault_;
    }
}

void Core::stop_the_line(LineStop why) {
    if (!std::exchange(line_stop_, true)) {
        line_stop_unseen_ = kMinLineStop;
        line_stop_why_ = why;
    }
    fault(kFaultRejectUnconfirmed);
    go(Trigger::line_stop);
}

Snapshot Core::snapshot() const {
    return {.state = state_,
            .taken_ns = now_.time_since_epoch().count(),
            .line_stop = line_stop_,
            .line_stop_why = line_stop_why_,
            .run_permit = run_permit_,
            .faults_active = active_faults(),
            .faults_latched = faults_latched_,
            .first_fault = first_fault_,
            .station_heartbeat = heartbeat_,
            .parts_on_line = line_.size(),
            .counters = counters_,
            .last = last_};
}

std::vector<std::string> problems(const CoreConfig& c) {
    std::vector<std::string> all;
    const auto ms = [](Duration d) {
        std::string text = std::to_string(static_cast<double>(d.count()) / 1e6);
        text.erase(text.find_last_not_of('0') + 1);
        if (text.back() == '.') text.pop_back();
        return text + " ms";
    };
    const auto refuse = [&](bool wrong, const std::string& what, const char* cure) {
        if (wrong) all.push_back(what + ": " + cure);
    };
    const auto positive = [&](Duration d, const char* name) {
        refuse(d <= Duration::zero(), std::string(name) + " is " + ms(d), "give a time above 0");
    };
    positive(c.exposure, "timing.exposure_us");
    positive(c.strobe, "timing.strobe_us");
    positive(c.frame_timeout, "timing.frame_timeout_ms");
    positive(c.frame_window, "timing.frame_window_us");
    positive(c.reject_pulse, "rejector.pulse_ms");
    positive(c.station_heartbeat, "station.heartbeat_ms");
    static_assert(kLineCapacity == 256, "named in the cure");
    refuse(c.max_parts < 1 || c.max_parts > kLineCapacity, "line.max_parts is " + std::to_string(c.max_parts),
           "use 1 to 256");
    const Duration last_frame = c.exposure_delay + c.exposure + c.frame_timeout;
    const Duration deadline = c.transport - c.reject_early - c.reject_lead;
    refuse(!c.by_encoder && last_frame > deadline,
           "the verdict is due " + ms(deadline) +
               " after the edge (line.transport_ms less rejector.early_ms and lead_ms), the frame may come until " +
               ms(last_frame),
           "shorten timing.frame_timeout_ms or move the ejector downstream (line.transport_ms)");
    if (c.by_encoder && c.transport_counts <= 0) all.push_back("line.transport_counts must be above 0 with an encoder");
    refuse(c.by_encoder && c.exposure_counts >= c.transport_counts, "line.exposure_counts lies behind the ejector",
           "lower it, or raise line.transport_counts");
    refuse(c.min_gap < c.exposure, "line.min_gap_ms is " + ms(c.min_gap) + ", an exposure takes " + ms(c.exposure),
           "raise line.min_gap_ms or shorten timing.exposure_us");
    refuse(c.min_gap <= c.reject_pulse,
           "rejector.pulse_ms is " + ms(c.reject_pulse) + ", parts may follow after " + ms(c.min_gap),
           "shorten the pulse or raise line.min_gap_ms, else a neighbour is ejected");
    refuse(c.reject_early >= c.reject_pulse,
           "rejector.early_ms is " + ms(c.reject_early) + ", the pulse is over after " + ms(c.reject_pulse),
           "shorten early_ms or lengthen pulse_ms");
    refuse(2 * c.frame_window >= c.min_gap,
           "timing.frame_window_us is " + ms(c.frame_window) + ", half of line.min_gap_ms or more",
           "shorten it, else a frame may belong to two parts");
    refuse(!c.by_encoder && c.frame_window > c.exposure_delay,
           "timing.frame_window_us is " + ms(c.frame_window) + ", longer than line.exposure_delay_ms, " +
               ms(c.exposure_delay),
           "shorten it, or set the camera further behind the part sensor and raise exposure_delay_ms: else it admits "
           "frames from before the part's own edge");
    refuse(c.strobe_delay + c.strobe > c.exposure,
           "the light ends " + ms(c.strobe_delay + c.strobe) + " after the exposure's start, the exposure " +
               ms(c.exposure),
           "lengthen timing.exposure_us or shorten timing.strobe_us");
    return all;
}

}  // namespace hord::firmware
