// GPIO lines without a chip, controlled by a test. Outputs record their changes with times; inputs deliver the test's
// edges through a descriptor, as the kernel does.
#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <vector>

#include <sys/eventfd.h>
#include <unistd.h>

#include "drivers/gpio/gpio_lines.h"

namespace hord::drivers::scripted {

inline Error gone() { return {ErrorCode::disconnected, "the scripted chip is gone", "bring it back"}; }

// Any thread.
struct Lamps {
    struct Move {
        std::uint32_t active = 0;
        hal::TimePoint at;
    };
    const hal::Clock& clock;
    std::mutex mutex;
    std::vector<Move> moves;
    bool there = true;
    int taken = 0;  // open requests

    explicit Lamps(const hal::Clock& c) : clock(c) {}
    void move(std::uint32_t active) { moves.push_back({active, clock.now()}); }
    std::vector<Move> history() {
        const std::scoped_lock lock(mutex);
        return moves;
    }
    std::uint32_t now_active() {
        const std::scoped_lock lock(mutex);
        return moves.empty() ? 0 : moves.back().active;
    }
    bool ever_lit() {
        const std::scoped_lock lock(mutex);
        for (const Move& m : moves) {
            if (m.active != 0) return true;
        }
        return false;
    }
    void be_there(bool is) {
        const std::scoped_lock lock(mutex);
        there = is;
        if (!is) move(0);  // no chip, no light
    }
};

class Outputs final : public GpioOutputs {
  public:
    static Result<std::unique_ptr<GpioOutputs>> request(const std::shared_ptr<Lamps>& lamps) {
        const std::scoped_lock lock(lamps->mutex);
        if (!lamps->there) return tl::unexpected(gone());
        ++lamps->taken;
        lamps->move(0);
        return std::unique_ptr<GpioOutputs>(new Outputs(lamps));
    }
    ~Outputs() override {
        const std::scoped_lock lock(lamps_->mutex);
        --lamps_->taken;
        lamps_->move(0);  // as a chip with a pull resistor does
    }
    Result<void> set(std::uint32_t active) override {
        const std::scoped_lock lock(lamps_->mutex);
        if (!lamps_->there) return tl::unexpected(gone());
        lamps_->move(active);
        return {};
    }

  private:
    explicit Outputs(std::shared_ptr<Lamps> lamps) : lamps_(std::move(lamps)) {}
    std::shared_ptr<Lamps> lamps_;
};

// Loop thread.
struct Wire {
    bool level = false;
    bool there = true;
    class Input* input = nullptr;                        // the open request
    void change(bool active, hal::TimePoint at);         // with an edge
    void change_unseen(bool active) { level = active; }  // without one
    void tell(const GpioEdge& edge);
};

class Input final : public GpioInput {
  public:
    static Result<std::unique_ptr<GpioInput>> request(const std::shared_ptr<Wire>& wire) {
        if (!wire->there) return tl::unexpected(gone());
        if (wire->input != nullptr)
            return tl::unexpected(Error{ErrorCode::busy, "the scripted line is taken", "let go of it"});
        return std::unique_ptr<GpioInput>(new Input(wire));
    }
    ~Input() override {
        wire_->input = nullptr;
        close(fd_);
    }
    [[nodiscard]] int fd() const override { return fd_; }
    Result<void> read(std::vector<GpioEdge>& into) override {
        if (!wire_->there) return tl::unexpected(gone());
        std::uint64_t count = 0;
        (void)!::read(fd_, &count, sizeof count);
        into.insert(into.end(), waiting_.begin(), waiting_.end());
        waiting_.clear();
        return {};
    }
    [[nodiscard]] Result<bool> active() override {
        if (!wire_->there) return tl::unexpected(gone());
        return wire_->level;
    }
    void add(const GpioEdge& edge) {
        waiting_.push_back(edge);
        const std::uint64_t one = 1;
        (void)!write(fd_, &one, sizeof one);
    }

  private:
    explicit Input(std::shared_ptr<Wire> wire) : wire_(std::move(wire)), fd_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
        wire_->input = this;
    }
    std::shared_ptr<Wire> wire_;
    int fd_;
    std::deque<GpioEdge> waiting_;
};

inline void Wire::tell(const GpioEdge& edge) {
    if (input != nullptr) input->add(edge);
}
inline void Wire::change(bool active, hal::TimePoint at) {
    level = active;
    tell({active, at, 0});
}

}  // namespace hord::drivers::scripted
