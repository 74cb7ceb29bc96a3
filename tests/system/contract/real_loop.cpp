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
        return loop_->run_until(done, at_most);
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
