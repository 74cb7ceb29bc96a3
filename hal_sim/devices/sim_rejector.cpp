#include "hal_sim/devices/sim_rejector.h"

#include <algorithm>

namespace hord::sim {

using hal::Duration;
using hal::TimePoint;
using Outcome = hal::RejectReport::Outcome;

SimRejector::~SimRejector() {
    listener_ = nullptr;  // it may be destroyed already: no report to it
    stop();
}

Result<void> SimRejector::do_start(Listener& listener) {
    listener_ = &listener;
    ledger_.clear();
    if (options_.permit_moves_belt) world_.halt();
    link_timer_ = loop_.call_after(options_.link_after, [this] { link_goes_up(); });
    return {};
}

void SimRejector::link_goes_up() {
    up_ = true;
    listener_->on_rejector_link(true, {});
}

void SimRejector::link_goes_down(Duration gone_for) {
    up_ = false;
    move_permit(false);
    loop_.cancel(link_timer_);
    link_timer_ = loop_.call_after(gone_for, [this] { link_goes_up(); });
    listener_->on_rejector_link(
        false, {ErrorCode::disconnected, "simulated rejector is gone", "wait; the driver keeps trying"});
}

void SimRejector::move_permit(bool permit) {
    permit_ = permit;
    if (!options_.permit_moves_belt) return;
    if (permit) world_.resume();
    else world_.halt();
}

void SimRejector::do_set_run_permit(bool permit) {
    if (up_ && !permit && permit_ && options_.permit_moves_belt) {
        permit_ = false;
        world_.run_out();
    } else if (up_ || !permit) {
        move_permit(permit);
    }
}

Result<void> SimRejector::do_reject(const hal::RejectCommand& command) {
    const auto entry = ledger_.enter(command);
    switch (entry.entered) {
        case hal::RejectLedger::Entered::full:
            return fail(ErrorCode::busy, "simulated rejector's queue is full",
                        "space the rejects or shorten the pulse");
        case hal::RejectLedger::Entered::repeat: break;
        case hal::RejectLedger::Entered::settled: jobs_.add(loop_.now(), {entry.report, std::nullopt}); break;
        case hal::RejectLedger::Entered::fresh: carry_out(command, entry.slot); break;
    }
    return {};
}

void SimRejector::carry_out(const hal::RejectCommand& command, std::size_t ledger_slot) {
    const TimePoint until = command.start + command.width;
    const TimePoint asked = std::max(command.start, loop_.now());
    TimePoint from = asked;
    const auto answer = [&](Outcome outcome, TimePoint at) {
        jobs_.add(at, {{command.part, outcome, at}, ledger_slot});
    };
    const auto down_for = faults_.fires(InjectedFault::rejector_down),
               late_by = faults_.fires(InjectedFault::reject_late),
               again_after = faults_.fires(InjectedFault::reject_twice);
    const bool lost = faults_.fires(InjectedFault::reject_lost).has_value(),
               stuck = faults_.fires(InjectedFault::ejector_stuck).has_value(),
               unacknowledged = faults_.fires(InjectedFault::reject_unacknowledged).has_value();
    if (down_for && up_) {
        loop_.cancel(down_timer_);
        down_timer_ = loop_.call_after({}, [this, gone = *down_for] { link_goes_down(gone); });
    }
    if (!up_ || down_for || lost) return answer(Outcome::failed, from + options_.give_up_after);
    const TimePoint acknowledged = from + latency_.next();
    if (from >= until) return answer(Outcome::late, acknowledged);  // a pulse now would hit a neighbour
    if (late_by) from += *late_by;
    if (!stuck) pulses_.add(from, {from, from + (until - asked), false});
    if (again_after)
        pulses_.add(until + *again_after, {until + *again_after, until + *again_after + command.width, false});
    if (unacknowledged) return answer(Outcome::failed, from + options_.give_up_after);
    answer(from >= until ? Outcome::late : Outcome::confirmed, acknowledged + late_by.value_or(Duration::zero()));
}

void SimRejector::settle(const Job& job) {
    std::uint32_t owed = job.ledger_slot ? ledger_.settle(*job.ledger_slot, job.report) : 1;
    for (; owed > 0 && listener_ != nullptr; --owed) listener_->on_reject(job.report);
}

void SimRejector::step(Pulse pulse) {
    pulse.open = !pulse.open;
    if (pulse.open) pulses_.add(pulse.until, pulse);
    valve(pulse.open, pulse.open ? pulse.from : pulse.until);
}

void SimRejector::valve(bool open, TimePoint at) {
    open_ += open ? 1 : -1;
    if (open ? open_ == 1 : open_ == 0) world_.set_ejector(open, at);
}

void SimRejector::do_stop() {
    move_permit(false);
    up_ = false;
    loop_.cancel(link_timer_);
    loop_.cancel(down_timer_);
    pulses_.drop([this](const Pulse& pulse) {
        if (pulse.open) valve(false, loop_.now());
    });
    jobs_.drop([this](Job& job) {
        if (job.ledger_slot) job.report = {job.report.part, Outcome::failed, loop_.now()};
        settle(job);
    });
    listener_ = nullptr;
}

}  // namespace hord::sim
