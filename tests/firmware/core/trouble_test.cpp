// Devices that refuse or fail: what it does to a part, and what ends a row of failures: literal scenarios.
#include "tests/firmware/core/running.h"

namespace hord::firmware {
namespace {

using algo::Reason;
using algo::Verdict;

TEST_F(Running, a_refused_strobe_rejects) {
    const auto part = rig.part_arrives();
    rig.send(StrobeRefused{part});
    expect_fail_safe(part, PartReason::strobe_failed);
}

TEST_F(Running, a_full_or_failing_inspector_rejects) {
    const auto first = rig.part_is_seen();
    rig.send(InspectRefused{first});
    rig.advance(milliseconds(90));
    const auto second = rig.part_is_seen();
    rig.send(Judged{second, true, Verdict::pass, Reason::none, 0, 0});
    expect_fail_safe(first, PartReason::inspector_failed);
    expect_fail_safe(second, PartReason::inspector_failed);
}

TEST_F(Running, the_same_trouble_part_after_part_is_an_error) {
    for (int k = 0; k < 5; ++k) {
        EXPECT_EQ(rig.core.state(), State::continuous_execution) << k;
        const auto part = rig.part_is_seen();
        rig.judged(part, Verdict::unfit, Reason::too_dark);
        rig.advance(milliseconds(150));
        rig.confirmed(part);
    }
    EXPECT_EQ(rig.core.state(), State::error);
    EXPECT_EQ(rig.shot().first_fault, 9);  // kFaultLightLevel is bit 8
    EXPECT_FALSE(rig.shot().run_permit);
}

TEST_F(Running, a_judged_part_ends_the_row_of_failures) {
    CoreConfig config = quick_line();
    config.max_failures_in_a_row = 3;
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    const auto next = [&](bool fails, Verdict verdict) {
        const auto part = one.part_is_seen();
        if (fails) one.send(Judged{part, true, Verdict::pass, Reason::none, 0, 0});
        else one.judged(part, verdict, verdict == Verdict::pass ? Reason::none : Reason::absorption);
        if (!fails && verdict == Verdict::pass) return one.advance(milliseconds(90));
        one.advance(milliseconds(160));
        if (one.rejected(part)) one.confirmed(part);
        one.advance(milliseconds(40));
    };
    for (const Verdict between : {Verdict::pass, Verdict::reject}) {
        next(true, {});
        next(true, {});
        next(false, between);
    }
    next(true, {});
    next(true, {});
    EXPECT_EQ(one.core.state(), State::continuous_execution);
    EXPECT_FALSE(one.shot().line_stop);
    one.send(Judged{one.part_is_seen(), true, Verdict::pass, Reason::none, 0, 0});
    EXPECT_EQ(one.core.state(), State::error);
}

// A start and a reset begin a new row.
TEST_F(Running, a_start_ends_the_row_of_failures) {
    CoreConfig config = quick_line();
    config.max_failures_in_a_row = 2;
    CoreRig one(config);
    one.bring_to(State::continuous_execution);
    for (const Command start : {Command::start_continuous, Command::start_single}) {
        const auto part = one.part_is_seen();
        one.send(Judged{part, true, Verdict::pass, Reason::none, 0, 0});
        ASSERT_TRUE(one.advance_until_rejected(part));
        one.confirmed(part);
        one.advance(milliseconds(60));
        ASSERT_EQ(one.core.state(), State::continuous_execution);
        ASSERT_EQ(one.send(Command::stop), Answer::done);
        ASSERT_EQ(one.core.state(), State::ready);
        ASSERT_EQ(one.send(start), Answer::done);
    }
    one.send(Judged{one.part_is_seen(), true, Verdict::pass, Reason::none, 0, 0});
    EXPECT_EQ(one.core.state(), State::single_execution);
}

TEST_F(Running, one_good_judgement_shows_that_every_device_works) {
    const auto next = [&](CoreRig& one) {
        one.advance(milliseconds(250));
        one.judged(one.part_is_seen(), Verdict::pass);
    };
    for (const std::uint32_t trouble : {kFaultOverrun, kFaultSensor, kFaultStrobe, kFaultInspector}) {
        CoreRig one;
        one.bring_to(State::continuous_execution);
        const auto part = one.part_is_seen();
        if (trouble == kFaultInspector) one.send(Judged{.part = part, .failed = true});
        one.advance(milliseconds(20));
        if (trouble != kFaultInspector && trouble != kFaultOverrun) {
            const auto other = one.part_arrives();
            if (trouble == kFaultSensor) one.send(TriggerRefused{other});
            if (trouble == kFaultStrobe) one.send(StrobeRefused{other});
        }
        for (const std::uint32_t k : {1U, 2U}) {
            if (one.advance_until_rejected(k, milliseconds(170))) one.confirmed(k);
        }
        EXPECT_NE(one.shot().faults_active & trouble, 0U) << trouble;
        next(one);
        EXPECT_EQ(one.shot().faults_active, 0U) << trouble;
    }
}

TEST_F(Running, one_good_judgement_clears_passing_trouble) {
    auto part = rig.part_is_seen();
    rig.judged(part, Verdict::unfit, Reason::too_dark);
    EXPECT_EQ(rig.shot().faults_active, std::uint32_t{kFaultLightLevel});
    rig.advance(milliseconds(150));
    rig.confirmed(part);
    part = rig.part_is_seen();
    rig.judged(part, Verdict::pass);
    EXPECT_EQ(rig.shot().faults_active, 0U);
    EXPECT_EQ(rig.shot().faults_latched, std::uint32_t{kFaultLightLevel});
}

}  // namespace
}  // namespace hord::firmware
