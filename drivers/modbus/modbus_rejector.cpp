#include "drivers/modbus/modbus_rejector.h"

#include <algorithm>
#include <array>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/hal/reject_ledger.h"
#include "drivers/modbus/coil_link.h"

namespace hord::drivers {
namespace {

using hal::Duration;
using hal::RejectCommand;
using hal::RejectReport;
using hal::TimePoint;
using Outcome = RejectReport::Outcome;
using namespace std::chrono_literals;

}  // namespace

// Both halves of a running driver. What crosses between them lies under the mutex; the loop's half may outlive the
// thread's by what is still posted, hence shared.
struct ModbusRejector::Session : std::enable_shared_from_this<Session> {
    struct Job {
        std::size_t slot = 0;
        RejectCommand command;
    };
    struct News {                            // from the thread to the loop
        std::optional<std::size_t> settled;  // a ledger slot; none: the link changed, or a settled command was repeated
        RejectReport report;
        std::optional<bool> link;
        Error why;
    };

    hal::EventLoop& loop;
    const ModbusRejectorOptions options;

    // Loop thread.
    hal::Rejector::Listener* listener = nullptr;
    hal::RejectLedger ledger;

    std::mutex mutex;
    std::condition_variable wake;
    std::vector<Job> asked;  // not yet taken by the thread
    bool permit_wanted = false;
    bool stopping = false;
    TimePoint stop_by;
    std::deque<News> news;

    // Driver's thread.
    struct Awaited {  // acknowledged; the ejected part has still to be seen
        Job job;
        TimePoint acknowledged, until;
    };
    CoilLink link;
    std::vector<Job> jobs;                  // waiting for their start
    std::vector<Awaited> awaited;           // in the order of their acknowledgement
    std::optional<TimePoint> acting_until;  // the coil has to be taken back then; with module_pulse: the module does it
    bool permit_written = false;
    std::optional<bool> told_up;
    TimePoint next_connect{}, next_check{}, next_look{}, next_feed{};
    bool check_permit = false;  // the check's turn
    bool seen_part = false;     // the confirm sensor, when last read
    int fed = 0;
    std::thread thread;

    Session(hal::EventLoop& l, const ModbusRejectorOptions& o) : loop(l), options(o), link(l, o.address) {}

    // ---- loop's thread

    void take_news() {
        for (;;) {
            News item;
            {
                const std::scoped_lock lock(mutex);
                if (news.empty()) return;
                item = std::move(news.front());
                news.pop_front();
            }
            if (listener == nullptr) return;  // stopped, perhaps by the call before
            if (item.link) {
                listener->on_rejector_link(*item.link, item.why);
                continue;
            }
            std::uint32_t owed = item.settled ? ledger.settle(*item.settled, item.report) : 1;
            for (; owed > 0 && listener != nullptr; --owed) listener->on_reject(item.report);
        }
    }

    // ---- either thread

    void tell(News item) {
        {
            const std::scoped_lock lock(mutex);
            news.push_back(std::move(item));
        }
        loop.post([self = shared_from_this()] { self->take_news(); });
    }

    // ---- the driver's thread

    [[nodiscard]] TimePoint now() const { return loop.now(); }
    [[nodiscard]] bool coil_for(bool act) const { return act != options.energise_to_pass; }
    [[nodiscard]] bool module_times() const { return options.module_pulse > 0ns; }
    [[nodiscard]] int pulse_coil() const { return options.ejector_coil + options.map.pulse_coil_offset; }

    void report(const Job& job, Outcome outcome, TimePoint at) {
        tell({.settled = job.slot, .report = {job.command.part, outcome, at}, .link = {}, .why = {}});
    }
    void report(const Job& job, Outcome outcome) { report(job, outcome, now()); }

    void tell_link(bool up, const Error& why = {}) {
        if (told_up == up) return;
        told_up = up;
        tell({.settled = {}, .report = {}, .link = up, .why = why});
    }

    void link_failed(const Error& why) {
        link.close();
        acting_until.reset();
        permit_written = false;
        for (const Awaited& one : std::exchange(awaited, {})) report(one.job, Outcome::failed);
        {
            const std::scoped_lock lock(mutex);
            permit_wanted = false;  // down until said again
        }
        next_connect = now();  // at once the first time, then at its pace
        tell_link(false, why);
    }

    Result<void> write_output(int coil, bool on, Duration timeout) {
        return link.write(coil, on, coil + options.map.read_back_offset, timeout);
    }

    // The safe state first: what a command before may have left behind ends here.
    Result<void> make_ready() {
        const Duration timeout = options.response_timeout;
        const hal::ModuleMap& map = options.map;
        if (auto done = link.connect(timeout); !done) return done;
        if (map.alarm_coil >= 0) {
            const auto alarm = link.read(map.alarm_coil, timeout);
            if (!alarm) return tl::unexpected(alarm.error());
            if (*alarm) {
                if (auto done = link.command(map.alarm_coil, true, timeout); !done) return done;
            }
        }
        if (options.watchdog > 0ns) {
            if (auto done = start_watchdog(); !done) return done;
        }
        if (module_times() && map.pulse_width_register >= 0) {
            const auto units = static_cast<int>(options.module_pulse / map.pulse_width_unit);
            if (auto done = link.write_register(map.pulse_width_register, units, timeout); !done) return done;
        }
        if (options.confirm_input >= 0) {
            const auto there = link.read_input(options.confirm_input, timeout);
            if (!there) return tl::unexpected(there.error());
            seen_part = *there != options.confirm_active_low;
        }
        auto done = module_times() ? link.command(pulse_coil(), false, timeout)
                                   : write_output(options.ejector_coil, coil_for(false), timeout);
        if (done && options.permit_coil >= 0) done = write_output(options.permit_coil, false, timeout);
        return done;
    }

    // Stops it (only then its time can be set, and an expired one lets go), sets its time, starts it.
    Result<void> start_watchdog() {
        const hal::ModuleMap& map = options.map;
        auto done = link.write_register(map.watchdog_stop_register, map.watchdog_stop_value, options.response_timeout);
        const auto units = static_cast<int>((options.watchdog + map.watchdog_unit - 1ns) / map.watchdog_unit);
        if (done) done = link.write_register(map.watchdog_time_register, units, options.response_timeout);
        for (int k = 0; k < 2 && done; ++k)
            done = feed();  // one of the two differs from what a station before left there
        return done;
    }
    Result<void> feed() {
        fed = fed == 1 ? 2 : 1;  // each value differs from the one before
        next_feed = now() + options.watchdog / 3;
        return link.write_register(options.map.watchdog_trigger_register, fed, options.response_timeout);
    }

    void try_connect() {
        next_connect = now() + options.reconnect_every;
        if (auto done = make_ready(); !done) {
            link.close();
            tell_link(false, done.error());
            return;
        }
        {
            const std::scoped_lock lock(mutex);
            permit_wanted = false;  // whatever was said while there was no link
        }
        permit_written = false;
        next_check = next_look = now() + options.check_every;
        tell_link(true);
    }

    bool survived(const Result<void>& done, Error* error) {
        next_check = now() + options.check_every;
        if (done) return true;
        *error = done.error();
        if (!link.connected()) link_failed(done.error());
        return false;
    }
    bool write(int coil, bool on, Error* error) {
        return survived(write_output(coil, on, options.response_timeout), error);
    }

    void carry_out(const Job& job) {
        const TimePoint until = job.command.start + job.command.width;
        if (!link.connected()) return report(job, Outcome::failed);
        if (now() + options.module_pulse >= until)
            return report(job, Outcome::late);  // acting now would hit a neighbour
        Error error;
        const bool written = module_times()
            ? survived(link.command(pulse_coil(), true, options.response_timeout), &error)
            : write(options.ejector_coil, coil_for(true), &error);
        // Even where the module says no, the coil is taken back at the end: it may have moved.
        if (link.connected()) acting_until = std::max(until, acting_until.value_or(until));
        if (!written) return report(job, Outcome::failed);
        if (now() >= until) return report(job, Outcome::late);
        if (options.confirm_input < 0) return report(job, Outcome::confirmed, link.acknowledged());
        awaited.push_back({job, link.acknowledged(), until + options.confirm_within});
        next_look = now();
    }

    void end_pulse() {
        if (module_times()) return acting_until.reset();
        Error error;
        // Taking it back may be repeated, unlike acting: a line that swallowed it once is asked once more.
        if (write(options.ejector_coil, coil_for(false), &error) ||
            (link.connected() && error.code == ErrorCode::io && write(options.ejector_coil, coil_for(false), &error))) {
            acting_until.reset();
        } else if (link.connected()) {  // refused: the ejector holds
            link_failed(error);
        }
    }

    void move_permit(bool wanted) {
        Error error;
        permit_written = wanted;
        if (options.permit_coil < 0 || write(options.permit_coil, wanted, &error)) return;
        if (link.connected() && error.code == ErrorCode::io && write(options.permit_coil, wanted, &error)) return;
        if (link.connected()) link_failed(error);
    }

    // Whether the outputs still are as they were written, one after the other.
    void check() {
        next_check = now() + options.check_every;
        check_permit = options.permit_coil >= 0 && !check_permit;
        if (!check_permit && module_times() && acting_until) return;  // its pulse may be under way or over
        const int coil = check_permit ? options.permit_coil : module_times() ? pulse_coil() : options.ejector_coil;
        const bool wanted = check_permit ? permit_written : module_times() ? false : coil_for(acting_until.has_value());
        const bool pulse = !check_permit && module_times();
        const auto value = link.read(pulse ? coil : coil + options.map.read_back_offset, options.response_timeout);
        if (!value) return link_failed(value.error());
        if (*value != wanted) {
            link_failed({ErrorCode::disconnected,
                         "the rejector module at " + link.name() + " lost its outputs: coil " + std::to_string(coil) +
                             " is " + (*value ? "1" : "0") +
                             " (it restarted, its watchdog expired, or something else writes it)",
                         "nothing to do if it restarted; else keep other writers away from its coils"});
        }
    }

    // The confirm sensor: a part that arrives confirms the oldest command that awaits one.
    void look_for_part() {
        // Its fall must be seen, too: the next part shows by the next rise.
        next_look = now() + (awaited.empty() && !seen_part ? options.check_every : options.confirm_every);
        const auto value = link.read_input(options.confirm_input, options.response_timeout);
        if (!value) return link_failed(value.error());
        const bool there = *value != options.confirm_active_low;
        const bool arrived = !std::exchange(seen_part, there) && there;
        if (!arrived || awaited.empty()) return;
        report(awaited.front().job, Outcome::confirmed, awaited.front().acknowledged);
        awaited.erase(awaited.begin());
    }

    void give_up_unseen() {
        while (!awaited.empty() && awaited.front().until <= now()) {
            report(awaited.front().job, Outcome::failed);
            awaited.erase(awaited.begin());
        }
    }

    void run() {
        std::unique_lock lock(mutex);
        while (!stopping) {
            jobs.insert(jobs.end(), asked.begin(), asked.end());
            asked.clear();
            const bool permit = permit_wanted;
            lock.unlock();
            const TimePoint next = step(permit);
            lock.lock();
            const Duration pause = next - now();
            if (!stopping && asked.empty() && permit_wanted == permit && pause > 0ns) {
                wake.wait_for(lock, pause, [&] { return stopping || !asked.empty() || permit_wanted != permit; });
            }
        }
        const TimePoint by = stop_by;
        lock.unlock();
        make_safe(by);
    }

    // Does the one thing that is most pressing; returns when there is something to do again.
    TimePoint step(bool permit) {
        give_up_unseen();
        const TimePoint at = now();
        if (acting_until && *acting_until <= at) {
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
        TimePoint pressing = TimePoint::max();
        if (acting_until) pressing = *acting_until;
        if (due != jobs.end()) pressing = std::min(pressing, due->command.start);
        if (!link.connected()) {
            if (next_connect > at) return std::min(pressing, next_connect);
            try_connect();
            return at;
        }
        if (permit != permit_written) {
            move_permit(permit);
            return at;
        }
        const TimePoint wanted = quiet_things(at, pressing);
        TimePoint next = std::min(pressing, wanted);
        for (const Awaited& one : awaited) next = std::min(next, one.until);
        return next;
    }

    // What can wait, unless something presses within the time that an exchange takes; but not for ever. Returns when it
    // is due.
    TimePoint quiet_things(TimePoint at, TimePoint pressing) {
        struct Thing {
            TimePoint due;
            Duration patience;
            void (Session::*act)();
        };
        std::array<Thing, 3> things{
            {{next_check, options.check_every, &Session::check},
             {options.confirm_input >= 0 ? next_look : TimePoint::max(), options.confirm_every,
              &Session::look_for_part},
             {options.watchdog > 0ns ? next_feed : TimePoint::max(), options.watchdog / 3, &Session::keep_alive}}};
        const Thing& first = *std::ranges::min_element(things, {}, &Thing::due);
        if (first.due > at) return first.due;
        const bool room = pressing == TimePoint::max() || pressing - at > 2 * link.usual();
        if (!room && at - first.due < first.patience) return pressing;
        (this->*first.act)();
        return now();
    }

    void keep_alive() {
        if (auto done = feed(); !done) link_failed(done.error());
    }

    // All coils to 0: the state into which a module falls by itself when nobody is there.
    void make_safe(TimePoint by) {
        link.give_up_at(by);
        if (link.connected() && module_times()) (void)link.command(pulse_coil(), false, by - now());
        for (const int coil : {module_times() ? -1 : options.ejector_coil, options.permit_coil}) {
            if (coil >= 0 && link.connected()) (void)write_output(coil, false, by - now());
        }
        if (link.connected() && options.watchdog > 0ns)
            (void)link.write_register(options.map.watchdog_stop_register, options.map.watchdog_stop_value, by - now());
        link.close();
    }
};

ModbusRejector::ModbusRejector(hal::EventLoop& loop, ModbusRejectorOptions options)
    : loop_(loop), options_(std::move(options)) {}

ModbusRejector::~ModbusRejector() {
    if (session_) session_->listener = nullptr;  // may be gone already
    stop();
}

Result<void> ModbusRejector::do_start(Listener& listener) {
    std::string wrong;
    const auto need = [&](bool good, const char* what) {
        if (!good) wrong += (wrong.empty() ? "" : "; ") + std::string(what);
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
    need(o.permit_coil != o.ejector_coil, "permit_coil must not be the ejector_coil");
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
            session_->tell({.settled = {}, .report = entry.report, .link = {}, .why = {}});
            return {};
        case hal::RejectLedger::Entered::fresh: break;
    }
    {
        const std::scoped_lock lock(session_->mutex);
        session_->asked.push_back({entry.slot, command});
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
        session->stop_by = loop_.now() + options_.response_timeout;
    }
    session->wake.notify_one();
    session->thread.join();
    session->take_news();  // what is known is reported as it is, the rest as failed
    session->ledger.settle_all(Outcome::failed, loop_.now(), [&](const RejectReport& report) {
        if (session->listener != nullptr) session->listener->on_reject(report);
    });
    session->listener = nullptr;
}

}  // namespace hord::drivers
