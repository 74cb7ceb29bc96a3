#include "lab/stand_in/stand_in_inspector.h"

#include <algorithm>
#include <vector>

namespace hord::lab {
namespace {

using firmware::Inspector;
using firmware::Judged;

// Judges inside submit() and answers later by a timer: in virtual time, computing takes no time.
class StandInInspector final : public Inspector {
  public:
    StandInInspector(hal::EventLoop& loop, int under_way, StandIn judge)
        : loop_(loop), slots_(static_cast<std::size_t>(under_way)), judge_(std::move(judge)) {}
    ~StandInInspector() override { stop(); }

    void start(Listener& listener) override { listener_ = &listener; }

    Result<void> submit(std::uint32_t part, hal::FrameLease frame) override {
        if (listener_ == nullptr)
            return fail(ErrorCode::disconnected, "the inspector is not started", "start it first");
        const auto free = std::find_if(slots_.begin(), slots_.end(), [](const Slot& s) { return !s.used; });
        if (free == slots_.end()) {
            return fail(ErrorCode::busy, "the inspector's queue is full",
                        "lower the line's rate or raise inspection.threads");
        }
        const StandInAnswer answer = judge_(part, frame);
        const auto index = static_cast<std::uint32_t>(free - slots_.begin());
        free->used = true;
        free->judged = answer.judged;
        free->judged.part = part;
        free->frame = std::move(frame);
        free->timer = loop_.call_after(answer.after, [this, index] { deliver(index); });
        return {};
    }

    void stop() override {
        for (Slot& slot : slots_) {
            if (slot.used) loop_.cancel(slot.timer);
            slot.used = false;
            slot.frame = {};
        }
        listener_ = nullptr;
    }

  private:
    struct Slot {
        bool used = false;
        Judged judged;
        hal::FrameLease frame;  // held until the answer, as in the service
        hal::EventLoop::TimerId timer{};
    };

    void deliver(std::uint32_t index) {
        Slot& slot = slots_[index];
        slot.used = false;
        slot.frame = {};
        const Judged judged = slot.judged;
        listener_->on_judged(judged);
    }

    hal::EventLoop& loop_;
    std::vector<Slot> slots_;
    StandIn judge_;
    Listener* listener_ = nullptr;
};

}  // namespace

std::unique_ptr<Inspector> make_stand_in_inspector(hal::EventLoop& loop, int queue, StandIn judge) {
    return std::make_unique<StandInInspector>(loop, queue, std::move(judge));
}

}  // namespace hord::lab
