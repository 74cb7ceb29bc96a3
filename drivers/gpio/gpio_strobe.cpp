#include "drivers/gpio/gpio_strobe.h"

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>

#include "drivers/hal/thread_safe_queue.h"

namespace hord::drivers {

using hal::Duration;
using hal::LightBudget;
using hal::StrobePulse;
using hal::StrobeReport;
using hal::TimePoint;

// The state of one start(): members of the loop thread, of the driver's thread, and those shared under the mutex. Held
// by shared_ptr because posted callbacks may run after stop().
struct GpioStrobe::Session : std::enable_shared_from_this<Session> {
    hal::EventLoop& loop;
    ThreadSafeQueue<std::function<void()>> events;  // from the driver's thread to the loop

    // Loop thread.
    hal::Strobe::Listener* listener = nullptr;
    bool lost = false;

    std::mutex mutex;
    std::condition_variable wake;
    std::vector<StrobePulse> requested;  // not yet begun
    bool stopping = false;

    // Driver's thread.
    std::unique_ptr<GpioOutputs> outputs;  // null after a loss
    LightBudget spent;
    std::thread thread;

    Session(hal::EventLoop& l, std::unique_ptr<GpioOutputs> lines, LightBudget budget)
        : loop(l), outputs(std::move(lines)), spent(std::move(budget)) {}

    // ---- loop's thread

    void deliver_events() {
        while (const auto event = events.pop()) {
            if (listener == nullptr) return;  // stopped by the previous callback, or before
            (*event)();
        }
    }

    // After the thread's end: the pulses that it did not begin.
    void report_unlit() {
        std::vector<StrobePulse> unlit;
        {
            const std::scoped_lock lock(mutex);
            unlit.swap(requested);
        }
        for (const StrobePulse& pulse : unlit) {
            if (listener != nullptr)
                listener->on_strobe({.exposure = pulse.exposure, .lit = false, .start = loop.now(), .width = {}});
        }
    }

    // ---- the driver's thread

    void send(std::function<void()> event) {
        events.push(std::move(event));
        loop.post([self = shared_from_this()] { self->deliver_events(); });
    }
    void report(const StrobeReport& report) {
        send([this, report] { listener->on_strobe(report); });
    }
    void report_not_lit(const StrobePulse& pulse) {
        report({.exposure = pulse.exposure, .lit = false, .start = loop.now(), .width = {}});
    }

    // Waits until `due`, the last kSpinTime without sleeping. Releases the mutex while it waits. False: stop requested.
    bool wait_until(std::unique_lock<std::mutex>& lock, TimePoint due) {
        while (!stopping) {
            const Duration left = due - loop.now();
            if (left <= Duration::zero()) return true;
            if (left > kSpinTime) {
                wake.wait_for(lock, left - kSpinTime);
                continue;
            }
            lock.unlock();
            while (loop.now() < due) {
            }
            lock.lock();
        }
        return false;
    }

    void run() {
        std::unique_lock lock(mutex);
        TimePoint check_at = loop.now() + kCheckEvery;
        while (!stopping) {
            const auto next = std::ranges::min_element(requested, {}, &StrobePulse::start);
            const TimePoint begin =
                next == requested.end() ? TimePoint::max() : std::max(next->start, spent.rested(next->channels));
            const TimePoint now = loop.now();
            const bool may_check = begin - now > kCheckMargin;
            if (may_check && now >= check_at) {
                if (!turn_off(lock)) return;
                check_at = loop.now() + kCheckEvery;
                continue;
            }
            if (const Duration left = begin - now; left > kSpinTime) {
                const std::size_t waiting = requested.size();
                const Duration longest = may_check ? check_at - now : Duration::max();
                wake.wait_for(lock, std::min(left - kSpinTime, longest),
                              [&] { return stopping || requested.size() != waiting; });
                continue;
            }
            const StrobePulse pulse = *next;
            requested.erase(next);
            if (!wait_until(lock, begin)) {
                requested.push_back(pulse);  // stop() reports it
                break;
            }
            if (!flash(lock, pulse)) return;
        }
    }

    // False: the lines are lost.
    bool flash(std::unique_lock<std::mutex>& lock, const StrobePulse& pulse) {
        const TimePoint on = loop.now();
        if (on >= pulse.start + pulse.width) {  // its exposure may be over
            report_not_lit(pulse);
            return turn_off(lock);
        }
        lock.unlock();
        auto done = outputs->set(pulse.channels);
        lock.lock();
        if (done) (void)wait_until(lock, on + pulse.width);
        lock.unlock();
        const auto off = outputs->set(0);
        const Duration width = loop.now() - on;
        spent.spend(pulse.channels, on, width);
        if (done && !off) done = off;
        if (done) {
            report({.exposure = pulse.exposure, .lit = true, .start = on, .width = width});
        } else {
            report_not_lit(pulse);
            lose(done.error());
        }
        lock.lock();
        return done.has_value();
    }

    // Writes "off" again. The kernel does not signal that a chip went away; without this check the loss would show at
    // the next pulse. False: the lines are lost.
    bool turn_off(std::unique_lock<std::mutex>& lock) {
        lock.unlock();
        const auto off = outputs->set(0);
        if (!off) lose(off.error());
        lock.lock();
        return off.has_value();
    }

    // A line that cannot be set may be on. Releasing the lines is the only way left to turn it off.
    void lose(const Error& why) {
        outputs.reset();
        send([this, why] {
            lost = true;
            report_unlit();
            if (listener != nullptr) listener->on_strobe_lost(why);
        });
    }
};

GpioStrobe::GpioStrobe(hal::EventLoop& loop, std::vector<LightLimits> limits, Lines lines)
    : loop_(loop), limits_(std::move(limits)), lines_(std::move(lines)), planned_(limits_), spent_(limits_) {}

GpioStrobe::~GpioStrobe() {
    if (session_) session_->listener = nullptr;  // the listener may not exist any more
    stop();
}

Result<std::unique_ptr<GpioStrobe>> GpioStrobe::open(hal::EventLoop& loop,
                                                     const std::vector<GpioStrobeChannel>& channels) {
    std::vector<LightLimits> limits;
    std::vector<GpioLine> lines;
    for (const GpioStrobeChannel& channel : channels) {
        limits.push_back(channel.limits);
        lines.push_back(channel.line);
    }
    return open(loop, std::move(limits), [lines] { return request_outputs(lines); });
}

Result<std::unique_ptr<GpioStrobe>> GpioStrobe::open(hal::EventLoop& loop, std::vector<LightLimits> limits,
                                                     Lines lines) {
    std::string wrong;
    const auto need = [&](bool good, const std::string& what) {
        if (!good) wrong += (wrong.empty() ? "" : "; ") + what;
    };
    need(!limits.empty() && limits.size() <= 32, "there must be 1 to 32 channels");
    for (std::size_t k = 0; k < limits.size(); ++k) {
        const std::string channel = "channel " + std::to_string(k) + ": ";
        need(limits[k].max_on > Duration::zero(), channel + "max_on must be above 0");
        need(limits[k].min_rest >= Duration::zero(), channel + "min_rest must not be negative");
        need(limits[k].max_duty > 0 && limits[k].max_duty <= 1, channel + "max_duty must be above 0 and at most 1");
    }
    if (!wrong.empty())
        return fail(ErrorCode::invalid_argument, "strobe: " + wrong, "correct the strobe's configuration");
    std::unique_ptr<GpioStrobe> strobe(new GpioStrobe(loop, std::move(limits), std::move(lines)));
    auto outputs = strobe->lines_();
    if (!outputs) return tl::unexpected(outputs.error());
    strobe->outputs_ = std::move(*outputs);
    return strobe;
}

hal::StrobeLimits GpioStrobe::limits() const {
    hal::StrobeLimits limits{Duration::zero(), Duration::max(),
                             static_cast<int>(limits_.size())};  // the widest of all channels; do_fire() checks each
    for (const LightLimits& channel : limits_) {
        limits.max_on = std::max(limits.max_on, channel.max_on);
        limits.min_rest = std::min(limits.min_rest, channel.min_rest);
    }
    return limits;
}

Result<void> GpioStrobe::do_start(Listener& listener) {
    if (!outputs_) {
        auto outputs = lines_();
        if (!outputs) return tl::unexpected(outputs.error());
        outputs_ = std::move(*outputs);
    }
    if (auto off = outputs_->set(0); !off) {
        outputs_.reset();
        return off;
    }
    session_ = std::make_shared<Session>(loop_, std::move(outputs_), spent_);
    session_->listener = &listener;
    session_->thread = std::thread([session = session_.get()] { session->run(); });
    return {};
}

Result<void> GpioStrobe::do_fire(const StrobePulse& pulse) {
    if (session_->lost)
        return fail(ErrorCode::disconnected, "the strobe's GPIO lines are lost", "stop it and start it again");
    if (auto checked = planned_.check(pulse.channels, pulse.start, pulse.width); !checked) return checked;
    {
        const std::scoped_lock lock(session_->mutex);
        if (session_->requested.size() >= kMaxPending)
            return fail(ErrorCode::busy, "too many strobe pulses are waiting", "ask for them later");
        session_->requested.push_back(pulse);
    }
    planned_.spend(pulse.channels, pulse.start, pulse.width);
    session_->wake.notify_one();
    return {};
}

void GpioStrobe::do_stop() {
    const std::shared_ptr<Session> session = std::exchange(session_, nullptr);
    {
        const std::scoped_lock lock(session->mutex);
        session->stopping = true;
    }
    session->wake.notify_one();
    session->thread.join();
    outputs_ = std::move(session->outputs);
    if (outputs_ && !outputs_->set(0)) outputs_.reset();
    spent_ = session->spent;
    session->deliver_events();  // finished pulses; the others are reported as not lit
    session->report_unlit();
    session->listener = nullptr;
}

}  // namespace hord::drivers
