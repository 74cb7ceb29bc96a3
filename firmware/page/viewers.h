// Browsers that receive events (server-sent events): a limited number, each with a queue of limited length. Any thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>

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
        // The text to send: one or more whole events, or a comment without an event within `patience`. Empty: the page
        // ends.
        std::optional<std::string> next(std::chrono::milliseconds patience) { return all_.next(*this, patience); }

      private:
        friend class Viewers;
        explicit Viewer(Viewers& all) : all_(all) {}
        Viewers& all_;
        std::deque<std::shared_ptr<const std::string>> waiting_;
        bool overrun_ = false;
    };

    // Null: the limit is reached.
    std::unique_ptr<Viewer> enter() {
        const std::lock_guard lock(mutex_);
        if (ended_ || inside_.size() >= most_) return nullptr;
        std::unique_ptr<Viewer> viewer(new Viewer(*this));
        inside_.insert(viewer.get());
        return viewer;
    }

    // `data` is one line.
    void publish(std::string_view event, std::string_view data) {
        const auto text = std::make_shared<const std::string>("event: " + std::string(event) +
                                                              "\ndata: " + std::string(data) + "\n\n");
        {
            const std::lock_guard lock(mutex_);
            for (Viewer* viewer : inside_) {
                if (viewer->waiting_.size() < kQueue) {
                    viewer->waiting_.push_back(text);
                } else {
                    viewer->waiting_.clear();
                    viewer->overrun_ = true;
                }
            }
        }
        wake_.notify_all();
    }

    void end() {
        const std::lock_guard lock(mutex_);
        ended_ = true;
        wake_.notify_all();
    }

    [[nodiscard]] std::size_t count() const {
        const std::lock_guard lock(mutex_);
        return inside_.size();
    }

  private:
    std::optional<std::string> next(Viewer& viewer, std::chrono::milliseconds patience) {
        std::unique_lock lock(mutex_);
        wake_.wait_for(lock, patience, [&] { return ended_ || !viewer.waiting_.empty(); });
        if (ended_) return std::nullopt;
        std::string text;
        if (viewer.overrun_) text += "event: overrun\ndata: {}\n\n";
        viewer.overrun_ = false;
        for (const auto& event : viewer.waiting_) text += *event;
        viewer.waiting_.clear();
        return text.empty() ? std::string(": still here\n\n") : text;
    }
    void remove(Viewer& viewer) {
        const std::lock_guard lock(mutex_);
        inside_.erase(&viewer);
    }

    const std::size_t most_;
    mutable std::mutex mutex_;
    std::condition_variable wake_;
    std::set<Viewer*> inside_;
    bool ended_ = false;
};

}  // namespace hord::firmware::page
