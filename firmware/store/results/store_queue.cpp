#include "firmware/store/results/store_queue.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "firmware/store/results/json_text.h"
#include "firmware/store/results/no_exceptions.h"

namespace hord::firmware::store {
namespace {

// Extra capacity for changes and commands: they are few, and explain the results.
constexpr std::size_t kRoomForChanges = 1024;

// Of a record that report_losses() wrote.
std::int64_t member_of_loss(const ChangeRecord& lost, const char* name) {
    return integer_in(parse_stored(lost.after), name).value_or(0);
}

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
        if (result != nullptr) report_losses();  // before the next result: one report for each run of lost results
        waiting_.push_back({++counted_, std::move(record)});
        wake = waiting_.size() == 1 || waiting_.size() == options_.batch;
    }
    if (wake) wake_.notify_one();
}

AckStatus StoreQueue::acknowledge(std::string peer, UtcMicros time_us, std::uint32_t sequence) {
    {
        const std::lock_guard lock(mutex_);
        if (sequence > durable_ || moved_) {
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
            wake_.wait_for(lock, stop, options_.check_every, [this] { return urgent_ || !waiting_.empty(); });
            wake_.wait_for(lock, stop, options_.commit_every,
                           [this] { return urgent_ || waiting_.size() >= options_.batch; });
        }
        if (stop.stop_requested()) return drain(lock);
        urgent_ = false;
        bool good = write_one_batch(lock);
        while (good && waiting_.size() >= options_.batch) good = write_one_batch(lock);
        if (good) prune(lock);
    }
}

void StoreQueue::drain(std::unique_lock<std::mutex>& lock) {
    const hal::TimePoint until = steady_now() + options_.stop_within;
    while (true) {
        const bool good = write_one_batch(lock);
        if (waiting_.empty() && lost_ == lost_reported_) return;
        if (good) continue;
        const hal::Duration left = until - steady_now();
        if (left <= hal::Duration::zero()) return;
        wake_.wait_for(lock, std::min(left, options_.retry_at_stop), [] { return false; });
    }
}

Unstored StoreQueue::finish() {
    if (thread_.joinable()) {
        thread_.request_stop();
        thread_.join();
    }
    const std::lock_guard lock(mutex_);
    Unstored left;
    left.why = last_error_;
    const auto add = [&left](std::size_t results, std::uint32_t from, std::uint32_t to) {
        if (results == 0) return;
        if (left.results == 0) left.from_sequence = from;  // they come in their order
        left.to_sequence = to;
        left.results += results;
    };
    for (const Entry& entry : waiting_) {
        const auto* change = std::get_if<ChangeRecord>(&entry.record);
        if (const auto* result = std::get_if<ResultRecord>(&entry.record)) {
            add(1, result->result.sequence, result->result.sequence);
        } else if (change != nullptr && change->what == ChangeRecord::What::lost) {
            add(static_cast<std::size_t>(member_of_loss(*change, "records")),
                static_cast<std::uint32_t>(member_of_loss(*change, "from_sequence")),
                static_cast<std::uint32_t>(member_of_loss(*change, "to_sequence")));
        } else {
            ++left.others;
        }
    }
    add(lost_ - lost_reported_, lost_from_, lost_to_);
    return left;
}

Error Unstored::error() const {
    std::string what;
    if (results > 0) what = fmt::format("{} results (sequences {} to {})", results, from_sequence, to_sequence);
    if (others > 0) what += fmt::format("{}{} other records", results > 0 ? " and " : "", others);
    return {ErrorCode::io, what + " could not be stored before the end and are lost", why};
}

bool StoreQueue::step() {
    std::unique_lock lock(mutex_);
    if (!write_one_batch(lock)) return false;
    prune(lock);
    return !failing_;
}

bool StoreQueue::write_one_batch(std::unique_lock<std::mutex>& lock) {
    if (!failing_) report_losses();
    std::vector<Entry> batch;
    while (!waiting_.empty() && batch.size() < options_.batch) {
        batch.push_back(std::move(waiting_.front()));
        waiting_.pop_front();
    }
    in_flight_ = batch.size();
    lock.unlock();

    const Result<void> done = without_exceptions([&] { return open_and_write(batch); });
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
        if (change != nullptr && change->what == ChangeRecord::What::lost)
            durable_ = static_cast<std::uint32_t>(member_of_loss(*change, "to_sequence"));
    }
    moved_ = false;
    if (std::exchange(failing_, false)) {
        last_error_.clear();
        lock.unlock();
        if (listener_.works_again) listener_.works_again();
        lock.lock();
    }
    return true;
}

Result<void> StoreQueue::open_and_write(const std::vector<Entry>& batch) {
    if (store_ == nullptr) {
        auto opened = open_();
        if (!opened) return tl::unexpected(opened.error());
        store_ = std::move(*opened);
        std::vector<Entry> context{{0, start_}};
        for (const ChangeRecord& change : in_use_) context.push_back({0, change});
        if (auto done = store_->write(context); !done) return done;
    }
    return store_->write(batch);
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
    if (options_.retention.keep_days == 0 && options_.retention.max_bytes == 0) return;
    lock.unlock();
    const auto more = without_exceptions([&] {
        const std::int64_t steady_ns = steady_now().time_since_epoch().count();
        return store_->prune(options_.retention, {utc_now_(), steady_ns / 1000});
    });
    lock.lock();
    if (!more) return fail_with(lock, more.error());
    if (*more) next_prune_ = {};  // the next batch first
}

void StoreQueue::fail_with(std::unique_lock<std::mutex>& lock, const Error& error) {
    store_.reset();
    failing_ = true;
    moved_ = moved_ || error.code == ErrorCode::not_found;
    if (error.message() == std::exchange(last_error_, error.message())) return;
    lock.unlock();
    if (listener_.failed) listener_.failed(error);
    lock.lock();
}

// With the lock. What was lost since the last report becomes a record of the queue.
void StoreQueue::report_losses() {
    if (lost_ == lost_reported_) return;
    ChangeRecord lost;
    lost.what = ChangeRecord::What::lost;
    lost.time_us = utc_now_();
    lost.name = "results";
    lost.after =
        to_text({{"records", lost_ - lost_reported_}, {"from_sequence", lost_from_}, {"to_sequence", lost_to_}});
    waiting_.push_back({++counted_, std::move(lost)});
    lost_reported_ = lost_;
    lost_from_ = lost_to_ = 0;
}

}  // namespace hord::firmware::store
