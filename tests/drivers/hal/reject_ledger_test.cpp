#include "drivers/hal/reject_ledger.h"

#include <vector>

#include <gtest/gtest.h>

namespace hord::hal {
namespace {

using namespace std::chrono_literals;
using Entered = RejectLedger::Entered;
using Outcome = RejectReport::Outcome;

constexpr std::size_t kRecords = 256;

constexpr TimePoint at(Duration t) { return TimePoint(10s + t); }
RejectCommand command(std::uint32_t part, Duration start = {}) { return {part, at(start), 10ms}; }

TEST(RejectLedger, each_command_is_carried_out_once_and_reported_as_often_as_it_was_given) {
    RejectLedger ledger;
    const auto first = ledger.enter(command(7));
    ASSERT_EQ(first.entered, Entered::fresh);
    EXPECT_EQ(ledger.enter(command(7)).entered, Entered::repeat);
    EXPECT_EQ(ledger.enter(command(7)).entered, Entered::repeat);
    EXPECT_EQ(ledger.enter(command(8)).entered, Entered::fresh) << "another part at the same time";
    EXPECT_EQ(ledger.settle(first.slot, {7, Outcome::confirmed, at(3ms)}), 3U);
    EXPECT_EQ(ledger.settle(first.slot, {7, Outcome::failed, at(4ms)}), 0U) << "it was settled before";
    const auto again = ledger.enter(command(7));
    EXPECT_EQ(again.entered, Entered::settled);
    EXPECT_EQ(again.report.part, 7U);
    EXPECT_EQ(again.report.outcome, Outcome::confirmed);
    EXPECT_EQ(again.report.at, at(3ms));
}

TEST(RejectLedger, the_same_number_a_second_away_is_another_part) {
    for (const bool settled : {false, true}) {
        RejectLedger ledger;
        const auto first = ledger.enter(command(7));
        if (settled) ledger.settle(first.slot, {7, Outcome::confirmed, at({})});
        const Entered same = settled ? Entered::settled : Entered::repeat;
        EXPECT_EQ(ledger.enter(command(7, 1s - 1ns)).entered, same);
        EXPECT_EQ(ledger.enter(command(7, -1s + 1ns)).entered, same);
        EXPECT_EQ(ledger.enter(command(7, 1s)).entered, Entered::fresh);
        EXPECT_EQ(ledger.enter(command(7, -1s)).entered, Entered::fresh);
    }
}

TEST(RejectLedger, takes_32_at_a_time_and_one_more_for_each_that_is_settled) {
    RejectLedger ledger;
    std::vector<std::size_t> slots;
    for (std::uint32_t part = 0; part < RejectLedger::kPending; ++part) {
        const auto entry = ledger.enter(command(part));
        ASSERT_EQ(entry.entered, Entered::fresh) << part;
        slots.push_back(entry.slot);
    }
    EXPECT_EQ(ledger.enter(command(99)).entered, Entered::full);
    EXPECT_EQ(ledger.enter(command(5)).entered, Entered::repeat) << "a repeat needs no room";
    ledger.settle(slots[5], {5, Outcome::late, at({})});
    EXPECT_EQ(ledger.enter(command(99)).entered, Entered::fresh);
    EXPECT_EQ(ledger.enter(command(98)).entered, Entered::full);
}

// The records are used in turn; one whose report is still owed keeps its place.
TEST(RejectLedger, pending_commands_are_never_overwritten_and_settled_ones_are_in_turn) {
    RejectLedger ledger;
    const auto pending = ledger.enter(command(1));
    for (std::uint32_t part = 2; part <= kRecords; ++part) {
        const auto entry = ledger.enter(command(part));
        ASSERT_EQ(entry.entered, Entered::fresh);
        ledger.settle(entry.slot, {part, Outcome::confirmed, at({})});
    }
    EXPECT_EQ(ledger.enter(command(2)).entered, Entered::settled) << "all of them are known";
    const auto next = ledger.enter(command(1000));
    ASSERT_EQ(next.entered, Entered::fresh);
    EXPECT_NE(next.slot, pending.slot);
    EXPECT_EQ(ledger.enter(command(3)).entered, Entered::settled);
    EXPECT_EQ(ledger.enter(command(1)).entered, Entered::repeat);
    EXPECT_EQ(ledger.settle(pending.slot, {1, Outcome::late, at({})}), 2U);
    EXPECT_EQ(ledger.enter(command(2)).entered, Entered::fresh) << "the oldest one made room";
}

TEST(RejectLedger, settles_all_that_are_owed_each_as_often_as_it_was_given) {
    RejectLedger ledger;
    const auto done = ledger.enter(command(1));
    ledger.settle(done.slot, {1, Outcome::confirmed, at({})});
    ledger.enter(command(2));
    ledger.enter(command(2));
    ledger.enter(command(3));
    std::vector<std::uint32_t> parts;
    ledger.settle_all(Outcome::failed, at(5ms), [&](const RejectReport& report) {
        EXPECT_EQ(report.outcome, Outcome::failed);
        EXPECT_EQ(report.at, at(5ms));
        parts.push_back(report.part);
    });
    EXPECT_EQ(parts, (std::vector<std::uint32_t>{2, 2, 3}));
    EXPECT_EQ(ledger.enter(command(3)).report.outcome, Outcome::failed);
    EXPECT_EQ(ledger.enter(command(1)).report.outcome, Outcome::confirmed);
    ledger.clear();
    EXPECT_EQ(ledger.enter(command(1)).entered, Entered::fresh);
}

}  // namespace
}  // namespace hord::hal
