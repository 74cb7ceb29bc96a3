// The rejector driver with a sensor behind the ejector that confirms a rejection.
#include "tests/drivers/modbus/rejector_bench.h"

namespace hord::drivers {
namespace {

constexpr int kChute = 3;

class Chute : public RejectorBench {
  protected:
    Chute() {
        options_.confirm_input = kChute;
        options_.confirm_within = 400ms;
    }
    // A part falls past the sensor while the ejector acts.
    void let_parts_fall(bool active_low = false) {
        module_->on_coil([this, active_low](int coil, bool on, hal::TimePoint) {
            if (coil == kEjector) module_->set_input(kChute, on != active_low);
        });
    }
};

TEST_F(Chute, a_part_that_arrives_confirms_its_command_with_the_time_of_the_acknowledgement) {
    let_parts_fall();
    start_and_wait();
    const hal::TimePoint asked = loop_->now();
    EXPECT_EQ(reject(1), Outcome::confirmed);
    EXPECT_GE(ear_.reports[0].at, asked);
    EXPECT_LT(ear_.reports[0].at, asked + kWindow);
}

TEST_F(Chute, a_part_that_never_arrives_leaves_its_command_unconfirmed_although_the_coil_moved) {
    start_and_wait();
    EXPECT_EQ(reject(1, 600ms), Outcome::failed);
    EXPECT_EQ(times_on(kEjector), 1);
    EXPECT_TRUE(ear_.up);
    ASSERT_EQ(ear_.failures.size(), 1U);
    EXPECT_EQ(ear_.failures[0].what, "the confirm sensor (input 3) did not see part 1 within 400 ms of its pulse");
}

TEST_F(Chute, a_sensor_that_is_covered_all_the_time_confirms_nothing) {
    module_->set_input(kChute, true);
    start_and_wait();
    EXPECT_EQ(reject(1, 600ms), Outcome::failed);
}

TEST_F(Chute, one_part_confirms_one_command) {
    start_and_wait();
    const hal::TimePoint start = loop_->now();
    ASSERT_TRUE(rejector_->reject({1, start, kWindow}));
    ASSERT_TRUE(rejector_->reject({2, start + 1ms, kWindow}));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));
    loop_->call_after(100ms, [&] { module_->set_input(kChute, true); });
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 2; }));
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::confirmed);
    EXPECT_EQ(ear_.reports[0].part, 1U);
    EXPECT_EQ(ear_.reports[1].outcome, Outcome::failed);
}

TEST_F(Chute, two_parts_confirm_two_commands_in_their_order) {
    options_.check_every = 3600s;
    start_and_wait();
    const hal::TimePoint start = loop_->now();
    ASSERT_TRUE(rejector_->reject({1, start, kWindow}));
    ASSERT_TRUE(rejector_->reject({2, start + 1ms, kWindow}));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));
    module_->set_input(kChute, true);
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 1; }));
    module_->set_input(kChute, false);
    module_->misbehave_at_reads(ModuleFault::late, 3);  // counted, and answered as ever: the driver saw it
    ASSERT_TRUE(run_until([&] { return module_->misbehaved() == 3; }));
    module_->set_input(kChute, true);
    ASSERT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    loop_->run_until([] { return false; }, options_.confirm_within + 100ms);
    ASSERT_EQ(ear_.reports.size(), 2U);
    for (std::size_t k = 0; k < 2; ++k) {
        EXPECT_EQ(ear_.reports[k].outcome, Outcome::confirmed);
        EXPECT_EQ(ear_.reports[k].part, k + 1);
    }
    EXPECT_THAT(ear_.failures, testing::IsEmpty());
}

TEST_F(Chute, a_sensor_may_be_active_low) {
    options_.confirm_active_low = true;
    module_->set_input(kChute, true);  // at rest
    let_parts_fall(true);
    start_and_wait();
    EXPECT_EQ(reject(1), Outcome::confirmed);
}

TEST_F(Chute, a_link_that_goes_while_a_part_is_awaited_leaves_it_unconfirmed) {
    start_and_wait();
    const std::size_t before = ear_.reports.size();
    ASSERT_TRUE(rejector_->reject({1, loop_->now(), kWindow}));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));
    module_->power_off();
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() > before; }));
    EXPECT_EQ(ear_.reports.back().outcome, Outcome::failed);
}

}  // namespace
}  // namespace hord::drivers
