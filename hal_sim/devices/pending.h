// The pending actions of a simulated device, each with its due time. Slots are reused: nothing is allocated once the
// number of pending actions has reached its maximum.
#pragma once

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include "drivers/hal/event_loop.h"

namespace hord::sim {

template <class Thing>
class Pending {
  public:
    // `act` is called on the loop's thread when a thing is due; it may add others.
    Pending(hal::EventLoop& loop, std::function<void(const Thing&)> act) : loop_(loop), act_(std::move(act)) {}

    void add(hal::TimePoint due, const Thing& thing) {
        auto free = std::find_if(slots_.begin(), slots_.end(), [](const Slot& slot) { return !slot.used; });
        if (free == slots_.end()) free = slots_.insert(slots_.end(), Slot{});
        *free = {thing, {}, true};
        free->timer = loop_.call_at(due, [this, number = static_cast<std::size_t>(free - slots_.begin())] {
            slots_[number].used = false;
            const Thing what = slots_[number].thing;  // a copy: act_ may add
            act_(what);
        });
    }

    // Cancels all pending things and calls `instead` with each. `instead` may stop the device, which drops the rest.
    template <class Instead>
    void drop(const Instead& instead) {
        for (std::size_t k = 0; k < slots_.size(); ++k) {
            if (!std::exchange(slots_[k].used, false)) continue;
            loop_.cancel(slots_[k].timer);
            Thing what = slots_[k].thing;
            instead(what);
        }
    }

  private:
    struct Slot {
        Thing thing;
        hal::EventLoop::TimerId timer{};
        bool used = false;
    };
    hal::EventLoop& loop_;
    std::function<void(const Thing&)> act_;
    std::vector<Slot> slots_;
};

}  // namespace hord::sim
