#include <memory>

#include "drivers/event_loop/event_loop_sd.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

class RealLoop final : public LoopRunner {
  public:
    explicit RealLoop(std::unique_ptr<firmware::SdEventLoop> loop) : loop_(std::move(loop)) {}
    hal::EventLoop& loop() override { return *loop_; }

    bool run_until(const std::function<bool()>& done, hal::Duration at_most) override {
        const hal::TimePoint give_up = loop_->now() + at_most;
        hal::EventLoop::TimerId timer{};
        bool held = false;
        const std::function<void()> look = [&] {
            held = done();
            if (held || loop_->now() >= give_up) return loop_->request_stop();
            timer = loop_->call_after(std::chrono::milliseconds(1), [&] { look(); });
        };
        loop_->post([&] { look(); });
        EXPECT_TRUE(loop_->run());
        loop_->cancel(timer);
        return held;
    }
    void run_for(hal::Duration duration) override {
        loop_->call_after(duration, [this] { loop_->request_stop(); });
        EXPECT_TRUE(loop_->run());
    }

  private:
    std::unique_ptr<firmware::SdEventLoop> loop_;
};

INSTANTIATE_TEST_SUITE_P(SdEventLoop, EventLoopContract,
                         testing::Values(Backend<Harness>{"real_time",
                                                          [] { return std::make_unique<Harness>(real_loop()); }, ""}),
                         name_of<Harness>);

}  // namespace

std::unique_ptr<LoopRunner> real_loop() {
    auto loop = firmware::SdEventLoop::open();
    if (!loop) throw std::runtime_error(loop.error().message());
    return std::make_unique<RealLoop>(std::move(*loop));
}

}  // namespace hord::contract
