// An event loop over poll() on a thread of its own, for tests of the server.
#pragma once

#include <algorithm>
#include <atomic>
#include <deque>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <thread>

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "drivers/hal/event_loop.h"

namespace hord::firmware::modbus {

class PollLoop : public hal::EventLoop {
  public:
    PollLoop() : wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)), thread_([this] { run(); }) {}
    ~PollLoop() override {
        post([this] { stop_ = true; });
        thread_.join();
        ::close(wake_);
    }
    // Runs `f` on the loop's thread and returns its result.
    template <class F>
    auto on_loop(F f) {
        std::packaged_task<decltype(f())()> task(std::move(f));
        auto result = task.get_future();
        post([&] { task(); });
        return result.get();
    }
    // Turns of the loop so far; grows quickly if something is always ready.
    std::uint64_t turns() const { return turns_; }

    hal::TimePoint now() const override {
        return hal::TimePoint(
            std::chrono::duration_cast<hal::Duration>(std::chrono::steady_clock::now().time_since_epoch()));
    }
    TimerId call_at(hal::TimePoint due, Callback callback) override {
        timers_.push_back({due, ++last_id_, std::move(callback)});
        return TimerId{last_id_};
    }
    void cancel(TimerId timer) override {
        std::erase_if(timers_, [&](const Timer& t) { return TimerId{t.id} == timer; });
    }
    Result<WatchId> watch(int fd, Readiness what, Callback callback) override {
        const short events = what == Readiness::readable ? POLLIN
            : what == Readiness::writable                ? POLLOUT
                                                         : POLLIN | POLLOUT;
        watches_[++last_id_] = {fd, events, std::make_shared<Callback>(std::move(callback))};
        return WatchId{last_id_};
    }
    void unwatch(WatchId watch) override { watches_.erase(static_cast<std::uint64_t>(watch)); }
    void post(Callback callback) override {
        {
            const std::lock_guard lock(mutex_);
            posted_.push_back(std::move(callback));
        }
        const std::uint64_t one = 1;
        [[maybe_unused]] const auto written = ::write(wake_, &one, sizeof one);
    }

  private:
    struct Timer {
        hal::TimePoint due;
        std::uint64_t id;
        Callback callback;
    };
    struct Watch {
        int fd;
        short events;
        std::shared_ptr<Callback> callback;
    };

    void run() {
        while (!stop_) {
            ++turns_;
            std::vector<pollfd> fds{{wake_, POLLIN, 0}};
            std::vector<std::uint64_t> ids{0};
            for (const auto& [id, watch] : watches_) {
                fds.push_back({watch.fd, watch.events, 0});
                ids.push_back(id);
            }
            ::poll(fds.data(), fds.size(), timers_.empty() ? -1 : 1);
            std::uint64_t count = 0;
            [[maybe_unused]] const auto got = ::read(wake_, &count, sizeof count);
            for (std::size_t k = 1; k < fds.size(); ++k) {
                const auto found = watches_.find(ids[k]);
                if (fds[k].revents == 0 || found == watches_.end()) continue;
                const auto callback = found->second.callback;  // stays alive when it unwatches itself
                (*callback)();
            }
            const auto due =
                std::partition(timers_.begin(), timers_.end(), [&](const Timer& t) { return t.due > now(); });
            std::vector<Timer> expired(std::make_move_iterator(due), std::make_move_iterator(timers_.end()));
            timers_.erase(due, timers_.end());
            for (const Timer& timer : expired) timer.callback();
            std::deque<Callback> posted;
            {
                const std::lock_guard lock(mutex_);
                posted.swap(posted_);
            }
            for (const Callback& callback : posted) callback();
        }
    }

    int wake_;
    std::map<std::uint64_t, Watch> watches_;
    std::vector<Timer> timers_;
    std::uint64_t last_id_ = 0;
    std::mutex mutex_;
    std::deque<Callback> posted_;
    bool stop_ = false;
    std::atomic<std::uint64_t> turns_ = 0;
    std::thread thread_;
};

}  // namespace hord::firmware::modbus
