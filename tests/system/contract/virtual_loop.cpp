#include <algorithm>
#include <thread>

#include "lab/virtual_time/virtual_time.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

class VirtualLoop final : public LoopRunner {
  public:
    hal::EventLoop& loop() override { return time_; }
    bool run_until(const std::function<bool()>& done, hal::Duration at_most) override {
        using namespace std::chrono_literals;
        const hal::TimePoint limit = time_.now() + at_most;
        while (time_.now() < limit) {
            const hal::TimePoint step = std::min(time_.now() + 1ms, limit);  // a condition may depend on time alone
            if (time_.run_until(done, step)) return true;
            time_.run_until(step);
        }
        // Callbacks that another thread posts arrive in real time.
        for (const auto give_up = std::chrono::steady_clock::now() + kPatience;
             std::chrono::steady_clock::now() < give_up;) {
            if (time_.run_until(done, limit)) return true;
            std::this_thread::yield();
        }
        return done();
    }
    void run_for(hal::Duration duration) override { time_.run_for(duration); }

  private:
    lab::VirtualTime time_;
};

INSTANTIATE_TEST_SUITE_P(VirtualTime, EventLoopContract,
                         testing::Values(Backend<Harness>{
                             "default", [] { return std::make_unique<Harness>(virtual_loop()); }, ""}),
                         name_of<Harness>);

}  // namespace

std::unique_ptr<LoopRunner> virtual_loop() { return std::make_unique<VirtualLoop>(); }

}  // namespace hord::contract
