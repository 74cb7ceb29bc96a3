#include "drivers/event_loop/event_loop_sd.h"

#include <cerrno>
#include <cstring>
#include <ctime>
#include <map>
#include <mutex>
#include <unordered_map>
#include <utility>
#include <vector>

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <systemd/sd-event.h>
#include <unistd.h>

#include "common/unique_fd.h"

namespace hord::firmware {
namespace {

tl::unexpected<Error> io_error(const char* what, int negative_errno) {
    return fail(ErrorCode::io, std::string(what) + ": " + std::strerror(-negative_errno),
                "check the limit of open files (ulimit -n)");
}

std::uint64_t to_usec_rounded_up(hal::TimePoint t) {
    const std::int64_t ns = t.time_since_epoch().count();
    return ns <= 0 ? 0 : (static_cast<std::uint64_t>(ns) + 999) / 1000;
}

}  // namespace

// sd-event orders sources by priority, not by creation, and rounds times to microseconds. So this class keeps the
// timers in the order that hal::EventLoop requires, behind one time source.
struct SdEventLoop::Loop {
    using Key = std::pair<hal::TimePoint, std::uint64_t>;
    struct Watch {
        Callback callback;
        sd_event_source* source = nullptr;
    };

    sd_event* event = nullptr;
    sd_event_source* time_source = nullptr;
    sd_event_source* post_source = nullptr;
    common::UniqueFd post_fd;
    int signal = 0;
    sigset_t signals{};  // that are watched
    std::vector<std::unique_ptr<Callback>> signal_callbacks;
    bool stop = false;  // not sd_event_exit(): after that a loop cannot run again

    std::map<Key, Callback> timers;
    std::unordered_map<std::uint64_t, hal::TimePoint> due_of;
    std::uint64_t last_timer = 0;

    std::unordered_map<std::uint64_t, std::unique_ptr<Watch>> watches;
    std::vector<std::unique_ptr<Watch>> gone_watches;  // their callback may still be running
    std::uint64_t last_watch = 0;

    std::mutex post_mutex;
    std::vector<Callback> posted;
    std::vector<Callback> running;

    ~Loop() {
        for (auto& [id, watch] : watches) sd_event_source_disable_unref(watch->source);
        sd_event_source_disable_unref(time_source);
        sd_event_source_disable_unref(post_source);
        // The event's end unblocks the signals. One that came since the loop ended, as from a person who asks twice,
        // would kill the process and replace its exit status.
        for (const timespec at_once{}; sigtimedwait(&signals, nullptr, &at_once) > 0;) {
        }
        sd_event_unref(event);
    }

    static hal::TimePoint now() {
        timespec t{};
        clock_gettime(CLOCK_MONOTONIC, &t);
        return hal::TimePoint(std::chrono::seconds(t.tv_sec) + hal::Duration(t.tv_nsec));
    }

    void arm() {
        if (timers.empty()) {
            sd_event_source_set_enabled(time_source, SD_EVENT_OFF);
            return;
        }
        sd_event_source_set_time(time_source, to_usec_rounded_up(timers.begin()->first.first));
        sd_event_source_set_enabled(time_source, SD_EVENT_ONESHOT);
    }

    // Runs the timers that are due, but not those that the callbacks add: descriptors are served in between.
    static int on_time(sd_event_source*, std::uint64_t, void* self) {
        auto& loop = *static_cast<Loop*>(self);
        const hal::TimePoint until = now();
        const std::uint64_t made_before = loop.last_timer;
        auto it = loop.timers.begin();
        while (it != loop.timers.end() && it->first.first <= until) {
            if (it->first.second > made_before) {
                ++it;
                continue;
            }
            Callback callback = std::move(it->second);
            loop.due_of.erase(it->first.second);
            loop.timers.erase(it);
            callback();
            it = loop.timers.begin();  // the callback may have cancelled any timer
        }
        loop.arm();
        return 0;
    }

    static int on_post(sd_event_source*, int fd, std::uint32_t, void* self) {
        auto& loop = *static_cast<Loop*>(self);
        std::uint64_t count = 0;
        [[maybe_unused]] const auto bytes = read(fd, &count, sizeof count);
        {
            const std::lock_guard lock(loop.post_mutex);
            loop.running.swap(loop.posted);
        }
        for (Callback& callback : loop.running) callback();
        loop.running.clear();
        return 0;
    }

    static int on_watch(sd_event_source*, int, std::uint32_t, void* watch) {
        static_cast<Watch*>(watch)->callback();
        return 0;
    }
};

SdEventLoop::SdEventLoop(std::unique_ptr<Loop> loop) : loop_(std::move(loop)) {}
SdEventLoop::~SdEventLoop() = default;

Result<std::unique_ptr<SdEventLoop>> SdEventLoop::open() {
    auto loop = std::make_unique<Loop>();
    int r = sd_event_new(&loop->event);
    loop->post_fd.reset(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
    if (r >= 0 && !loop->post_fd) r = -errno;
    if (r >= 0)
        r = sd_event_add_io(loop->event, &loop->post_source, loop->post_fd.get(), EPOLLIN, &Loop::on_post, loop.get());
    // Accuracy 1 us; sd-event's default is 250 ms, to save power.
    if (r >= 0)
        r = sd_event_add_time(loop->event, &loop->time_source, CLOCK_MONOTONIC, 0, 1, &Loop::on_time, loop.get());
    if (r < 0) return io_error("the event loop cannot be made", r);
    sd_event_source_set_enabled(loop->time_source, SD_EVENT_OFF);
    return std::unique_ptr<SdEventLoop>(new SdEventLoop(std::move(loop)));
}

Result<void> SdEventLoop::stop_on_signals(std::initializer_list<int> signals) {
    for (const int signal : signals) {
        auto watched = on_signal(signal, [loop = loop_.get(), signal] {
            loop->signal = signal;
            loop->stop = true;
        });
        if (!watched) return watched;
    }
    return {};
}

Result<void> SdEventLoop::on_signal(int signal, Callback callback) {
    loop_->signal_callbacks.push_back(std::make_unique<Callback>(std::move(callback)));
    const auto call = [](sd_event_source*, const signalfd_siginfo*, void* what) {
        (*static_cast<Callback*>(what))();
        return 0;
    };
    const int r = sd_event_add_signal(loop_->event, nullptr, signal | SD_EVENT_SIGNAL_PROCMASK, call,
                                      loop_->signal_callbacks.back().get());
    sigaddset(&loop_->signals, signal);
    return r < 0 ? io_error("signals cannot be watched", r) : Result<void>{};
}

Result<void> SdEventLoop::run() {
    while (!std::exchange(loop_->stop, false)) {
        if (const int r = sd_event_run(loop_->event, UINT64_MAX); r < 0) return io_error("the event loop failed", r);
        loop_->gone_watches.clear();
    }
    return {};
}

bool SdEventLoop::run_until(const std::function<bool()>& done, hal::Duration patience) {
    const hal::TimePoint give_up = now() + patience;
    bool held = false;
    TimerId timer{};
    const std::function<void()> look = [&] {
        held = done();
        if (held || now() >= give_up) return request_stop();
        timer = call_after(std::chrono::milliseconds(1), look);
    };
    post(look);
    const bool ran = run().has_value();
    cancel(timer);
    return ran && held;
}

void SdEventLoop::request_stop() {
    post([loop = loop_.get()] { loop->stop = true; });
}

int SdEventLoop::stopped_by() const { return loop_->signal; }

hal::TimePoint SdEventLoop::now() const { return Loop::now(); }

hal::EventLoop::TimerId SdEventLoop::call_at(hal::TimePoint due, Callback callback) {
    const std::uint64_t id = ++loop_->last_timer;
    const auto it = loop_->timers.emplace(Loop::Key{due, id}, std::move(callback)).first;
    loop_->due_of.emplace(id, due);
    if (it == loop_->timers.begin()) loop_->arm();
    return static_cast<TimerId>(id);
}

void SdEventLoop::cancel(TimerId timer) {
    const auto it = loop_->due_of.find(static_cast<std::uint64_t>(timer));
    if (it == loop_->due_of.end()) return;
    loop_->timers.erase(Loop::Key{it->second, it->first});
    loop_->due_of.erase(it);
}

Result<hal::EventLoop::WatchId> SdEventLoop::watch(int fd, Readiness what, Callback callback) {
    auto watch = std::make_unique<Loop::Watch>();
    watch->callback = std::move(callback);
    const std::uint32_t events = what == Readiness::readable ? EPOLLIN
        : what == Readiness::writable                        ? EPOLLOUT
                                                             : EPOLLIN | EPOLLOUT;
    const int r = sd_event_add_io(loop_->event, &watch->source, fd, events, &Loop::on_watch, watch.get());
    if (r < 0) return io_error("descriptor cannot be watched", r);
    const std::uint64_t id = ++loop_->last_watch;
    loop_->watches.emplace(id, std::move(watch));
    return static_cast<WatchId>(id);
}

void SdEventLoop::unwatch(WatchId id) {
    const auto it = loop_->watches.find(static_cast<std::uint64_t>(id));
    if (it == loop_->watches.end()) return;
    sd_event_source_disable_unref(std::exchange(it->second->source, nullptr));
    loop_->gone_watches.push_back(std::move(it->second));
    loop_->watches.erase(it);
}

void SdEventLoop::post(Callback callback) {
    {
        const std::lock_guard lock(loop_->post_mutex);
        loop_->posted.push_back(std::move(callback));
    }
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto bytes = write(loop_->post_fd.get(), &one, sizeof one);
}

}  // namespace hord::firmware
