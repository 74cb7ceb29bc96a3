// The rejector driver on a serial line (a pseudo-terminal) with noise on it.
#include <atomic>
#include <cstdlib>
#include <thread>

#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "drivers/modbus/coil_link.h"
#include "tests/drivers/modbus/rejector_bench.h"

namespace hord::drivers {
namespace {

class SerialRejector : public RejectorBench {
  protected:
    SerialRejector() : RejectorBench({.serial = true, .unit = 7}) {}

    // One disturbance, at a command's write: the ejector acts at most once, and every later command succeeds.
    void expect_one_command_at_most(ModuleFault fault, hal::Duration delay = {}) {
        start_and_wait();
        module_->misbehave(fault, 1, delay);
        reject(1, 5 * kTimeout);
        EXPECT_EQ(module_->misbehaved(), 1);
        EXPECT_LE(times_on(kEjector), 1);
        EXPECT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
        for (std::uint32_t part = 2; part <= 4; ++part) EXPECT_EQ(reject(part), Outcome::confirmed) << part;
        EXPECT_EQ(ear_.changes, 1) << "the link went: " << ear_.why_down.message();
    }
};

TEST_F(SerialRejector, acts_reads_back_gives_the_permit_and_is_left_safe) {
    start_and_wait();
    rejector_->set_run_permit(true);
    EXPECT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    for (std::uint32_t part = 1; part <= 2; ++part) {
        EXPECT_EQ(reject(part), Outcome::confirmed);
        EXPECT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    }
    EXPECT_EQ(times_on(kEjector), 2);
    EXPECT_EQ(ear_.changes, 1);
    rejector_->stop();
    EXPECT_FALSE(module_->coil(kPermit));
}

TEST_F(SerialRejector, a_request_that_is_lost_while_it_stops_is_made_again_and_the_permit_falls) {
    start_and_wait();
    rejector_->set_run_permit(true);
    ASSERT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    module_->misbehave(ModuleFault::silent, 1);
    rejector_->stop();
    EXPECT_FALSE(module_->coil(kPermit));
}

TEST_F(SerialRejector, a_damaged_answer_is_settled_by_reading_back) {
    expect_one_command_at_most(ModuleFault::damaged);
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::confirmed);
}

TEST_F(SerialRejector, noise_before_an_answer_is_settled_by_reading_back) {
    expect_one_command_at_most(ModuleFault::noise);
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::confirmed);
}

TEST_F(SerialRejector, a_late_answer_is_thrown_away_and_never_taken_for_another_one) {
    expect_one_command_at_most(ModuleFault::late, kTimeout * 3 / 2);
}

TEST_F(SerialRejector, a_request_that_noise_swallowed_is_not_asked_again_and_fails) {
    start_and_wait();
    module_->misbehave(ModuleFault::silent, 1);
    EXPECT_EQ(reject(1, 5 * kTimeout), Outcome::failed);
    EXPECT_EQ(times_on(kEjector), 0);
    EXPECT_EQ(reject(2), Outcome::confirmed);
    EXPECT_EQ(ear_.changes, 1);
}

TEST_F(SerialRejector, the_end_of_a_pulse_that_noise_swallowed_is_asked_again) {
    start_and_wait();
    EXPECT_EQ(reject(1), Outcome::confirmed);
    module_->misbehave(ModuleFault::silent, 1);
    EXPECT_TRUE(run_until([&] { return module_->misbehaved() == 1; }));
    EXPECT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    EXPECT_EQ(times_on(kEjector), 1);
    EXPECT_EQ(ear_.changes, 1);
}

TEST_F(SerialRejector, noise_on_what_is_only_read_costs_nothing) {
    start_and_wait();
    rejector_->set_run_permit(true);
    EXPECT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    int seen = 0;
    for (const ModuleFault fault : {ModuleFault::damaged, ModuleFault::noise, ModuleFault::silent}) {
        module_->misbehave_at_reads(fault, 1);
        ++seen;
        EXPECT_TRUE(run_until([&] { return module_->misbehaved() == seen; }));
        EXPECT_EQ(reject(static_cast<std::uint32_t>(seen)), Outcome::confirmed);
    }
    EXPECT_EQ(ear_.changes, 1);
    EXPECT_TRUE(module_->coil(kPermit));
}

TEST_F(SerialRejector, a_module_that_is_gone_is_noticed_and_found_again) {
    start_and_wait();
    module_->power_off();
    EXPECT_TRUE(run_until([&] { return !ear_.up; }));
    EXPECT_THAT(ear_.why_down.what, HasSubstr(module_->device() + " unit 7"));
    EXPECT_EQ(reject(1), Outcome::failed);
    ASSERT_TRUE(module_->power_on());
    expect_recovered();
}

TEST_F(SerialRejector, a_line_that_does_not_exist_is_named) {
    options_.address.serial->device = "/dev/no-such-line";
    start();
    EXPECT_TRUE(run_until([&] { return ear_.changes == 1; }));
    EXPECT_FALSE(ear_.up);
    EXPECT_EQ(ear_.why_down.code, ErrorCode::not_found);
    EXPECT_THAT(ear_.why_down.message(), AllOf(HasSubstr("/dev/no-such-line"), HasSubstr("rejector.device")));
}

TEST_F(SerialRejector, impossible_settings_are_refused) {
    options_.address.unit = 255;
    options_.address.serial->baud = 0;
    rejector_.emplace(*loop_, options_);
    const auto done = rejector_->start(ear_);
    ASSERT_FALSE(done);
    EXPECT_THAT(done.error().what, AllOf(HasSubstr("unit"), HasSubstr("baud")));
}

TEST_F(SerialRejector, the_module_says_what_it_is) {
    CoilLink link(*loop_, options_.address, 10s);
    ASSERT_TRUE(link.connect());
    const auto name = link.identify();
    ASSERT_TRUE(name) << name.error().message();
    EXPECT_EQ(*name, "HORD coil module 1.0");
}

// 3.5 characters of 11 bits before each request, and 2 ms at least; the machine may take longer.
TEST_F(SerialRejector, a_request_waits_until_the_line_was_silent_for_a_frames_gap) {
    for (const auto& [baud, gap] : {std::pair(1200, 32'500us), std::pair(9600, 4062us), std::pair(115'200, 2000us)}) {
        options_.address.serial->baud = baud;
        CoilLink link(*loop_, options_.address, 10s);
        ASSERT_TRUE(link.connect());
        ASSERT_TRUE(link.read(0));
        const hal::TimePoint from = loop_->now();
        for (int k = 0; k < 4; ++k) ASSERT_TRUE(link.read(k));
        EXPECT_GE(loop_->now() - from, 3 * gap) << baud;
    }
}

// A serial line on which bytes never cease, for 3 s at most.
class BabblingLine {
  public:
    BabblingLine() {
        ::grantpt(line_.get());
        ::unlockpt(line_.get());
        termios raw{};
        ::cfmakeraw(&raw);
        ::tcsetattr(line_.get(), TCSANOW, &raw);
        babbler_ = std::jthread([this](const std::stop_token& asked) {
            const auto end = std::chrono::steady_clock::now() + 3s;
            while (!asked.stop_requested() && std::chrono::steady_clock::now() < end) {
                (void)!::write(line_.get(), "UUUUUUUU", 8);
                std::this_thread::sleep_for(100us);
            }
            babbles_ = false;
        });
    }
    [[nodiscard]] std::string device() const { return ::ptsname(line_.get()); }
    [[nodiscard]] bool babbles() const { return babbles_; }

  private:
    common::UniqueFd line_{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)};
    std::atomic<bool> babbles_ = true;
    std::jthread babbler_;  // ends before the line does
};

TEST_F(SerialRejector, a_line_that_never_falls_silent_is_waited_for_within_the_time_outs_alone) {
    const BabblingLine line;
    options_.address.serial->device = line.device();
    options_.address.serial->baud = 1200;  // silence of 32 ms ends a frame: so long no busy machine holds the line up
    CoilLink link(*loop_, options_.address, 50ms);
    ASSERT_TRUE(link.connect());
    EXPECT_TRUE(line.babbles()) << "it waited longer than for an answer";
    CoilLink last(*loop_, options_.address, 10s);
    last.give_up_at(loop_->now() + 50ms);
    ASSERT_TRUE(last.connect());
    EXPECT_TRUE(line.babbles()) << "it waited longer than until it was to give up";
}

}  // namespace
}  // namespace hord::drivers
