// The service's inspector: worker threads, a bounded queue, answers posted to the loop.
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include <sched.h>

#include "firmware/station/inspector.h"

namespace hord::firmware {
namespace {

struct Job {
    std::uint32_t part = 0;
    hal::FrameLease frame;
};

// Shared with posted functions, which may run after the inspector is destroyed.
struct Mailbox {
    std::mutex mutex;
    std::vector<Judged> answers;
    Inspector::Listener* listener = nullptr;  // loop thread only

    void deliver() {
        std::vector<Judged> now;
        {
            const std::lock_guard lock(mutex);
            now.swap(answers);
        }
        for (const Judged& judged : now) {
            if (listener != nullptr) listener->on_judged(judged);
        }
    }
};

class ThreadedInspector final : public Inspector {
  public:
    ThreadedInspector(hal::EventLoop& loop, int queue, std::vector<InspectFunction> functions,
                      MakeInspectFunctions remake)
        : loop_(loop), queue_(static_cast<std::size_t>(queue)), functions_(std::move(functions)),
          remake_(std::move(remake)), mailbox_(std::make_shared<Mailbox>()) {}
    ~ThreadedInspector() override { stop(); }

    void start(Listener& listener) override {
        mailbox_->listener = &listener;
        if (!threads_.empty()) return;
        ending_ = false;
        for (InspectFunction& inspect : functions_) threads_.emplace_back([this, &inspect] { work(inspect); });
    }

    Result<void> use(const algo::Recipe& recipe, std::uint16_t number) override {
        if (!remake_) return fail(ErrorCode::unsupported, "this inspector knows no recipes", "use the pipeline");
        auto functions = remake_(recipe, number);
        if (!functions) return tl::unexpected(functions.error());
        Listener* listener = mailbox_->listener;
        stop();
        functions_ = std::move(*functions);
        if (listener != nullptr) start(*listener);
        return {};
    }

    void liveness_check(std::function<void()> all_here) override {
        if (threads_.empty()) return all_here();
        {
            const std::lock_guard lock(mutex_);
            ++call_;
            missing_ = threads_.size();
            all_here_ = std::move(all_here);
        }
        wake_.notify_all();
    }

    std::size_t waiting() const override {
        const std::lock_guard lock(mutex_);
        return jobs_.size();
    }

    Result<void> submit(std::uint32_t part, hal::FrameLease frame) override {
        if (threads_.empty()) return fail(ErrorCode::disconnected, "the inspector is not started", "start it first");
        {
            const std::lock_guard lock(mutex_);
            if (jobs_.size() >= queue_) {
                return fail(ErrorCode::busy, "the inspector's queue of " + std::to_string(queue_) + " frames is full",
                            "lower the line's rate or raise inspection.threads");
            }
            jobs_.push_back({part, std::move(frame)});
        }
        wake_.notify_one();
        return {};
    }

    void stop() override {
        {
            const std::lock_guard lock(mutex_);
            ending_ = true;
            jobs_.clear();
            call_ = 0;
            all_here_ = nullptr;
        }
        wake_.notify_all();
        for (std::thread& thread : threads_) thread.join();
        threads_.clear();
        mailbox_->listener = nullptr;
        const std::lock_guard lock(mailbox_->mutex);
        mailbox_->answers.clear();
    }

  private:
    void work(InspectFunction& inspect) {
        // Inspection must not delay the loop's thread, which may run under SCHED_FIFO.
        const sched_param ordinary{};
        ::sched_setscheduler(0, SCHED_OTHER, &ordinary);
        std::uint64_t answered = 0;
        while (true) {
            std::optional<Job> job;
            std::function<void()> last_one_calls;
            {
                std::unique_lock lock(mutex_);
                wake_.wait(lock, [&] { return ending_ || !jobs_.empty() || answered != call_; });
                if (ending_) return;
                if (answered != call_) {
                    answered = call_;
                    if (--missing_ == 0) last_one_calls = std::move(all_here_);
                }
                if (!jobs_.empty()) {
                    job = std::move(jobs_.front());
                    jobs_.pop_front();
                }
            }
            if (last_one_calls) loop_.post(std::move(last_one_calls));
            if (!job) continue;
            Judged judged = inspect(job->part, job->frame);
            judged.part = job->part;
            job->frame = {};
            bool first = false;
            {
                const std::lock_guard lock(mailbox_->mutex);
                first = mailbox_->answers.empty();
                mailbox_->answers.push_back(judged);
            }
            if (first) loop_.post([mailbox = mailbox_] { mailbox->deliver(); });
        }
    }

    hal::EventLoop& loop_;
    const std::size_t queue_;
    std::vector<InspectFunction> functions_;
    MakeInspectFunctions remake_;
    std::vector<std::thread> threads_;
    mutable std::mutex mutex_;
    std::condition_variable wake_;
    std::deque<Job> jobs_;
    std::uint64_t call_ = 0;   // of liveness_check()
    std::size_t missing_ = 0;  // threads that have not answered it
    std::function<void()> all_here_;
    bool ending_ = false;
    std::shared_ptr<Mailbox> mailbox_;
};

}  // namespace

std::unique_ptr<Inspector> make_threaded_inspector(hal::EventLoop& loop, int queue,
                                                   std::vector<InspectFunction> functions,
                                                   MakeInspectFunctions remake) {
    return std::make_unique<ThreadedInspector>(loop, queue, std::move(functions), std::move(remake));
}

}  // namespace hord::firmware
