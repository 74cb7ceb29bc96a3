#include "drivers/modbus_rejector.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/coil_link.h"
#include "drivers/hal/reject_ledger.h"

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
    struct News {  // from the thread to the loop
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
    std::vector<Job> asked;       // not yet taken by the thread
    bool permit_wanted = false;
    bool stopping = false;
    TimePoint stop_by;
    std::deque<News> news;

    // Driver's thread.
    CoilLink link;
    std::vector<Job> jobs;        // waiting for their start
    std::optional<TimePoint> acting_until;
    bool permit_written = false;
    std::optional<bool> told_up;
    TimePoint next_connect{}, next_check{};
    std::thread thread;

    Session(hal::EventLoop& l, const ModbusRejectorOptions& o) : loop(l), options(o), link(l, o.host, o.port, o.unit) {}

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

    void report(const Job& job, Outcome outcome) {
        tell({.settled = job.slot, .report = {job.command.part, outcome, now()}, .link = {}, .why = {}});
    }

    void tell_link(bool up, const Error& why = {}) {
        if (told_up == up) return;
        told_up = up;
        tell({.settled = {}, .report = {}, .link = up, .why = why});
    }

    void link_failed(const Error& why) {
        link.close();
        acting_until.reset();
        permit_written = false;
        {
            const std::scoped_lock lock(mutex);
            permit_wanted = false;  // down until said again
        }
        next_connect = now();  // at once the first time, then at its pace
        tell_link(false, why);
    }

    // The safe state first: what a command before may have left behind ends here.
    void try_connect() {
        next_connect = now() + options.reconnect_every;
        auto done = link.connect(options.response_timeout);
        if (done) done = link.write(options.ejector_coil, coil_for(false), options.response_timeout);
        if (done && options.permit_coil >= 0) done = link.write(options.permit_coil, false, options.response_timeout);
        if (!done) {
            link.close();
            tell_link(false, done.error());
            return;
        }
        {
            const std::scoped_lock lock(mutex);
            permit_wanted = false;  // whatever was said while there was no link
        }
        permit_written = false;
        next_check = now() + options.check_every;
        tell_link(true);
    }

    bool write(int coil, bool on, Error* error) {
        const auto done = link.write(coil, on, options.response_timeout);
        next_check = now() + options.check_every;
        if (done) return true;
        *error = done.error();
        if (!link.connected()) link_failed(done.error());
        return false;
    }

    void carry_out(const Job& job) {
        const TimePoint until = job.command.start + job.command.width;
        if (now() >= until) return report(job, Outcome::late);  // acting now would hit a neighbour
        if (!link.connected()) return report(job, Outcome::failed);
        Error error;
        const bool written = write(options.ejector_coil, coil_for(true), &error);
        // Even where the module says no, the coil is taken back at the end: it may have moved.
        if (link.connected()) acting_until = std::max(until, acting_until.value_or(until));
        report(job, !written ? Outcome::failed : now() < until ? Outcome::confirmed : Outcome::late);
    }

    void end_pulse() {
        Error error;
        if (write(options.ejector_coil, coil_for(false), &error)) {
            acting_until.reset();
        } else if (link.connected()) {  // refused: the ejector holds
            link_failed(error);
        }
    }

    void move_permit(bool wanted) {
        Error error;
        permit_written = wanted;
        if (options.permit_coil >= 0 && !write(options.permit_coil, wanted, &error) && link.connected()) link_failed(error);
    }

    void check() {
        next_check = now() + options.check_every;
        const auto value = link.read(options.ejector_coil, options.response_timeout);
        if (!value) return link_failed(value.error());
        if (*value != coil_for(acting_until.has_value())) {
            link_failed({ErrorCode::disconnected, "the rejector module at " + link.name() + " lost its outputs (it restarted, or something else writes them)",
                         "nothing to do if it restarted; else keep other writers away from the ejector's coil"});
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
        if (!link.connected()) {
            if (next_connect <= at) {
                try_connect();
                return at;
            }
        } else if (permit != permit_written) {
            move_permit(permit);
            return at;
        } else if (next_check <= at) {
            check();
            return at;
        }
        TimePoint next = link.connected() ? next_check : next_connect;
        if (acting_until) next = std::min(next, *acting_until);
        if (due != jobs.end()) next = std::min(next, due->command.start);
        return next;
    }

    // All coils to 0: the state into which a module falls by itself when nobody is there.
    void make_safe(TimePoint by) {
        for (const int coil : {options.ejector_coil, options.permit_coil}) {
            if (coil >= 0 && link.connected()) (void)link.write(coil, false, by - now());
        }
        link.close();
    }
};

ModbusRejector::ModbusRejector(hal::EventLoop& loop, ModbusRejectorOptions options) : loop_(loop), options_(std::move(options)) {}

ModbusRejector::~ModbusRejector() {
    if (session_) session_->listener = nullptr;  // may be gone already
    stop();
}

Result<void> ModbusRejector::do_start(Listener& listener) {
    std::string wrong;
    const auto need = [&](bool good, const char* what) {
        if (!good) wrong += (wrong.empty() ? "" : "; ") + std::string(what);
    };
    need(!options_.host.empty(), "host must not be empty");
    need(options_.port >= 1 && options_.port <= 65535, "port must be in 1..65535");
    need((options_.unit >= 1 && options_.unit <= 247) || options_.unit == 255, "unit must be in 1..247 or 255");
    need(options_.ejector_coil >= 0 && options_.ejector_coil <= 65535, "ejector_coil must be in 0..65535");
    need(options_.permit_coil >= -1 && options_.permit_coil <= 65535, "permit_coil must be in 0..65535, or -1 for none");
    need(options_.permit_coil != options_.ejector_coil, "permit_coil must not be the ejector_coil");
    need(options_.response_timeout >= 5ms && options_.response_timeout <= 1s, "response_timeout must be 5 ms to 1 s");
    need(options_.reconnect_every > 0ns && options_.check_every > 0ns, "reconnect_every and check_every must be above 0");
    if (!wrong.empty()) return fail(ErrorCode::invalid_argument, "Modbus rejector: " + wrong, "correct the rejector's configuration");
    session_ = std::make_shared<Session>(loop_, options_);
    session_->listener = &listener;
    session_->thread = std::thread([session = session_.get()] { session->run(); });
    return {};
}

Result<void> ModbusRejector::do_reject(const RejectCommand& command) {
    const auto entry = session_->ledger.enter(command);
    switch (entry.entered) {
        case hal::RejectLedger::Entered::full:
            return fail(ErrorCode::busy, "the rejector's queue is full", "space the rejects, or check that the module answers");
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
