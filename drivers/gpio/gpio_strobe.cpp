#include "drivers/gpio/gpio_strobe.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

namespace hord::drivers {

using hal::Duration;
using hal::StrobePulse;
using hal::StrobeReport;
using hal::TimePoint;

// Both halves of a running driver. What crosses between them lies under the mutex; the loop's half may outlive the
// thread's by what is still posted, hence shared.
struct GpioStrobe::Session : std::enable_shared_from_this<Session> {
    struct News {  // from the thread to the loop
        std::optional<StrobeReport> report;
        Error lost;  // when there is no report
    };

    hal::EventLoop& loop;

    // Loop thread.
    hal::Strobe::Listener* listener = nullptr;
    bool lost = false;

    std::mutex mutex;
    std::condition_variable wake;
    std::vector<StrobePulse> asked;  // not yet begun
    bool stopping = false;
    std::deque<News> news;

    // The thread's.
    std::unique_ptr<GpioOutputs> outputs;  // null after a loss
    LightBudget spent;
    std::thread thread;

    Session(hal::EventLoop& l, std::unique_ptr<GpioOutputs> lines, LightBudget budget)
        : loop(l), outputs(std::move(lines)), spent(std::move(budget)) {}

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
            if (item.report) {
                listener->on_strobe(*item.report);
                continue;
            }
            lost = true;
            forget_asked();
            if (listener != nullptr) listener->on_strobe_lost(item.lost);
        }
    }

    // Pulses that will not be lit: the thread has ended.
    void forget_asked() {
        std::vector<StrobePulse> forgotten;
        {
            const std::scoped_lock lock(mutex);
            forgotten.swap(asked);
        }
        for (const StrobePulse& pulse : forgotten) {
            if (listener != nullptr)
                listener->on_strobe({.exposure = pulse.exposure, .lit = false, .start = loop.now(), .width = {}});
        }
    }

    // ---- the driver's thread

    void tell(News item) {
        {
            const std::scoped_lock lock(mutex);
            news.push_back(std::move(item));
        }
        loop.post([self = shared_from_this()] { self->take_news(); });
    }
    void not_lit(const StrobePulse& pulse) {
        tell({StrobeReport{.exposure = pulse.exposure, .lit = false, .start = loop.now(), .width = {}}, {}});
    }

    // The thread waits until `due`, or until it is told to stop. Keeps the mutex but for the waiting; false: stop.
    bool wait_until(std::unique_lock<std::mutex>& lock, TimePoint due) {
        while (!stopping) {
            const Duration left = due - loop.now();
            if (left <= Duration::zero()) return true;
            if (left > kWatch) {
                wake.wait_for(lock, left - kWatch);
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
        TimePoint look_at = loop.now() + kLookEvery;
        while (!stopping) {
            const auto next = std::ranges::min_element(asked, {}, &StrobePulse::start);
            const TimePoint begin =
                next == asked.end() ? TimePoint::max() : std::max(next->start, spent.rested(next->channels));
            const TimePoint now = loop.now();
            const bool time_to_look = begin - now > kLookClear;
            if (time_to_look && now >= look_at) {
                if (!look(lock)) return;
                look_at = loop.now() + kLookEvery;
                continue;
            }
            if (const Duration left = begin - now; left > kWatch) {
                const std::size_t known = asked.size();
                const Duration longest = time_to_look ? look_at - now : Duration::max();
                wake.wait_for(lock, std::min(left - kWatch, longest),
                              [&] { return stopping || asked.size() != known; });
                continue;
            }
            const StrobePulse pulse = *next;
            asked.erase(next);
            if (!wait_until(lock, begin)) {
                asked.push_back(pulse);  // stop() reports it
                break;
            }
            if (!flash(lock, pulse)) return;
        }
    }

    // False: the lines are lost.
    bool flash(std::unique_lock<std::mutex>& lock, const StrobePulse& pulse) {
        const TimePoint on = loop.now();
        if (on >= pulse.start + pulse.width) return skip(lock, pulse);  // its exposure is over, or may be
        lock.unlock();
        auto done = outputs->set(pulse.channels);
        lock.lock();
        if (done) (void)wait_until(lock, on + pulse.width);
        lock.unlock();
        const auto off = outputs->set(0);
        const Duration width = loop.now() - on;
        spent.spend(pulse.channels, on, width);
        if (done && !off) done = off;
        if (!done) {
            lose(pulse, done.error());
            lock.lock();
            return false;
        }
        tell({StrobeReport{.exposure = pulse.exposure, .lit = true, .start = on, .width = width}, {}});
        lock.lock();
        return true;
    }

    // Lights nothing, and sees by that whether the lines still obey.
    bool skip(std::unique_lock<std::mutex>& lock, const StrobePulse& pulse) {
        lock.unlock();
        const auto off = outputs->set(0);
        if (off) not_lit(pulse);
        else lose(pulse, off.error());
        lock.lock();
        return off.has_value();
    }

    // The kernel wakes nobody when a chip goes away. Whoever brings it back and resets the station must not find the
    // lines of the chip that was: so they are told to be off once more, while nothing is lit and no pulse is near.
    // False: the lines are lost.
    bool look(std::unique_lock<std::mutex>& lock) {
        lock.unlock();
        const auto off = outputs->set(0);
        if (!off) lose(off.error());
        lock.lock();
        return off.has_value();
    }

    // A line that cannot be set may be on: letting go of all of them is what is left.
    void lose(const StrobePulse& pulse, const Error& why) {
        outputs.reset();
        not_lit(pulse);
        lose(why);
    }
    void lose(const Error& why) {
        outputs.reset();
        tell({std::nullopt, why});
    }
};

GpioStrobe::GpioStrobe(hal::EventLoop& loop, std::vector<LightLimits> limits, Lines lines)
    : loop_(loop), limits_(std::move(limits)), lines_(std::move(lines)), planned_(limits_), spent_(limits_) {}

GpioStrobe::~GpioStrobe() {
    if (session_) session_->listener = nullptr;  // may be gone already
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

hal::StrobeLimits GpioStrobe::do_limits() const {
    hal::StrobeLimits limits{Duration::zero(), Duration::max(),
                             static_cast<int>(limits_.size())};  // of the strongest; fire() knows each
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
        if (session_->asked.size() >= kPending)
            return fail(ErrorCode::busy, "too many strobe pulses are waiting", "ask for them later");
        session_->asked.push_back(pulse);
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
    session->take_news();  // what is known is reported as it is, the rest as not lit
    session->forget_asked();
    session->listener = nullptr;
}

}  // namespace hord::drivers
