// The contract of drivers/hal/strobe.h, tested on every backend.
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;
using hal::StrobePulse;

struct Ear final : hal::Strobe::Listener {
    void on_strobe(const hal::StrobeReport& report) override {
        reports.push_back(report);
        if (then) then();
    }
    void on_strobe_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::StrobeReport> reports;
    std::vector<Error> losses;
    std::function<void()> then;
};

// The longest pulse allowed, far enough ahead for a driver in real time.
StrobePulse pulse(StrobeHarness& h, std::uint32_t exposure) {
    return {.exposure = exposure, .channels = 1, .start = h.now() + 5ms, .width = h.device().limits().max_on};
}

TEST_P(StrobeContract, an_accepted_pulse_is_reported_exactly_once_with_what_truly_happened) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    const StrobePulse asked = pulse(*h_, 7);
    ASSERT_TRUE(h_->device().fire(asked));
    ASSERT_TRUE(h_->run_until([&] { return !ear.reports.empty(); }));
    h_->run_for(kQuiet);
    ASSERT_EQ(ear.reports.size(), 1U);
    EXPECT_EQ(ear.reports[0].exposure, 7U);
    EXPECT_TRUE(ear.reports[0].lit);
    EXPECT_GE(ear.reports[0].start, asked.start);
    EXPECT_GT(ear.reports[0].width, 0ns);
    EXPECT_GE(h_->now(), ear.reports[0].start + ear.reports[0].width);
    if (const auto light = h_->light()) {
        EXPECT_EQ(*light, ear.reports[0].width);
    }
    h_->device().stop();
}

TEST_P(StrobeContract, a_pulse_outside_the_limits_is_refused_and_lights_nothing) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    const auto limits = h_->device().limits();
    for (const hal::Duration width : {hal::Duration(0), hal::Duration(-1), limits.max_on + 1ns}) {
        StrobePulse bad = pulse(*h_, 1);
        bad.width = width;
        EXPECT_EQ(code_of(h_->device().fire(bad)), ErrorCode::invalid_argument) << width.count();
    }
    std::vector<std::uint32_t> channel_sets = {0U};
    if (limits.channels < 32) channel_sets.push_back(1U << static_cast<unsigned>(limits.channels));
    for (const std::uint32_t channels : channel_sets) {
        StrobePulse bad = pulse(*h_, 1);
        bad.channels = channels;
        EXPECT_EQ(code_of(h_->device().fire(bad)), ErrorCode::invalid_argument) << channels;
    }
    h_->run_for(kQuiet);
    EXPECT_TRUE(ear.reports.empty());
    if (const auto light = h_->light()) {
        EXPECT_EQ(*light, 0ns);
    }
    h_->device().stop();
}

TEST_P(StrobeContract, the_light_rests_between_pulses_and_may_fire_again_right_after) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    const auto limits = h_->device().limits();
    StrobePulse next = pulse(*h_, 1);
    ASSERT_TRUE(h_->device().fire(next));
    next.exposure = 2;
    next.start += next.width + limits.min_rest;
    if (limits.min_rest > 0ns) {
        StrobePulse early = next;
        early.start -= 1ns;
        EXPECT_EQ(code_of(h_->device().fire(early)), ErrorCode::busy);
    }
    ASSERT_TRUE(h_->device().fire(next));
    ASSERT_TRUE(h_->run_until([&] { return ear.reports.size() == 2; }));
    EXPECT_EQ(ear.reports[0].exposure, 1U);
    EXPECT_EQ(ear.reports[1].exposure, 2U);
    h_->device().stop();
}

TEST_P(StrobeContract, it_does_not_fire_before_start_or_after_stop) {
    Ear ear;
    EXPECT_EQ(code_of(h_->device().fire(pulse(*h_, 1))), ErrorCode::disconnected);
    ASSERT_TRUE(h_->device().start(ear));
    EXPECT_EQ(code_of(h_->device().start(ear)), ErrorCode::invalid_argument);
    h_->device().stop();
    EXPECT_EQ(code_of(h_->device().fire(pulse(*h_, 1))), ErrorCode::disconnected);
    h_->device().stop();
    if (const auto light = h_->light()) {
        EXPECT_EQ(*light, 0ns);
    }
}

TEST_P(StrobeContract, stop_turns_off_forgets_what_has_not_begun_and_reports_it_as_not_lit) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    StrobePulse later = pulse(*h_, 3);
    later.start = h_->now() + 40ms;
    ASSERT_TRUE(h_->device().fire(later));
    h_->device().stop();
    ASSERT_EQ(ear.reports.size(), 1U);
    EXPECT_EQ(ear.reports[0].exposure, 3U);
    EXPECT_FALSE(ear.reports[0].lit);
    h_->run_for(kQuiet);
    EXPECT_EQ(ear.reports.size(), 1U);
    if (const auto light = h_->light()) {
        EXPECT_EQ(*light, 0ns);
    }
}

TEST_P(StrobeContract, it_may_be_stopped_from_its_own_callback_and_started_again) {
    Ear ear;
    ear.then = [&] { h_->device().stop(); };
    ASSERT_TRUE(h_->device().start(ear));
    ASSERT_TRUE(h_->device().fire(pulse(*h_, 1)));
    ASSERT_TRUE(h_->run_until([&] { return !ear.reports.empty(); }));
    ear.then = nullptr;
    ASSERT_TRUE(h_->device().start(ear));
    StrobePulse second = pulse(*h_, 2);
    second.start += h_->device().limits().min_rest;
    ASSERT_TRUE(h_->device().fire(second));
    ASSERT_TRUE(h_->run_until([&] { return ear.reports.size() == 2; }));
    EXPECT_TRUE(ear.reports[1].lit);
    h_->device().stop();
}

TEST_P(StrobeContract, a_loss_is_told_once_nothing_fires_and_a_restart_recovers) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    if (!h_->lose()) GTEST_SKIP() << "a loss cannot be shown here";
    // The driver detects the loss at the next use at the latest.
    (void)h_->device().fire(pulse(*h_, 1));
    ASSERT_TRUE(h_->run_until([&] { return !ear.losses.empty(); }));
    StrobePulse next = pulse(*h_, 2);
    next.start += 1s;
    EXPECT_EQ(code_of(h_->device().fire(next)), ErrorCode::disconnected);
    h_->run_for(kQuiet);
    EXPECT_EQ(ear.losses.size(), 1U);
    h_->device().stop();
    h_->bring_back();
    ear.reports.clear();
    ASSERT_TRUE(h_->run_until([&] { return h_->device().start(ear).has_value(); }));
    next.start = h_->now() + 1s + 5ms;
    ASSERT_TRUE(h_->device().fire(next));
    ASSERT_TRUE(h_->run_until([&] { return !ear.reports.empty(); }));
    EXPECT_TRUE(ear.reports[0].lit);
    h_->device().stop();
}

}  // namespace
}  // namespace hord::contract
