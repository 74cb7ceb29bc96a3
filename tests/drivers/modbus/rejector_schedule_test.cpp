// What the rejector's driver asks its module, and what it puts off for a pulse.
#include <atomic>

#include "drivers/modbus/coil_link.h"
#include "tests/drivers/modbus/rejector_bench.h"
#include "tests/support/answering_server.h"

namespace hord::drivers {
namespace {

constexpr hal::Duration kNever = 3600s;

class Schedule : public RejectorBench {
  protected:
    // From now on each read counts as misbehaviour, and is answered as ever.
    void count_reads() { module_->misbehave_at_reads(ModuleFault::late, -1); }
};

// The checks are an hour apart: only the clock of the pulse wakes the driver, and only what it writes is read back.
TEST_F(Schedule, a_pulse_ends_by_itself_and_nothing_but_its_writes_is_read_back) {
    options_.check_every = kNever;
    start_and_wait();
    count_reads();
    for (std::uint32_t part = 1; part <= 3; ++part) {
        EXPECT_EQ(reject(part, 500ms), Outcome::confirmed);
        ASSERT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    }
    rejector_->set_run_permit(true);
    ASSERT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    EXPECT_EQ(reject(4, kNever), Outcome::confirmed);
    EXPECT_EQ(module_->misbehaved(), 3 * 2 + 1 + 1);
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
    EXPECT_EQ(tried, 1);
}

// Something else writes the ejector's coil, or the module restarted with it on.
TEST_F(Schedule, an_ejector_that_moves_by_itself_is_noticed) {
    for (const bool permit : {true, false}) {
        if (!permit) options_.permit_coil = -1;
        ear_ = {};
        start_and_wait();
        CoilLink other(*loop_, options_.address, 10s);
        ASSERT_TRUE(other.connect());
        ASSERT_TRUE(other.write(kEjector, true));
        ASSERT_TRUE(run_until([&] { return ear_.up && !ear_.losses.empty(); }));
        EXPECT_THAT(ear_.losses[0], HasSubstr("lost its outputs: coil 0 is 1 ("));
        EXPECT_FALSE(module_->coil(kEjector));
        rejector_->stop();
    }
}

}  // namespace
}  // namespace hord::drivers
