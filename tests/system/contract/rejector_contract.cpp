// The contract of drivers/hal/rejector.h, tested on every backend.
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;
using hal::RejectCommand;
using Outcome = hal::RejectReport::Outcome;

TEST_P(RejectorContract, the_link_is_down_until_told_otherwise) {
    ASSERT_TRUE(h_->device().start(ear_));
    EXPECT_FALSE(ear_.up);
    EXPECT_TRUE(h_->run_until([&] { return ear_.up; }));
    EXPECT_EQ(code_of(h_->device().start(ear_)), ErrorCode::invalid_argument);
    h_->device().stop();
}

TEST_P(RejectorContract, a_command_acts_in_its_window_and_is_confirmed_exactly_once) {
    start_and_wait();
    const RejectCommand asked = command(5);
    ASSERT_TRUE(h_->device().reject(asked));
    ASSERT_TRUE(h_->run_until([&] { return !ear_.reports.empty() && h_->actuations().size() == 1 && all_off(); }));
    h_->run_for(kQuiet);
    ASSERT_EQ(ear_.reports.size(), 1U);
    EXPECT_EQ(ear_.reports[0].part, 5U);
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::confirmed);
    EXPECT_GE(ear_.reports[0].at, asked.start);
    const auto acts = h_->actuations();
    ASSERT_EQ(acts.size(), 1U);
    EXPECT_GE(acts[0].from, asked.start);
    EXPECT_LE(acts[0].from, asked.start + h_->slack());
    EXPECT_LE(*acts[0].until, asked.start + asked.width + h_->slack());
    h_->device().stop();
}

TEST_P(RejectorContract, a_command_repeated_for_its_part_acts_once_and_is_reported_as_often_as_accepted) {
    start_and_wait();
    const RejectCommand asked = command(5);
    ASSERT_TRUE(h_->device().reject(asked));
    ASSERT_TRUE(h_->device().reject(asked));
    ASSERT_TRUE(h_->run_until([&] { return ear_.reports.size() == 2 && h_->actuations().size() == 1 && all_off(); }));
    ASSERT_TRUE(h_->device().reject(asked));  // after it was settled
    ASSERT_TRUE(h_->run_until([&] { return ear_.reports.size() == 3; }));
    h_->run_for(kQuiet);
    EXPECT_THAT(ear_.parts(), testing::ElementsAre(5U, 5U, 5U));
    EXPECT_THAT(ear_.reports, testing::Each(testing::Field(&hal::RejectReport::outcome, Outcome::confirmed)));
    EXPECT_EQ(h_->actuations().size(), 1U);
    h_->device().stop();
}

TEST_P(RejectorContract, every_part_of_a_row_is_acted_on_and_reported) {
    start_and_wait();
    const hal::TimePoint first = h_->now() + 20ms;
    for (std::uint32_t part = 1; part <= 4; ++part) {
        ASSERT_TRUE(
            h_->device().reject({.part = part, .start = first + part * (h_->window() + 40ms), .width = h_->window()}));
    }
    ASSERT_TRUE(h_->run_until([&] { return ear_.reports.size() == 4 && h_->actuations().size() == 4 && all_off(); }));
    EXPECT_THAT(ear_.parts(), testing::ElementsAre(1U, 2U, 3U, 4U));
    EXPECT_THAT(ear_.reports, testing::Each(testing::Field(&hal::RejectReport::outcome, Outcome::confirmed)));
    h_->device().stop();
}

TEST_P(RejectorContract, a_window_that_is_over_is_reported_late_and_nothing_acts) {
    start_and_wait();
    ASSERT_TRUE(h_->device().reject(command(9, -h_->window() - 1ms)));
    ASSERT_TRUE(h_->run_until([&] { return !ear_.reports.empty(); }));
    EXPECT_EQ(ear_.reports[0].part, 9U);
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::late);
    h_->run_for(kQuiet);
    EXPECT_TRUE(h_->actuations().empty());
    h_->device().stop();
}

TEST_P(RejectorContract, preconditions_are_refused) {
    EXPECT_EQ(code_of(h_->device().reject(command(1))), ErrorCode::disconnected);
    start_and_wait();
    for (const hal::Duration width : {hal::Duration(0), hal::Duration(-1)}) {
        RejectCommand bad = command(1);
        bad.width = width;
        EXPECT_EQ(code_of(h_->device().reject(bad)), ErrorCode::invalid_argument);
    }
    h_->device().stop();
    EXPECT_EQ(code_of(h_->device().reject(command(1))), ErrorCode::disconnected);
    EXPECT_TRUE(ear_.reports.empty());
}

TEST_P(RejectorContract, its_queue_is_bounded_and_says_busy_and_still_reports_what_it_took) {
    start_and_wait();
    std::uint32_t accepted = 0;
    const hal::TimePoint far = h_->now() + 10s;
    std::optional<ErrorCode> refused;
    for (std::uint32_t part = 1; part <= 10000 && !refused; ++part) {
        refused = code_of(h_->device().reject({.part = part, .start = far + part * 50ms, .width = h_->window()}));
        if (!refused) ++accepted;
    }
    EXPECT_EQ(refused, ErrorCode::busy);
    EXPECT_GE(accepted, 8U);
    h_->device().stop();
    EXPECT_EQ(ear_.reports.size(), accepted);
    EXPECT_THAT(ear_.reports, testing::Each(testing::Field(&hal::RejectReport::outcome, Outcome::failed)));
}

TEST_P(RejectorContract, stop_makes_safe_reports_what_is_pending_as_failed_and_is_quiet_afterwards) {
    h_->device().stop();
    start_and_wait();
    h_->device().set_run_permit(true);
    ASSERT_TRUE(h_->run_until([&] { return h_->permit(); }));
    RejectCommand now = command(1, 0ms);
    now.width = 5s;
    ASSERT_TRUE(h_->device().reject(now));
    ASSERT_TRUE(h_->run_until([&] { return h_->actuations().size() == 1; }));
    const std::size_t before = ear_.reports.size();
    ASSERT_TRUE(h_->device().reject(command(2, 30ms)));
    h_->device().stop();
    EXPECT_FALSE(h_->permit());
    EXPECT_TRUE(all_off());
    ASSERT_GE(ear_.reports.size(), before + 1);
    EXPECT_EQ(ear_.reports.back().part, 2U);
    EXPECT_EQ(ear_.reports.back().outcome, Outcome::failed);
    const std::size_t after = ear_.reports.size();
    const int changes = ear_.changes;
    h_->run_for(kQuiet);
    EXPECT_EQ(ear_.reports.size(), after);
    EXPECT_EQ(ear_.changes, changes);
    EXPECT_EQ(h_->actuations().size(), 1U);
}

TEST_P(RejectorContract, it_works_again_after_stop_and_part_numbers_begin_anew) {
    start_and_wait();
    ASSERT_TRUE(h_->device().reject(command(1, 5ms)));
    ASSERT_TRUE(h_->run_until([&] { return !ear_.reports.empty() && all_off(); }));
    h_->device().stop();
    ear_.up = false;
    ear_.reports.clear();
    start_and_wait();
    const std::size_t before = h_->actuations().size();
    ASSERT_TRUE(h_->device().reject(command(1, 5ms)));
    ASSERT_TRUE(
        h_->run_until([&] { return !ear_.reports.empty() && h_->actuations().size() == before + 1 && all_off(); }));
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::confirmed);
    h_->device().stop();
}

TEST_P(RejectorContract, it_may_be_stopped_from_its_own_callback) {
    ear_.then = [&] { h_->device().stop(); };
    start_and_wait();
    ASSERT_TRUE(h_->device().reject(command(1, 5ms)));
    ASSERT_TRUE(h_->run_until([&] { return !ear_.reports.empty(); }));
    h_->run_for(kQuiet);
    EXPECT_EQ(ear_.reports.size(), 1U);
    EXPECT_TRUE(all_off());
}

TEST_P(RejectorContract, the_permit_is_what_was_last_said_and_drops_at_stop) {
    h_->device().set_run_permit(true);  // not started: no effect
    EXPECT_FALSE(h_->permit());
    start_and_wait();
    h_->run_for(kQuiet);
    EXPECT_FALSE(h_->permit());
    h_->device().set_run_permit(true);
    h_->device().set_run_permit(true);
    EXPECT_TRUE(h_->run_until([&] { return h_->permit(); }));
    h_->device().set_run_permit(false);
    EXPECT_TRUE(h_->run_until([&] { return !h_->permit(); }));
    h_->device().set_run_permit(true);
    EXPECT_TRUE(h_->run_until([&] { return h_->permit(); }));
    h_->device().stop();
    EXPECT_FALSE(h_->permit());
}

TEST_P(RejectorContract, without_the_module_commands_fail_the_permit_drops_and_all_comes_back_by_itself) {
    start_and_wait();
    h_->device().set_run_permit(true);
    ASSERT_TRUE(h_->run_until([&] { return h_->permit(); }));
    if (!h_->lose()) GTEST_SKIP() << "a loss cannot be shown here";
    // The driver detects the loss at the next use at the latest.
    ASSERT_TRUE(h_->device().reject(command(1, 5ms)));
    ASSERT_TRUE(h_->run_until([&] { return !ear_.up && !ear_.reports.empty(); }));
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::failed);
    EXPECT_FALSE(ear_.why_down.what.empty());
    EXPECT_FALSE(ear_.why_down.cure.empty());
    ASSERT_TRUE(h_->device().reject(command(2, 5ms)));
    ASSERT_TRUE(h_->run_until([&] { return ear_.reports.size() == 2; }));
    EXPECT_EQ(ear_.reports[1].outcome, Outcome::failed);
    EXPECT_FALSE(h_->permit());
    h_->bring_back();
    ASSERT_TRUE(h_->run_until([&] { return ear_.up; }));
    h_->run_for(kQuiet);
    EXPECT_FALSE(h_->permit());  // down until it is set again
    EXPECT_EQ(ear_.changes, 3);  // up, down, up
    const std::size_t before = h_->actuations().size();
    ASSERT_TRUE(h_->device().reject(command(3)));
    ASSERT_TRUE(h_->run_until([&] { return ear_.reports.size() == 3 && h_->actuations().size() == before + 1; }));
    EXPECT_EQ(ear_.reports[2].outcome, Outcome::confirmed);
    h_->device().stop();
}

}  // namespace
}  // namespace hord::contract
