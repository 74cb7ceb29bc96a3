#include "drivers/modbus/modbus_rejector.h"

#include <algorithm>
#include <array>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "drivers/hal/reject_ledger.h"
#include "drivers/hal/thread_safe_queue.h"
#include "drivers/modbus/rejector_module.h"

namespace hord::drivers {

using hal::Duration;
using hal::RejectCommand;
using hal::RejectReport;
using hal::TimePoint;
using Outcome = RejectReport::Outcome;
using namespace std::chrono_literals;

// The state of one start(): members of the loop thread, of the driver's thread, and those shared under the mutex. Held
// by shared_ptr because posted callbacks may run after stop().
struct ModbusRejector::Session : std::enable_shared_from_this<Session> {
    struct Job {
        std::size_t slot = 0;  // of the ledger
        RejectCommand command;
    };
    struct Unconfirmed {  // acknowledged, but the confirm sensor has not seen the part
        Job job;
        TimePoint acknowledged, until;
    };

    hal::EventLoop& loop;
    const ModbusRejectorOptions options;
    ThreadSafeQueue<std::function<void()>> events;  // from the driver's thread to the loop

    // Loop thread.
    hal::Rejector::Listener* listener = nullptr;
    hal::RejectLedger ledger;

    std::mutex mutex;
    std::condition_variable wake;
    std::vector<Job> requested;  // not yet seen by the driver's thread
    bool permit_wanted = false;
    bool stopping = false;
    TimePoint stop_by;

    // Driver's thread.
    RejectorModule module;
    std::vector<Job> jobs;                 // before their start
    std::vector<Unconfirmed> unconfirmed;  // in the order of their acknowledgement
    std::optional<TimePoint> pulse_end;    // of the pulse under way
    bool permit_written = false;
    std::optional<bool> reported_link;
    TimePoint next_connect{}, next_check{}, next_confirm_read{};
    bool check_permit_next = false;
    std::thread thread;

    Session(hal::EventLoop& l, const ModbusRejectorOptions& o) : loop(l), options(o), module(l, o) {}

    // ---- loop's thread

    void deliver_events() {
        while (const auto event = events.pop()) {
            if (listener == nullptr) return;  // stopped by the previous callback, or before
            (*event)();
        }
    }

    void deliver(const RejectReport& report, std::uint32_t times) {
        for (; times > 0 && listener != nullptr; --times) listener->on_reject(report);
    }

    // ---- either thread

    void send(std::function<void()> event) {
        events.push(std::move(event));
        loop.post([self = shared_from_this()] { self->deliver_events(); });
    }

    // ---- the driver's thread

    [[nodiscard]] TimePoint now() const { return loop.now(); }

    void report(const Job& job, Outcome outcome, TimePoint at) {
        send([this, slot = job.slot, report = RejectReport{job.command.part, outcome, at}] {
            deliver(report, ledger.settle(slot, report));
        });
    }
    void report(const Job& job, Outcome outcome) { report(job, outcome, now()); }

    void tell_failure(const Error& why) {
        send([this, why] { listener->on_reject_failed(why); });
    }

    void report_link(bool up, const Error& why_down = {}) {
        if (reported_link == up) return;
        reported_link = up;
        send([this, up, why_down] { listener->on_rejector_link(up, why_down); });
    }

    void link_failed(const Error& why) {
        module.link().close();
        pulse_end.reset();
        for (const Unconfirmed& one : std::exchange(unconfirmed, {})) report(one.job, Outcome::failed);
        next_connect = now();  // the first attempt at once, further ones every reconnect_every
        report_link(false, why);
    }

    void try_connect() {
        next_connect = now() + options.reconnect_every;
        if (auto done = module.connect(); !done) {
            module.link().close();
            report_link(false, done.error());
            return;
        }
        {
            const std::scoped_lock lock(mutex);
            permit_wanted = false;  // a permit set without a link does not count
        }
        permit_written = false;
        next_check = next_confirm_read = now() + options.check_every;
        report_link(true);
    }

    // After a write: false, with its error, if it failed; a lost link is handled here.
    bool succeeded(const Result<void>& written, Error* error) {
        next_check = now() + options.check_every;
        if (written) return true;
        *error = written.error();
        if (!module.link().connected()) link_failed(written.error());
        return false;
    }

    void carry_out(const Job& job) {
        const TimePoint until = job.command.start + job.command.width;
        if (!module.link().connected()) return report(job, Outcome::failed);
        if (now() + options.module_pulse >= until)
            return report(job, Outcome::late);  // acting now would hit a neighbour
        Error error;
        const bool written = succeeded(module.start_pulse(), &error);
        // Also after a refused write the pulse is ended: the output may have moved.
        if (module.link().connected()) pulse_end = std::max(until, pulse_end.value_or(until));
        if (!written) {
            if (module.link().connected()) tell_failure(error);
            return report(job, Outcome::failed);
        }
        if (now() >= until) return report(job, Outcome::late);
        const TimePoint acknowledged = module.link().acknowledged();
        if (options.confirm_input < 0) return report(job, Outcome::confirmed, acknowledged);
        unconfirmed.push_back({job, acknowledged, until + options.confirm_within});
        next_confirm_read = now();
    }

    // Ends a pulse or sets the permit. Unlike a pulse's start, these may be repeated: a write that a serial line lost
    // is written once more. If that fails as well, the link is given up.
    template <class Write>
    void write_repeatable(Write write) {
        Error error;
        if (succeeded(write(), &error) || !module.link().connected()) return;
        if (error.code == ErrorCode::io && succeeded(write(), &error)) return;
        if (module.link().connected()) link_failed(error);
    }

    void end_pulse() {
        if (!module.times_pulse()) write_repeatable([&] { return module.end_pulse(); });
        pulse_end.reset();
    }

    void move_permit(bool permit) {
        permit_written = permit;
        if (options.permit_coil >= 0) write_repeatable([&] { return module.set_permit(permit); });
    }

    // Checks that the outputs are as they were last written; one output a call, in turn.
    void check_outputs() {
        next_check = now() + options.check_every;
        check_permit_next = options.permit_coil >= 0 && !check_permit_next;
        if (!check_permit_next && module.times_pulse() && pulse_end) return;  // the pulse may be under way or over
        const auto done =
            check_permit_next ? module.check_permit(permit_written) : module.check_ejector(pulse_end.has_value());
        if (!done) link_failed(done.error());
    }

    // A part that arrives at the confirm sensor confirms the oldest command that waits for it.
    void read_confirm_sensor() {
        // The sensor is also read often while a part is present: the next part shows as a rise only after a fall.
        const bool often = !unconfirmed.empty() || module.part_present();
        next_confirm_read = now() + (often ? options.confirm_every : options.check_every);
        const auto arrived = module.part_arrived();
        if (!arrived) return link_failed(arrived.error());
        if (!*arrived || unconfirmed.empty()) return;
        report(unconfirmed.front().job, Outcome::confirmed, unconfirmed.front().acknowledged);
        unconfirmed.erase(unconfirmed.begin());
    }

    void fail_unconfirmed() {
        while (!unconfirmed.empty() && unconfirmed.front().until <= now()) {
            const Job& job = unconfirmed.front().job;
            tell_failure({ErrorCode::timeout,
                          "the confirm sensor (input " + std::to_string(options.confirm_input) + ") did not see part " +
                              std::to_string(job.command.part) + " within " +
                              std::to_string(options.confirm_within / 1ms) + " ms of its pulse",
                          "check the valve and its air, the sensor, and rejector.confirm_within_ms"});
            report(job, Outcome::failed);
            unconfirmed.erase(unconfirmed.begin());
        }
    }

    void trigger_watchdog() {
        if (auto done = module.trigger_watchdog(); !done) link_failed(done.error());
    }

    void run() {
        std::unique_lock lock(mutex);
        while (!stopping) {
            jobs.insert(jobs.end(), requested.begin(), requested.end());
            requested.clear();
            const bool permit = permit_wanted;
            lock.unlock();
            const TimePoint next = step(permit);
            lock.lock();
            wake.wait_for(lock, next - now(),
                          [&] { return stopping || !requested.empty() || permit_wanted != permit; });
        }
        const TimePoint by = stop_by;
        lock.unlock();
        module.make_safe(by);
    }

    // Runs the most urgent task; returns when the next one is due.
    TimePoint step(bool permit) {
        fail_unconfirmed();
        const TimePoint at = now();
        if (pulse_end && *pulse_end <= at) {
            end_pulse();
            return at;
        }
        const auto due = std::ranges::min_element(jobs, {}, [](const Job& job) { return job.command.start; });
        if (due != jobs.end() && due->command.start <= at) {
            const Job job = *due;
            jobs.erase(due);
            carry_out(job);
            return at;
        }
        TimePoint urgent = TimePoint::max();  // when the next pulse starts or ends
        if (pulse_end) urgent = *pulse_end;
        if (due != jobs.end()) urgent = std::min(urgent, due->command.start);
        if (!module.link().connected()) {
            if (next_connect > at) return std::min(urgent, next_connect);
            try_connect();
            return at;
        }
        if (permit != permit_written) {
            move_permit(permit);
            return at;
        }
        TimePoint next = std::min(urgent, poll_module(at, urgent));
        for (const Unconfirmed& one : unconfirmed) next = std::min(next, one.until);
        return next;
    }

    // Runs the checks, confirm sensor readings and watchdog triggers that are due, unless `urgent` comes within the
    // time of an exchange. Each is delayed by its patience at most. Returns when the next one is due.
    TimePoint poll_module(TimePoint at, TimePoint urgent) {
        struct Task {
            TimePoint due;
            Duration patience;
            void (Session::*act)();
        };
        std::array<Task, 3> tasks{{{next_check, options.check_every, &Session::check_outputs},
                                   {options.confirm_input >= 0 ? next_confirm_read : TimePoint::max(),
                                    options.confirm_every, &Session::read_confirm_sensor},
                                   {module.watchdog_due(), options.watchdog / 3, &Session::trigger_watchdog}}};
        const Task& first = *std::ranges::min_element(tasks, {}, &Task::due);
        if (first.due > at) return first.due;
        const bool enough_time = urgent == TimePoint::max() || urgent - at > 2 * module.link().typical_response();
        if (!enough_time && at - first.due < first.patience) return urgent;
        (this->*first.act)();
        return now();
    }
};

ModbusRejector::ModbusRejector(hal::EventLoop& loop, ModbusRejectorOptions options)
    : loop_(loop), options_(std::move(options)) {}

ModbusRejector::~ModbusRejector() {
    if (session_) session_->listener = nullptr;  // the listener may not exist any more
    stop();
}

Result<void> ModbusRejector::do_start(Listener& listener) {
    std::string wrong;
    const auto need = [&](bool good, const std::string& what) {
        if (!good) wrong += (wrong.empty() ? "" : "; ") + what;
    };
    const ModbusRejectorOptions& o = options_;
    if (o.address.serial) {
        need(!o.address.serial->device.empty(), "device must not be empty");
        need(o.address.serial->baud >= 1200, "baud must be 1200 or more");
        need(o.address.unit >= 1 && o.address.unit <= 247, "unit must be in 1..247 on a serial line");
    } else {
        need(!o.address.host.empty(), "host must not be empty");
        need(o.address.port >= 1 && o.address.port <= 65535, "port must be in 1..65535");
        need((o.address.unit >= 1 && o.address.unit <= 247) || o.address.unit == 255, "unit must be in 1..247 or 255");
    }
    need(o.ejector_coil >= 0 && o.ejector_coil <= 65535, "ejector_coil must be in 0..65535");
    need(o.permit_coil >= -1 && o.permit_coil <= 65535, "permit_coil must be in 0..65535, or -1 for none");
    for (const auto& [name, coil, other] :
         {std::tuple("ejector_coil", o.ejector_coil, o.permit_coil), {"permit_coil", o.permit_coil, o.ejector_coil}}) {
        const std::string why = coil < 0 ? "" : not_an_output(o.map, coil, other);
        need(why.empty(), std::string(name) + " " + why);
    }
    need(o.response_timeout >= 5ms && o.response_timeout <= 1s, "response_timeout must be 5 ms to 1 s");
    need(o.reconnect_every > 0ns && o.check_every > 0ns && o.confirm_every > 0ns,
         "reconnect_every, check_every and confirm_every must be above 0");
    need(o.module_pulse == 0ns || o.map.pulse_coil_offset >= 0,
         "the module has no coil that pulses an output: module_pulse must be 0");
    need(o.module_pulse == 0ns || !o.energise_to_pass, "a module pulses an output on: it cannot be energise_to_pass");
    need(o.watchdog == 0ns ||
             (o.map.watchdog_time_register >= 0 && o.map.watchdog_trigger_register >= 0 &&
              o.map.watchdog_stop_register >= 0),
         "the module has no watchdog that is set over Modbus: watchdog must be 0");
    need(o.watchdog == 0ns || o.watchdog >= 3 * o.response_timeout, "watchdog must be three response_timeouts or more");
    if (!wrong.empty())
        return fail(ErrorCode::invalid_argument, "Modbus rejector: " + wrong, "correct the rejector's configuration");
    session_ = std::make_shared<Session>(loop_, options_);
    session_->listener = &listener;
    session_->thread = std::thread([session = session_.get()] { session->run(); });
    return {};
}

Result<void> ModbusRejector::do_reject(const RejectCommand& command) {
    const auto entry = session_->ledger.enter(command);
    switch (entry.entered) {
        case hal::RejectLedger::Entered::full:
            return fail(ErrorCode::busy, "the rejector's queue is full",
                        "space the rejects, or check that the module answers");
        case hal::RejectLedger::Entered::repeat: return {};
        case hal::RejectLedger::Entered::settled:
            session_->send([session = session_.get(), report = entry.report] { session->deliver(report, 1); });
            return {};
        case hal::RejectLedger::Entered::fresh: break;
    }
    {
        const std::scoped_lock lock(session_->mutex);
        session_->requested.push_back({entry.slot, command});
    }
    session_->wake.notify_one();
    return {};
}

void ModbusRejector::do_set_run_permit(bool permit) {
    {
        const std::scoped_lock lock(session_->mutex);
        session_->permit_wanted = permit;
    }
    session_->wake.notify_one();
}

void ModbusRejector::do_stop() {
    const std::shared_ptr<Session> session = std::exchange(session_, nullptr);
    {
        const std::scoped_lock lock(session->mutex);
        session->stopping = true;
        session->stop_by = loop_.now() + 3 * options_.response_timeout;  // the safe state may need a second link
    }
    session->wake.notify_one();
    session->thread.join();
    session->deliver_events();  // settled commands; the others are reported as failed
    session->ledger.settle_all(Outcome::failed, loop_.now(), [&](const RejectReport& report) {
        if (session->listener != nullptr) session->listener->on_reject(report);
    });
    session->listener = nullptr;
}

}  // namespace hord::drivers
