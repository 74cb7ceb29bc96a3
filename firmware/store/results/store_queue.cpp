#include "firmware/store/results/store_queue.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "firmware/store/results/json_text.h"

namespace hord::firmware::store {
namespace {

// Extra capacity for changes and commands: they are few, and explain the results.
constexpr std::size_t kRoomForChanges = 1024;

hal::TimePoint steady_now() { return hal::TimePoint(std::chrono::steady_clock::now().time_since_epoch()); }

}  // namespace

StoreQueue::StoreQueue(Open open, StoreQueueOptions options, StartRecord start, std::function<UtcMicros()> utc_now,
                       Listener listener)
    : open_(std::move(open)), options_(options), start_(std::move(start)), utc_now_(std::move(utc_now)),
      listener_(std::move(listener)) {
    if (options_.thread) thread_ = std::jthread([this](const std::stop_token& stop) { work(stop); });
}

void StoreQueue::add(Record record) {
    bool wake = false;
    {
        const std::lock_guard lock(mutex_);
        const auto* result = std::get_if<ResultRecord>(&record);
        const std::size_t room = result != nullptr ? options_.capacity : options_.capacity + kRoomForChanges;
        if (waiting_.size() + in_flight_ >= room) {
            ++lost_;
            if (result != nullptr) {
                if (lost_from_ == 0) lost_from_ = result->result.sequence;
                lost_to_ = result->result.sequence;
            }
            return;
        }
        waiting_.push_back({++counted_, std::move(record)});
        wake = waiting_.size() == 1 || waiting_.size() == options_.batch;
    }
    if (wake) wake_.notify_one();
}

AckStatus StoreQueue::acknowledge(std::string peer, UtcMicros time_us, std::uint32_t sequence) {
    {
        const std::lock_guard lock(mutex_);
        if (sequence > durable_) {
            if (failing_) return AckStatus::failed;
            urgent_ = true;
            wake_.notify_one();
            return AckStatus::not_yet;
        }
    }
    add(AcknowledgeRecord{time_us, std::move(peer), sequence});
    return AckStatus::recorded;
}

StoreQueueState StoreQueue::state() const {
    const std::lock_guard lock(mutex_);
    return {failing_, durable_, waiting_.size() + in_flight_, lost_};
}

// -- the queue's thread

void StoreQueue::work(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    write_one_batch(lock);  // opens the store, so that its errors are reported before the first part
    while (true) {
        if (failing_) {
            wake_.wait_for(lock, stop, options_.retry_every, [] { return false; });
        } else {
            // Wait for a record, then for commit_every, unless an acknowledgement or a full batch waits.
            wake_.wait_for(lock, stop, options_.prune_every, [this] { return urgent_ || !waiting_.empty(); });
            wake_.wait_for(lock, stop, options_.commit_every,
                           [this] { return urgent_ || waiting_.size() >= options_.batch; });
        }
        const bool ending = stop.stop_requested();
        urgent_ = false;
        bool good = write_one_batch(lock);
        while (good && (ending || waiting_.size() >= options_.batch) && !waiting_.empty()) good = write_one_batch(lock);
        if (good) prune(lock);
        if (ending) break;
    }
    if (waiting_.empty()) return;
    const Error error{ErrorCode::io,
                      fmt::format("{} records could not be written to the store before the end", waiting_.size()),
                      "see the errors before"};
    lock.unlock();
    if (listener_.failed) listener_.failed(error);
}

bool StoreQueue::step() {
    std::unique_lock lock(mutex_);
    if (!write_one_batch(lock)) return false;
    prune(lock);
    return !failing_;
}

bool StoreQueue::write_one_batch(std::unique_lock<std::mutex>& lock) {
    report_losses();
    std::vector<Entry> batch;
    while (!waiting_.empty() && batch.size() < options_.batch) {
        batch.push_back(std::move(waiting_.front()));
        waiting_.pop_front();
    }
    in_flight_ = batch.size();
    lock.unlock();

    Result<void> done{};
    if (store_ == nullptr) {
        auto opened = open_();
        if (opened) {
            store_ = std::move(*opened);
            std::vector<Entry> context{{0, start_}};
            for (const ChangeRecord& change : in_use_) context.push_back({0, change});
            done = store_->write(context);
        } else {
            done = tl::unexpected(opened.error());
        }
    }
    if (done && !batch.empty()) done = store_->write(batch);
    if (done) note_written(batch);

    lock.lock();
    in_flight_ = 0;
    if (!done) {
        waiting_.insert(waiting_.begin(), std::make_move_iterator(batch.begin()), std::make_move_iterator(batch.end()));
        fail_with(lock, done.error());
        return false;
    }
    for (const Entry& entry : batch) {
        if (const auto* result = std::get_if<ResultRecord>(&entry.record)) durable_ = result->result.sequence;
        const auto* change = std::get_if<ChangeRecord>(&entry.record);
        if (change != nullptr && change->what == ChangeRecord::What::lost) durable_ = std::max(durable_, reported_to_);
    }
    if (std::exchange(failing_, false)) {
        last_error_.clear();
        lock.unlock();
        if (listener_.works_again) listener_.works_again();
        lock.lock();
    }
    return true;
}

void StoreQueue::note_written(const std::vector<Entry>& batch) {
    for (const Entry& entry : batch) {
        const auto* change = std::get_if<ChangeRecord>(&entry.record);
        if (change == nullptr || change->what >= ChangeRecord::What::lost) continue;
        std::erase_if(in_use_, [&](const ChangeRecord& known) { return known.what == change->what; });
        in_use_.push_back(*change);
        in_use_.back().if_new = true;
    }
}

void StoreQueue::prune(std::unique_lock<std::mutex>& lock) {
    if (options_.thread && steady_now() < next_prune_) return;
    next_prune_ = steady_now() + options_.prune_every;
    if (options_.retention.keep_us == 0 && options_.retention.max_bytes == 0) return;
    lock.unlock();
    const auto more = store_->prune(options_.retention, utc_now_());
    lock.lock();
    if (!more) return fail_with(lock, more.error());
    if (*more) next_prune_ = {};  // the next batch first
}

void StoreQueue::fail_with(std::unique_lock<std::mutex>& lock, const Error& error) {
    store_.reset();
    failing_ = true;
    if (error.message() == std::exchange(last_error_, error.message())) return;
    lock.unlock();
    if (listener_.failed) listener_.failed(error);
    lock.lock();
}

// With the lock. Records the lost results in the store once it works again.
void StoreQueue::report_losses() {
    if (lost_ == lost_reported_ || failing_) return;
    ChangeRecord lost;
    lost.what = ChangeRecord::What::lost;
    lost.time_us = utc_now_();
    lost.name = "results";
    lost.after =
        to_text({{"records", lost_ - lost_reported_}, {"from_sequence", lost_from_}, {"to_sequence", lost_to_}});
    waiting_.push_back({++counted_, std::move(lost)});
    lost_reported_ = lost_;
    reported_to_ = std::max(reported_to_, lost_to_);
    lost_from_ = lost_to_ = 0;
}

}  // namespace hord::firmware::store
