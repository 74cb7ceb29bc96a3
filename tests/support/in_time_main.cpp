// The main of tests that run the station in real time. The line must stop when its controller gets no CPU time, so a
// failure on a machine that was held up is no evidence: the tests are repeated, up to kAttempts times in all. A failure
// without a hold-up counts at once.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr int kAttempts = 4;
// A delay that counts as a hold-up. The shortest deadline of a thread in the tested lines is 40 ms (hordctl run without
// a configuration); half of it is left for the scheduler.
constexpr Clock::duration kHeldUp = 20ms;

// Measures the longest delay with which a sleeping thread wakes up.
class HoldUps {
  public:
    HoldUps() : thread_([this] { watch(); }) {}
    Clock::duration longest() {
        over_ = true;
        thread_.join();
        return longest_;
    }

  private:
    void watch() {
        while (!over_) {
            const auto due = Clock::now() + 5ms;
            std::this_thread::sleep_until(due);
            longest_ = std::max(longest_, Clock::now() - due);
        }
    }
    std::atomic<bool> over_{false};
    Clock::duration longest_{};
    std::thread thread_;
};

// Runs the tests in a child process, so that attempts share no state. Returns the exit status.
int attempt() {
    const pid_t pid = fork();
    if (pid == 0) {
        const int status = RUN_ALL_TESTS();
        std::fflush(nullptr);
        _exit(status);
    }
    int status = 0;
    if (pid < 0 || waitpid(pid, &status, 0) != pid) return EXIT_FAILURE;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace

int main(int argc, char** argv) {
    testing::InitGoogleMock(&argc, argv);
    if (GTEST_FLAG_GET(list_tests)) return RUN_ALL_TESTS();
    int status = EXIT_FAILURE;
    for (int k = 1; k <= kAttempts; ++k) {
        HoldUps hold_ups;
        status = attempt();
        const auto longest = std::chrono::duration_cast<std::chrono::milliseconds>(hold_ups.longest());
        if (status == 0 || longest < kHeldUp) return status;
        std::printf("attempt %d of %d failed, but the machine was held up for %lld ms meanwhile\n", k, kAttempts,
                    static_cast<long long>(longest.count()));
        std::fflush(stdout);
    }
    return status;
}
