#include "lab/virtual_time/virtual_time.h"

#include <algorithm>
#include <utility>

namespace hord::lab {

using hal::TimePoint;

hal::EventLoop::TimerId VirtualTime::call_at(TimePoint due, Callback callback) {
    if (free_.empty()) {
        free_.push_back(static_cast<std::uint32_t>(slots_.size()));
        slots_.emplace_back();
    }
    const std::uint32_t slot = free_.back();
    free_.pop_back();
    slots_[slot].callback = std::move(callback);
    slots_[slot].used = true;
    heap_.push_back({due, order_++, slot, slots_[slot].generation});
    std::push_heap(heap_.begin(), heap_.end(), Later());
    ++pending_;
    return static_cast<TimerId>((static_cast<std::uint64_t>(slots_[slot].generation) << 32U) | slot);
}

void VirtualTime::release(std::uint32_t slot) {
    Slot& s = slots_[slot];
    s.callback = nullptr;
    s.used = false;
    ++s.generation;
    free_.push_back(slot);
    --pending_;
}

void VirtualTime::cancel(TimerId timer) {
    const auto id = static_cast<std::uint64_t>(timer);
    const auto slot = static_cast<std::uint32_t>(id);
    const auto generation = static_cast<std::uint32_t>(id >> 32U);
    if (slot < slots_.size() && slots_[slot].used && slots_[slot].generation == generation) release(slot);
}

Result<hal::EventLoop::WatchId> VirtualTime::watch(int, Readiness, Callback) {
    return fail(ErrorCode::unsupported, "virtual time cannot wait for a file descriptor",
                "run devices with descriptors on the real-time loop, or use the simulated devices");
}

void VirtualTime::post(Callback callback) {
    const std::scoped_lock lock(post_mutex_);
    posted_.push_back(std::move(callback));
    has_posted_.store(true, std::memory_order_release);
}

void VirtualTime::take_posted() {
    if (!has_posted_.load(std::memory_order_acquire)) return;
    {
        const std::scoped_lock lock(post_mutex_);
        taken_.swap(posted_);
        has_posted_.store(false, std::memory_order_relaxed);
    }
    for (Callback& callback : taken_) call_at(now_, std::move(callback));
    taken_.clear();
}

std::optional<TimePoint> VirtualTime::next_due() {
    take_posted();
    while (!heap_.empty()) {
        const Due& next = heap_.front();
        if (slots_[next.slot].used && slots_[next.slot].generation == next.generation) return next.at;
        std::pop_heap(heap_.begin(), heap_.end(), Later());
        heap_.pop_back();
    }
    return std::nullopt;
}

bool VirtualTime::run_one() {
    if (!next_due()) return false;
    run_next();
    return true;
}

void VirtualTime::run_next() {
    std::pop_heap(heap_.begin(), heap_.end(), Later());
    const Due due = heap_.back();
    heap_.pop_back();
    const Callback callback = std::move(slots_[due.slot].callback);
    release(due.slot);
    now_ = std::max(now_, due.at);
    ++run_;
    callback();
}

void VirtualTime::run_until(TimePoint end) {
    for (auto due = next_due(); due && *due <= std::max(end, now_); due = next_due()) run_next();
    now_ = std::max(now_, end);
}

bool VirtualTime::run_until(const std::function<bool()>& done, TimePoint limit) {
    while (!done()) {
        const auto due = next_due();
        if (!due || *due > limit) return false;
        run_next();
    }
    return true;
}

bool VirtualTime::run_until_idle(TimePoint limit) {
    for (auto due = next_due(); due; due = next_due()) {
        if (*due > limit) return false;
        run_next();
    }
    return true;
}

}  // namespace hord::lab
