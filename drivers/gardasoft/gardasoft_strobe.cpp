#include "drivers/gardasoft/gardasoft_strobe.h"

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "drivers/gardasoft/gardasoft_link.h"
#include "drivers/gardasoft/gardasoft_protocol.h"
#include "drivers/hal/thread_safe_queue.h"

namespace hord::drivers {

using hal::Duration;
using hal::LightBudget;
using hal::StrobePulse;
using hal::StrobeReport;
using hal::TimePoint;

namespace {

std::vector<hal::LightLimits> limits_of(const GardasoftStrobeOptions& options) {
    std::vector<hal::LightLimits> limits;
    for (const GardasoftChannel& channel : options.channels) limits.push_back(channel.limits);
    return limits;
}

Result<void> each_dark(GardasoftLink& link, const GardasoftStrobeOptions& options) {
    Result<void> done;
    for (const GardasoftChannel& channel : options.channels) {
        const auto dark = link.tell(gardasoft::dark_command(channel));
        if (!dark && done) done = tl::unexpected(dark.error());
        // After any other error the link is of no use any more.
        if (!dark && dark.error().code != ErrorCode::refused && dark.error().code != ErrorCode::unreadable) break;
    }
    return done;
}

Result<void> check_options(const GardasoftStrobeOptions& options) {
    using namespace std::chrono_literals;
    std::string wrong;
    const auto need = [&](bool good, const std::string& what) {
        if (!good) wrong += (wrong.empty() ? "" : "; ") + what;
    };
    need(options.host.empty() != options.device.empty(), "either host or device must be named");
    need(!options.channels.empty() && options.channels.size() <= 8, "there must be 1 to 8 channels");
    for (const auto& [name, time] : {std::pair("pulse", options.pulse), {"delay", options.delay}}) {
        need(time >= kGardasoftShortest && time <= kGardasoftLongest && time % 1us == 0ns,
             std::string(name) + " must be 20 us to 999 ms, in whole microseconds");
    }
    for (std::size_t k = 0; k < options.channels.size(); ++k) {
        const GardasoftChannel& channel = options.channels[k];
        const std::string name = "channel " + std::to_string(k) + ": ";
        need(channel.output >= 1 && channel.output <= 8, name + "output must be 1 to 8");
        need(channel.rated_ma >= 10 && channel.rated_ma <= 3000, name + "rated_ma must be 10 to 3000");
        need(channel.brightness_percent >= 1 && channel.brightness_percent <= 999,
             name + "brightness_percent must be 1 to 999");
        need(channel.limits.max_on >= options.pulse, name + "max_on is shorter than the pulse");
        need(channel.limits.min_rest >= Duration::zero(), name + "min_rest must not be negative");
        need(channel.limits.max_duty > 0 && channel.limits.max_duty <= 1, name + "max_duty must be above 0, at most 1");
        need(options.pulse + channel.limits.rest_after(options.pulse) <= kGardasoftLongest,
             name + "pulse and rest must be at most 999 ms");
        const GardasoftProblem problem = problem_of(channel, options.pulse);
        need(problem.key.empty(), name + problem.key + " " + problem.what);
        for (std::size_t j = 0; j < k; ++j)
            need(options.channels[j].output != channel.output, name + "output lights another channel, too");
    }
    if (wrong.empty()) return {};
    return fail(ErrorCode::invalid_argument, "strobe: " + wrong, "correct the strobe's configuration");
}

}  // namespace

// Lives as long as the last posted callback. The driver joins the thread.
struct GardasoftStrobe::Worker final : std::enable_shared_from_this<Worker>, hal::Strobe::Listener {
    hal::EventLoop& loop;
    const GardasoftStrobeOptions options;
    ThreadSafeQueue<std::function<void()>> events;  // from the thread to the loop

    // Loop thread.
    hal::Strobe::Listener* listener = nullptr;
    bool lost = false;

    std::mutex mutex;
    std::condition_variable wake, settled;
    std::vector<StrobePulse> requested;  // not yet begun
    bool running = false;                // between start() and stop()
    bool in_pulse = false;               // from a pulse's trigger to the end of its light
    bool ready = false;                  // the controller is set up
    bool quitting = false;
    Error why;  // it is not ready

    // The thread's.
    std::optional<GardasoftLink> link;
    LightBudget spent;
    std::size_t checked = 0;  // the channel that is read back next
    std::thread thread;

    Worker(hal::EventLoop& l, GardasoftStrobeOptions o) : loop(l), options(std::move(o)), spent(limits_of(options)) {}

    // ---- loop's thread

    void deliver_events() {
        while (const auto event = events.pop()) {
            if (listener == nullptr) return;  // stopped by the previous callback, or before
            (*event)();
        }
    }

    void lose(const Error& error) {
        if (std::exchange(lost, true)) return;
        report_unlit();
        if (listener != nullptr) listener->on_strobe_lost(error);
    }

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

    // Of the strobe that drives the controller's inputs.
    void on_strobe(const StrobeReport& report) override {
        if (listener == nullptr) return;
        bool lit = report.lit;
        {
            const std::scoped_lock lock(mutex);
            lit = lit && ready;
        }
        listener->on_strobe({report.exposure, lit, report.start + options.delay, lit ? options.pulse : Duration{}});
    }
    void on_strobe_lost(const Error& error) override { lose(error); }

    // ---- the driver's thread; `lock` is held on entry and exit, and released while the thread waits or talks

    using Lock = std::unique_lock<std::mutex>;

    void send(std::function<void()> event) {
        events.push(std::move(event));
        loop.post([self = shared_from_this()] { self->deliver_events(); });
    }
    void report(const StrobeReport& report) {
        send([this, report] { listener->on_strobe(report); });
    }

    // Makes every output dark first, whatever the controller did before. Does it again if the set-up is refused: some
    // of its settings may be in force by then.
    Result<void> set_up() {
        link.reset();
        auto opened = GardasoftLink::open(options);
        if (!opened) return tl::unexpected(opened.error());
        link = std::move(*opened);
        auto up = set_each();
        if (!up) make_dark();
        return up;
    }

    // Uses the open connection, or a new one if that fails. Closes the connection.
    void make_dark() {
        const bool dark = link && each_dark(*link, options);
        link.reset();
        if (!dark) (void)set_dark(options);
    }

    // The settings, each read back.
    Result<void> set_each() {
        if (auto dark = each_dark(*link, options); !dark) return dark;
        for (const char* command : {"TT0", "GT0"}) {  // no internal trigger, no messages
            if (auto done = link->tell(command); !done) return done;
        }
        const auto old =
            link->ask("GR").and_then([](const std::string& text) { return gardasoft::error_of_events("GR", text); });
        if (!old) return tl::unexpected(old.error());
        for (const GardasoftChannel& channel : options.channels) {
            for (const std::string& command : {gardasoft::rating_command(channel),
                                               gardasoft::pulse_command(channel, options.pulse, options.delay)}) {
                if (auto done = link->tell(command); !done) return done;
            }
            if (auto same = read_back(channel); !same) return same;
        }
        return {};
    }

    Result<void> read_back(const GardasoftChannel& channel) {
        const auto text = link->ask("ST" + std::to_string(channel.output));
        if (!text) return tl::unexpected(text.error());
        const auto state = gardasoft::parse_channel(*text);
        if (!state) return tl::unexpected(state.error());
        const std::string differs = gardasoft::difference(*state, channel, options.pulse, options.delay);
        if (differs.empty()) return {};
        return fail(
            ErrorCode::refused,
            "output " + std::to_string(channel.output) + " of the strobe controller is not as it was set: " + differs,
            "was it switched off and on, or set by its keys or another program? reset the station");
    }

    Result<void> check() {
        auto same = read_back(options.channels[checked++ % options.channels.size()]);
        return same ? link->tell("GR") : same;
    }

    void run() {
        Lock lock(mutex);
        TimePoint check_at = loop.now() + kCheckEvery;
        while (!quitting) {
            if (!ready) {
                lock.unlock();
                const auto up = set_up();
                lock.lock();
                if (up) {
                    ready = true;
                    check_at = loop.now() + kCheckEvery;
                } else {
                    why = up.error();
                    wake.wait_for(lock, kRetryEvery, [&] { return quitting; });
                }
                continue;
            }
            const auto next = std::ranges::min_element(requested, {}, &StrobePulse::start);
            const TimePoint begin = next == requested.end()
                ? TimePoint::max()
                : std::max(next->start, spent.rested(next->channels)) - options.delay;
            const TimePoint now = loop.now();
            const bool may_check = begin - now > kCheckMargin;
            if (may_check && now >= check_at) {
                lock.unlock();
                const auto fine = check();
                lock.lock();
                check_at = loop.now() + kCheckEvery;
                if (!fine) give_up(fine.error());
                continue;
            }
            const Duration left = std::min(begin - now, may_check ? check_at - now : Duration::max());
            if (left > Duration::zero()) {
                const std::size_t waiting = requested.size();
                wake.wait_for(lock, left, [&] { return quitting || requested.size() != waiting; });
                continue;
            }
            const StrobePulse pulse = *next;
            requested.erase(next);
            flash(lock, pulse);
        }
        lock.unlock();
        make_dark();
    }

    void flash(Lock& lock, const StrobePulse& pulse) {
        if (loop.now() >= pulse.start + pulse.width) {  // its exposure may be over
            report({.exposure = pulse.exposure, .lit = false, .start = loop.now(), .width = {}});
            return;
        }
        in_pulse = true;
        lock.unlock();
        const auto done = link->tell(gardasoft::trigger_command(options, pulse.channels));
        const TimePoint start = loop.now() + options.delay;
        spent.spend(pulse.channels, start, options.pulse);
        std::this_thread::sleep_for(start + options.pulse - loop.now());
        report({pulse.exposure, done.has_value(), start, done ? options.pulse : Duration{}});
        lock.lock();
        in_pulse = false;
        settled.notify_all();
        if (!done) give_up(done.error());
    }

    // The controller is dark without a trigger; run() sets it up again.
    void give_up(const Error& error) {
        ready = false;
        why = error;
        if (running) send([this, error] { lose(error); });
    }
};

GardasoftStrobe::GardasoftStrobe(std::shared_ptr<Worker> worker, std::unique_ptr<hal::Strobe> trigger)
    : worker_(std::move(worker)), trigger_(std::move(trigger)), planned_(limits_of(worker_->options)) {}

GardasoftStrobe::~GardasoftStrobe() {
    worker_->listener = nullptr;  // the listener may not exist any more
    stop();
    {
        const std::scoped_lock lock(worker_->mutex);
        worker_->quitting = true;
    }
    worker_->wake.notify_one();
    worker_->thread.join();
}

Result<std::unique_ptr<GardasoftStrobe>> GardasoftStrobe::open(hal::EventLoop& loop, GardasoftStrobeOptions options,
                                                               std::unique_ptr<hal::Strobe> trigger) {
    if (auto good = check_options(options); !good) return tl::unexpected(good.error());
    auto worker = std::make_shared<Worker>(loop, std::move(options));
    if (auto up = worker->set_up(); !up) return tl::unexpected(up.error());
    worker->ready = true;
    worker->thread = std::thread([raw = worker.get()] { raw->run(); });
    return std::unique_ptr<GardasoftStrobe>(new GardasoftStrobe(std::move(worker), std::move(trigger)));
}

hal::StrobeLimits GardasoftStrobe::limits() const {
    hal::StrobeLimits limits{worker_->options.pulse, Duration::max(),
                             static_cast<int>(worker_->options.channels.size())};
    for (const GardasoftChannel& channel : worker_->options.channels)
        limits.min_rest = std::min(limits.min_rest, channel.limits.min_rest);
    return limits;
}

hal::LightLimits GardasoftStrobe::trigger_limits(const GardasoftChannel& channel,
                                                 const GardasoftStrobeOptions& options) {
    // Its pulse begins a delay earlier than the light and ends with it.
    return {.max_on = options.pulse + options.delay,
            .min_rest = std::max(channel.limits.min_rest - options.delay, Duration::zero()),
            .max_duty = 1};
}

Result<void> GardasoftStrobe::do_start(Listener& listener) {
    {
        const std::scoped_lock lock(worker_->mutex);
        if (!worker_->ready) return tl::unexpected(worker_->why);
    }
    if (trigger_) {
        if (auto started = trigger_->start(*worker_); !started) return started;
    }
    const std::scoped_lock lock(worker_->mutex);
    worker_->running = true;
    worker_->listener = &listener;
    worker_->lost = false;
    return {};
}

Result<void> GardasoftStrobe::do_fire(const StrobePulse& pulse) {
    if (worker_->lost)
        return fail(ErrorCode::disconnected, "the strobe controller is lost", "stop the strobe and start it again");
    if (pulse.width != worker_->options.pulse) {
        return fail(ErrorCode::invalid_argument,
                    "strobe pulse of " + std::to_string(pulse.width.count()) + " ns; the controller is set to " +
                        std::to_string(worker_->options.pulse.count()) + " ns",
                    "set timing.strobe_us and start the station again");
    }
    if (auto checked = planned_.check(pulse.channels, pulse.start, pulse.width); !checked) return checked;
    {
        const std::scoped_lock lock(worker_->mutex);
        if (!worker_->ready) return fail(ErrorCode::disconnected, worker_->why.what, worker_->why.cure);
        if (worker_->requested.size() >= kMaxPending)
            return fail(ErrorCode::busy, "too many strobe pulses are waiting", "ask for them later");
        if (!trigger_) worker_->requested.push_back(pulse);
    }
    if (trigger_) {
        const Duration delay = worker_->options.delay;
        auto fired = trigger_->fire({pulse.exposure, pulse.channels, pulse.start - delay, pulse.width + delay});
        if (!fired) return fired;
    }
    planned_.spend(pulse.channels, pulse.start, pulse.width);
    worker_->wake.notify_one();
    return {};
}

void GardasoftStrobe::do_stop() {
    if (trigger_) trigger_->stop();
    {
        Worker::Lock lock(worker_->mutex);
        worker_->running = false;
        // The controller ends a pulse by itself.
        worker_->settled.wait(lock, [&] { return !worker_->in_pulse; });
    }
    worker_->deliver_events();
    worker_->report_unlit();
    worker_->listener = nullptr;
    worker_->lost = false;
}

Result<void> set_dark(const GardasoftStrobeOptions& options) {
    auto link = GardasoftLink::open(options);
    if (!link) return tl::unexpected(link.error());
    return each_dark(*link, options);
}

Result<std::string> identify(const GardasoftStrobeOptions& options) {
    auto link = GardasoftLink::open(options);
    if (!link) return tl::unexpected(link.error());
    return link->ask("VR").and_then(gardasoft::parse_version);
}

}  // namespace hord::drivers
