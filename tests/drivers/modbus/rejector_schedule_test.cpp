// What the rejector's driver asks its module, and what it puts off for a pulse.
#include <atomic>
#include <ctime>
#include <thread>

#include "drivers/modbus/coil_link.h"
#include "tests/drivers/modbus/rejector_bench.h"
#include "tests/support/answering_server.h"

namespace hord::drivers {
namespace {

constexpr hal::Duration kNever = 3600s;

class Schedule : public RejectorBench {
  protected:
    // From now on each request counts as misbehaviour, and is answered as ever.
    void count_requests() { module_->misbehave(ModuleFault::late, -1, {}, true); }
    void count_reads() { module_->misbehave_at_reads(ModuleFault::late, -1); }
};

// The checks are an hour apart: only the clock of the pulse wakes the driver, and each output is written once, and read
// back.
TEST_F(Schedule, a_pulse_ends_by_itself_and_nothing_is_asked_but_its_writes) {
    options_.check_every = kNever;
    count_requests();
    start_and_wait();
    for (std::uint32_t part = 1; part <= 2; ++part) {
        EXPECT_EQ(reject(part), Outcome::confirmed);
        ASSERT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    }
    rejector_->set_run_permit(true);
    ASSERT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    EXPECT_EQ(reject(3, kNever), Outcome::confirmed);
    constexpr int kBeginning = 2, kPulses = 2 * 2 + 1, kPermits = 1;
    EXPECT_EQ(module_->misbehaved(), 2 * (kBeginning + kPulses + kPermits));
}

TEST_F(Schedule, checks_and_readings_of_the_confirm_sensor_come_no_more_often_than_is_said) {
    options_.check_every = 300ms;
    options_.confirm_input = 3;
    start_and_wait();
    const hal::TimePoint from = loop_->now();
    count_reads();
    ASSERT_TRUE(run_until([&] { return module_->misbehaved() >= 7; }));
    EXPECT_GE(loop_->now() - from, 2 * options_.check_every) << "two reads each interval";
}

// Of the processor's time, while nothing is due: a loop that does not wait would take all that the machine gives it.
TEST_F(Schedule, with_nothing_to_do_it_sleeps) {
    options_.check_every = kNever;
    start_and_wait();
    const std::clock_t from = std::clock();
    loop_->run_until([] { return false; }, 500ms);
    EXPECT_LT(std::clock() - from, CLOCKS_PER_SEC / 40) << "a twentieth of the time";
}

TEST_F(Schedule, a_pulse_lasts_to_the_end_of_the_longer_of_two_commands) {
    start_and_wait();
    for (const bool longer_first : {true, false}) {
        const hal::TimePoint from = loop_->now(), until = from + 1500ms;
        const hal::Duration longer = until - from, shorter = longer - 300ms;
        ear_.reports.clear();
        const std::uint32_t part = longer_first ? 1 : 3;
        ASSERT_TRUE(rejector_->reject({part, from, longer_first ? longer : shorter}));
        ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 1; }));
        ASSERT_TRUE(rejector_->reject({part + 1, from, longer_first ? shorter : longer}));
        ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 2; }));
        ASSERT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
        EXPECT_GE(loop_->now(), until);
    }
    EXPECT_EQ(reject(5), Outcome::confirmed);
}

// A module that takes 700 ms to answer has no check begun within twice that before a pulse.
TEST_F(Schedule, a_check_that_could_still_run_when_a_pulse_is_due_waits_for_it) {
    options_.response_timeout = 1s;
    options_.check_every = 1s;
    start_and_wait();
    bool in_time = false;
    for (std::uint32_t part = 1; part <= 20 && !in_time; ++part) {
        module_->misbehave_at_reads(ModuleFault::late, 1, 700ms);
        const int before = module_->misbehaved();
        ASSERT_TRUE(run_until([&] { return module_->misbehaved() == before + 1; }));
        const hal::TimePoint asked = loop_->now();  // the next check is due after 1 s
        count_reads();
        ASSERT_TRUE(rejector_->reject({part, asked + 1500ms, kWindow}));
        in_time = loop_->now() < asked + 500ms;  // else this machine held the test up: once more
        const std::size_t reports = ear_.reports.size();
        ASSERT_TRUE(run_until([&] { return ear_.reports.size() > reports; }));
        EXPECT_EQ(ear_.reports.back().outcome, Outcome::confirmed);
        if (in_time) {
            EXPECT_EQ(module_->misbehaved(), before + 2) << "the slow read and the reading back";
        }
    }
    EXPECT_TRUE(in_time);
}

TEST_F(Schedule, a_module_that_is_not_there_is_tried_again_as_often_as_is_said) {
    std::atomic<int> tried = 0;
    const test::AnsweringServer server([&](const std::string&) { return ++tried, std::string(); });
    options_.address.port = server.port();
    options_.reconnect_every = kNever;
    start();
    ASSERT_TRUE(run_until([&] { return ear_.changes == 1; }));
    for (std::uint32_t part = 1; part <= 3; ++part) EXPECT_EQ(reject(part), Outcome::failed);
    ASSERT_TRUE(rejector_->reject({4, loop_->now() + 300ms, kWindow}));
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 4; })) << "when it is due, and not at the next attempt";
    EXPECT_EQ(ear_.reports.back().outcome, Outcome::failed);
    EXPECT_EQ(tried, 1);
}

TEST_F(Schedule, a_lost_link_is_made_anew_at_once_and_one_that_was_refused_its_beginning_is_not_used) {
    options_.reconnect_every = kNever;
    start_and_wait();
    module_->misbehave(ModuleFault::close, 1);
    EXPECT_EQ(reject(1), Outcome::failed);
    ASSERT_TRUE(run_until([&] { return ear_.changes == 3 && ear_.up; }));
    rejector_->stop();
    ear_ = {};
    module_->misbehave(ModuleFault::exception, 1);
    start();
    ASSERT_TRUE(run_until([&] { return ear_.changes == 1; }));
    EXPECT_FALSE(ear_.up);
    EXPECT_EQ(reject(2), Outcome::failed);
    EXPECT_EQ(times_on(kEjector), 0);
}

// Something else writes the ejector's coil, or the module restarted.
TEST_F(Schedule, an_ejector_that_moves_by_itself_is_noticed) {
    for (const bool permit : {true, false}) {
        if (!permit) options_.permit_coil = -1;
        ear_ = {};
        start_and_wait();
        CoilLink other(*loop_, options_.address, 10s);
        ASSERT_TRUE(other.connect());
        ASSERT_TRUE(other.write(kEjector, true));
        ASSERT_TRUE(run_until([&] { return ear_.up && ear_.losses.size() == 1; }));
        EXPECT_THAT(ear_.losses[0], HasSubstr("lost its outputs: coil 0 is 1 ("));
        EXPECT_FALSE(module_->coil(kEjector));
        EXPECT_EQ(reject(1, kNever), Outcome::confirmed);
        ASSERT_TRUE(other.write(kEjector, false));
        ASSERT_TRUE(run_until([&] { return ear_.up && ear_.losses.size() == 2; }));
        EXPECT_THAT(ear_.losses[1], HasSubstr("lost its outputs: coil 0 is 0 (")) << "in a pulse";
        count_reads();
        ASSERT_TRUE(run_until([&] { return module_->misbehaved() >= 4; }));
        EXPECT_EQ(ear_.losses.size(), 2U) << "the new link knows of no pulse";
        rejector_->stop();
        module_->misbehave(ModuleFault::none);
    }
}

TEST_F(Schedule, outputs_and_the_confirm_sensor_may_be_the_first_of_their_kind) {
    options_.ejector_coil = 1;
    options_.permit_coil = options_.confirm_input = 0;
    options_.check_every = kTimeout;
    std::atomic<bool> falls = true;
    module_->on_coil([&](int coil, bool on, hal::TimePoint) {
        if (coil == 1) module_->set_input(0, on && falls);
    });
    start_and_wait();
    rejector_->set_run_permit(true);
    ASSERT_TRUE(run_until([&] { return module_->coil(0); }));
    EXPECT_EQ(reject(1), Outcome::confirmed);
    ASSERT_TRUE(run_until([&] { return !module_->coil(1); }));
    falls = false;
    EXPECT_EQ(reject(2), Outcome::failed);
    CoilLink other(*loop_, options_.address, 10s);
    ASSERT_TRUE(other.connect());
    ASSERT_TRUE(other.write(0, false));
    ASSERT_TRUE(run_until([&] { return !ear_.losses.empty(); }));
    EXPECT_THAT(ear_.losses[0], HasSubstr("lost its outputs: coil 0 is 0 ("));
    rejector_->stop();  // the module calls with what ends here
}

// The sensor is read once: the ends of the pulse and of the wait come by the clock alone.
TEST_F(Schedule, a_part_that_never_arrives_is_given_up_in_time_and_its_pulse_ends_before) {
    options_.check_every = options_.confirm_every = kNever;
    options_.confirm_input = 3;
    options_.confirm_within = 600ms;
    start_and_wait();
    const hal::TimePoint until = loop_->now() + kWindow;
    ASSERT_TRUE(rejector_->reject({1, until - kWindow, kWindow}));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));
    ASSERT_TRUE(run_until([&] { return !ear_.reports.empty(); }));
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::failed);
    EXPECT_GE(ear_.reports[0].at, until + options_.confirm_within);
    const auto history = module_->history();
    ASSERT_EQ(history.size(), 2U);
    EXPECT_LT(history[1].at, ear_.reports[0].at);
}

TEST_F(Schedule, a_driver_that_ends_without_stop_tells_nobody_and_leaves_the_module_safe) {
    start_and_wait();
    rejector_->set_run_permit(true);
    ASSERT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    ASSERT_TRUE(rejector_->reject({1, loop_->now() + kNever, kWindow}));
    module_->misbehave(ModuleFault::exception, 1);
    ASSERT_TRUE(rejector_->reject({2, loop_->now(), kWindow}));
    while (module_->misbehaved() == 0) std::this_thread::sleep_for(1ms);  // what is told of it waits for the loop
    rejector_.reset();
    EXPECT_TRUE(ear_.reports.empty());
    EXPECT_TRUE(ear_.failures.empty());
    EXPECT_FALSE(module_->coil(kPermit));
}

TEST_F(Schedule, a_driver_that_its_listener_stops_tells_it_nothing_more) {
    struct Stopping final : hal::Rejector::Listener {
        hal::Rejector* rejector = nullptr;
        int reports = 0;
        bool up = false;
        void on_reject(const hal::RejectReport&) override {
            ++reports;
            rejector->stop();
        }
        void on_rejector_link(bool is_up, const Error&) override { up = is_up; }
        void on_reject_failed(const Error&) override {}
    } listener;
    rejector_.emplace(*loop_, options_);
    listener.rejector = &*rejector_;
    ASSERT_TRUE(rejector_->start(listener));
    ASSERT_TRUE(run_until([&] { return listener.up; }));
    const hal::RejectCommand command{1, loop_->now(), kWindow};
    for (int k = 0; k < 2; ++k) ASSERT_TRUE(rejector_->reject(command)) << "it is owed two reports";
    ASSERT_TRUE(run_until([&] { return listener.reports > 0; }));
    EXPECT_EQ(listener.reports, 1);
}

}  // namespace
}  // namespace hord::drivers
