// Browsers that receive events (server-sent events): a limited number, each with a queue of limited length. Any thread.
//
// Nothing blocks: a viewer without an event is put to sleep and woken by the next one, both under the lock.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>

namespace hord::firmware::page {

class Viewers {
  public:
    static constexpr std::size_t kQueue =
        256;  // events; beyond it the queue is dropped and the browser reloads everything

    explicit Viewers(std::size_t most) : most_(most) {}

    class Viewer {
      public:
        ~Viewer() { all_.remove(*this); }
        Viewer(const Viewer&) = delete;
        Viewer& operator=(const Viewer&) = delete;
        // The text to send: one or more whole events. "": none yet, and the viewer sleeps. Empty: the page ends.
        std::optional<std::string> next() { return all_.next(*this); }

      private:
        friend class Viewers;
        Viewer(Viewers& all, std::function<void()> sleep, std::function<void()> wake)
            : all_(all), sleep_(std::move(sleep)), wake_(std::move(wake)) {}
        void wake() {
            if (std::exchange(asleep_, false)) wake_();
        }
        Viewers& all_;
        const std::function<void()> sleep_, wake_;
        bool asleep_ = false;
        std::deque<std::shared_ptr<const std::string>> waiting_;
        bool overrun_ = false;
    };

    // Null: the limit is reached. `sleep`, `wake`: must not call this class.
    std::unique_ptr<Viewer> enter(
        std::function<void()> sleep = [] {}, std::function<void()> wake = [] {}) {
        const std::lock_guard lock(mutex_);
        if (ended_ || inside_.size() >= most_) return nullptr;
        std::unique_ptr<Viewer> viewer(new Viewer(*this, std::move(sleep), std::move(wake)));
        inside_.insert(viewer.get());
        return viewer;
    }

    // `data` is one line.
    void publish(std::string_view event, std::string_view data) {
        const auto text = std::make_shared<const std::string>("event: " + std::string(event) +
                                                              "\ndata: " + std::string(data) + "\n\n");
        const std::lock_guard lock(mutex_);
        for (Viewer* viewer : inside_) {
            if (viewer->waiting_.size() < kQueue) {
                viewer->waiting_.push_back(text);
            } else {
                viewer->waiting_.clear();
                viewer->overrun_ = true;
            }
            viewer->wake();
        }
    }

    // A comment to those who sleep: it keeps the connection open, and shows who has left.
    void keep_alive() {
        static const auto kComment = std::make_shared<const std::string>(": still here\n\n");
        const std::lock_guard lock(mutex_);
        for (Viewer* viewer : inside_) {
            if (viewer->asleep_) viewer->waiting_.push_back(kComment);
            viewer->wake();
        }
    }

    void end() {
        const std::lock_guard lock(mutex_);
        ended_ = true;
        for (Viewer* viewer : inside_) viewer->wake();
    }

    [[nodiscard]] std::size_t count() const {
        const std::lock_guard lock(mutex_);
        return inside_.size();
    }

  private:
    std::optional<std::string> next(Viewer& viewer) {
        const std::lock_guard lock(mutex_);
        if (ended_) return std::nullopt;
        std::string text;
        if (std::exchange(viewer.overrun_, false)) text += "event: overrun\ndata: {}\n\n";
        for (const auto& event : viewer.waiting_) text += *event;
        viewer.waiting_.clear();
        if (text.empty()) {
            viewer.asleep_ = true;
            viewer.sleep_();
        }
        return text;
    }
    void remove(Viewer& viewer) {
        const std::lock_guard lock(mutex_);
        inside_.erase(&viewer);
    }

    const std::size_t most_;
    mutable std::mutex mutex_;
    std::set<Viewer*> inside_;
    bool ended_ = false;
};

}  // namespace hord::firmware::page
