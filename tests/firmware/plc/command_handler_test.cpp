// A PLC commands the station through its registers: executed once, and the reply shows the outcome.
#include "firmware/plc/command_handler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/diagnostics/inspection_self_test.h"
#include "tests/firmware/plc/plc_commands.h"

namespace hord::firmware {
namespace {

using modbus::Exception;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using State = firmware::State;

TEST_F(PlcCommands, lead_the_station_from_power_up_to_execution_and_back) {
    open();
    EXPECT_EQ(state(), State::preoperational);
    EXPECT_EQ(command(Command::initialise), CommandError::none);
    EXPECT_EQ(state(), State::initialized);
    EXPECT_EQ(command(Command::arm), CommandError::device_down);
    devices_up();
    EXPECT_EQ(state(), State::initialized);  // nothing starts by itself
    EXPECT_EQ(command(Command::arm), CommandError::none);
    EXPECT_EQ(command(Command::start_continuous), CommandError::none);
    EXPECT_EQ(state(), State::continuous_execution);
    EXPECT_EQ(rejector.permits, std::vector<bool>{true});
    EXPECT_EQ(command(Command::arm), CommandError::not_in_this_state);
    EXPECT_EQ(command(Command::stop), CommandError::none);
    EXPECT_EQ(state(), State::ready);
    EXPECT_EQ(command(Command::disarm), CommandError::none);
    EXPECT_EQ(command(Command::halt), CommandError::none);
    EXPECT_EQ(state(), State::halted);
    EXPECT_EQ(command(Command::reset), CommandError::none);
    EXPECT_EQ(state(), State::preoperational);
    EXPECT_EQ(command(Command{99}), CommandError::unknown_command);
    EXPECT_EQ(command(Command::teach), CommandError::not_supported);
    EXPECT_EQ(read32(8029), 11U);  // commands done
    EXPECT_EQ(std::count_if(notes.changes.begin(), notes.changes.end(),
                            [](const Change& c) { return c.what == Change::What::command; }),
              11)
        << "each is recorded, those that were refused, too";
}

TEST_F(PlcCommands, a_halt_stops_the_line_only_for_a_part_that_did_not_pass) {
    open();
    const auto line_stop = [&] { return (read(103, 1)[0] & 4U) != 0; };
    for (const bool passed : {false, true}) {
        edges = 0;  // the part sensor counts from its start
        running();
        part();
        if (passed) light_and_frame();
        EXPECT_FALSE(line_stop());
        EXPECT_EQ(command(Command::halt), CommandError::none);
        EXPECT_EQ(line_stop(), !passed);
        pass(milliseconds(2000));
        EXPECT_EQ(line_stop(), !passed);
        EXPECT_EQ(command(Command::reset), CommandError::none);
    }
}

TEST_F(PlcCommands, a_repeated_start_does_not_start_again) {
    open();
    ready();
    const std::uint32_t start = ++token;
    EXPECT_EQ(send(start, Command::start_continuous), Exception::none);
    EXPECT_EQ(command(Command::stop), CommandError::none);
    EXPECT_EQ(send(start, Command::start_continuous), Exception::none);  // its first reply was lost
    EXPECT_EQ(state(), State::ready);
    EXPECT_EQ(read32(8022), start);
    EXPECT_EQ(reply_state(), CommandState::completed);
}

TEST_F(PlcCommands, a_refused_start_is_not_made_up_for_after_a_reset) {
    open();
    running();
    sensor.listener->on_sensor_lost({ErrorCode::disconnected, "/dev/video0", "plug it in"});
    publish();
    EXPECT_EQ(state(), State::error);
    EXPECT_EQ(command(Command::start_continuous), CommandError::not_in_this_state);
    EXPECT_EQ(command(Command::reset), CommandError::none);
    EXPECT_EQ(state(), State::initialized);
}

TEST_F(PlcCommands, a_single_shot_inspects_one_part) {
    open();
    ready();
    EXPECT_EQ(command(Command::start_single), CommandError::none);
    part();
    light_and_frame();
    publish();
    EXPECT_EQ(read32(106), 1U);      // last sequence
    EXPECT_EQ(read(210, 1)[0], 1U);  // pass
    loop.run_for(std::chrono::seconds(1));
    publish();
    EXPECT_EQ(state(), State::ready);
    part();
    loop.run_for(std::chrono::seconds(1));
    publish();
    EXPECT_EQ(sensor.requests.size(), 1U);
    EXPECT_EQ(read32(146), 1U);  // passed
}

TEST_F(PlcCommands, a_result_says_where_the_worst_defect_is_and_which_recipe_judged) {
    open();
    inspector.answer = {0, false, algo::Verdict::reject, algo::Reason::deflection_gradient, 2, 1.5F, 17, 42};
    running();
    part();
    light_and_frame();
    loop.run_for(milliseconds(360));
    rejector.listener->on_reject({1, hal::RejectReport::Outcome::confirmed, loop.now()});
    publish();
    EXPECT_THAT(read(220, 3), ElementsAre(17, 42, 0));
    notes.answer = AckStatus::not_yet;
    EXPECT_EQ(write(8103, {0, 1}), Exception::busy);
    notes.answer = AckStatus::failed;
    EXPECT_EQ(write(8103, {0, 1}), Exception::device_failure);
    EXPECT_EQ(notes.acknowledged.size(), 0U);
    notes.answer = AckStatus::recorded;
    EXPECT_EQ(write(8103, {0, 1}), Exception::none);
    EXPECT_THAT(notes.acknowledged, ElementsAre(1U));
}

// -- recipes by number

TEST_F(PlcCommands, a_refused_argument_is_told_with_its_range) {
    open();
    ready();
    EXPECT_EQ(command(Command::use_recipe, 0xFFFF), CommandError::bad_argument);
    EXPECT_EQ(remarks(), "argument (8006): no recipe has number 65535: use 0 to 65534");
    EXPECT_EQ(command(Command::use_recipe, 8), CommandError::no_such_recipe);
    EXPECT_EQ(remarks(), "no recipe 7: make one");
    EXPECT_EQ(write(8002, {0, 999, 0, static_cast<std::uint16_t>(Command::use_recipe)}), Exception::none);
    EXPECT_EQ(remarks(), "argument (8006) was left out: write it with the code");
}

TEST_F(PlcCommands, change_no_recipe_while_the_station_executes) {
    open();
    running();
    EXPECT_EQ(write(8202, {12, 800}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::not_in_this_state);
    EXPECT_EQ(command(Command::use_recipe, 7), CommandError::not_in_this_state);
    EXPECT_EQ(command(Command::use_recipe, 8), CommandError::not_in_this_state) << "no recipe has this number";
    EXPECT_EQ(operations.recipe().number, 3);
}

TEST_F(PlcCommands, switch_to_a_recipe_by_number_and_by_its_checksum) {
    open();
    ready();
    EXPECT_EQ(command(Command::use_recipe, 8), CommandError::no_such_recipe);
    EXPECT_EQ(command(Command::use_recipe, 7, 0xBAD), CommandError::wrong_checksum);
    const std::uint32_t crc = read32(8027);  // the correct checksum
    EXPECT_EQ(operations.recipe().number, 3);
    EXPECT_EQ(command(Command::use_recipe, 7, crc), CommandError::none);
    EXPECT_EQ(operations.recipe().recipe.name, "seven");
    EXPECT_EQ(read(8203, 1)[0], 750);  // the staged value
}

TEST_F(PlcCommands, a_recipe_that_a_restart_would_not_use_is_not_taken) {
    open();
    ready();
    const auto in_use = crc32_of(operations.recipe());
    const std::size_t recorded = notes.changes.size();
    for (const ErrorCode code :
         {ErrorCode::io, ErrorCode::refused, ErrorCode::not_found}) {  // as write_durably() fails
        disk = fail(code, "/var/lib/hord/recipe-in-use.toml cannot be written: No space left on device", "make room");
        EXPECT_EQ(command(Command::use_recipe, 7), CommandError::failed);
        EXPECT_EQ(remarks(), disk.error().message());
        EXPECT_EQ(write(8203, {800}), Exception::none);
        EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::failed);
        EXPECT_EQ(remarks(), disk.error().message());
        EXPECT_EQ(crc32_of(operations.recipe()), in_use);
        EXPECT_EQ(inspector.number, 3) << "the old recipe judges";
        EXPECT_EQ(kept, -1);
    }
    for (std::size_t k = recorded; k < notes.changes.size(); ++k)
        EXPECT_EQ(notes.changes[k].what, Change::What::command) << "no recipe was changed";
    disk = {};
    EXPECT_EQ(command(Command::use_recipe, 7), CommandError::none);
    EXPECT_EQ(kept, 7);
    EXPECT_EQ(inspector.number, 7);
}

// -- outside faults

TEST_F(PlcCommands, a_store_that_fails_is_a_fault_and_the_station_goes_on_judging) {
    open();
    running();
    station->outside_faults(kFaultStore);
    publish();
    EXPECT_EQ(state(), State::continuous_execution);
    EXPECT_EQ(read32(113), std::uint32_t{kFaultStore});
    EXPECT_EQ(read(117, 1)[0], 11);
    part();
    light_and_frame();
    loop.run_for(std::chrono::seconds(1));
    publish();
    EXPECT_EQ(read32(146), 1U);  // passed
    station->outside_faults(0);
    publish();
    EXPECT_EQ(read32(113), 0U);
    EXPECT_EQ(read32(115), std::uint32_t{kFaultStore});  // until a reset
}

// -- heartbeat

TEST_F(PlcCommands, a_silent_plc_stops_the_station_which_waits_for_a_new_start) {
    open(PlcPolicy::stop);
    running();
    pass(milliseconds(2000));
    EXPECT_EQ(state(), State::continuous_execution);  // no PLC heartbeat yet
    beat();
    pass(milliseconds(450));
    EXPECT_EQ(state(), State::continuous_execution);
    pass(milliseconds(200));
    EXPECT_EQ(state(), State::ready);
    EXPECT_EQ(rejector.permits.back(), false);
    EXPECT_EQ(read32(113) & kFaultPlc, kFaultPlc);
    EXPECT_EQ(read(103, 1)[0] & 0x80U, 0x80U);
    EXPECT_EQ(command(Command::start_continuous), CommandError::plc_lost);
    beat();
    publish();
    EXPECT_EQ(state(), State::ready);
    EXPECT_EQ(read32(113) & kFaultPlc, 0U);
    EXPECT_EQ(read32(115) & kFaultPlc, kFaultPlc);  // until a reset
    EXPECT_EQ(command(Command::start_continuous), CommandError::none);
}

TEST_F(PlcCommands, without_a_plc_every_part_is_rejected_until_it_is_back) {
    open(PlcPolicy::reject_all);
    running();
    beat();
    hal::TimePoint part_sensor_saw{};
    const auto is_rejected_without_plc = [&](std::uint32_t number) {
        pass(part_sensor_saw + milliseconds(400) - loop.now());  // at the ejector
        EXPECT_EQ(rejector.commands.back().part, number);
        rejector.listener->on_reject({number, hal::RejectReport::Outcome::confirmed, loop.now()});
        publish();
        EXPECT_EQ(read(211, 1)[0], static_cast<std::uint16_t>(PartReason::plc_lost));
    };
    pass(milliseconds(500));
    part_sensor_saw = loop.now();
    part();  // its verdict is not known when the PLC is lost
    pass(milliseconds(50));
    is_rejected_without_plc(1);
    part_sensor_saw = loop.now();
    part();
    EXPECT_EQ(sensor.requests.size(), 1U);  // no frame is requested
    is_rejected_without_plc(2);
    EXPECT_EQ(state(), State::continuous_execution);
    EXPECT_EQ(read32(146), 0U);  // none passed
    beat();
    part();
    light_and_frame();
    publish();
    EXPECT_EQ(read32(146), 1U);
}

TEST_F(PlcCommands, with_policy_none_a_silent_plc_is_shown_and_changes_nothing) {
    open(PlcPolicy::none);
    running();
    beat();
    pass(milliseconds(2000));
    EXPECT_EQ(state(), State::continuous_execution);
    EXPECT_EQ(read(103, 1)[0] & 0x80U, 0x80U);
    EXPECT_EQ(read32(113), 0U);
}

// -- self-test

class SelfTest : public PlcCommands {
  protected:
    // Answers the current test as the devices would.
    void devices_answer(bool lit = true, bool frame = true) {
        loop.run_for(milliseconds(6));
        const auto pulse = strobe.pulses.back();
        if (frame) sensor.deliver(sensor.requests.back().start);
        strobe.listener->on_strobe({pulse.exposure, lit, pulse.start, pulse.width});
        loop.run_for(std::chrono::seconds(3));
    }
};

TEST_F(SelfTest, flashes_looks_and_judges_and_no_part_is_counted) {
    open();
    ready();
    EXPECT_EQ(command(Command::self_test), CommandError::none);
    EXPECT_EQ(reply_state(), CommandState::executing);
    EXPECT_EQ(send(++token, Command::start_continuous), Exception::busy);
    devices_answer();
    EXPECT_EQ(reply_state(), CommandState::completed);
    EXPECT_EQ(read32(8027), 0U);
    EXPECT_EQ(station->snapshot().counters.seen, 0U);
    EXPECT_EQ(sensor.given_back, 1);
    EXPECT_EQ(command(Command::start_continuous), CommandError::none);
}

TEST_F(SelfTest, names_what_is_wrong) {
    open();
    ready();
    const auto found = [&](bool lit, bool frame) {
        EXPECT_EQ(command(Command::self_test), CommandError::none);
        devices_answer(lit, frame);
        EXPECT_EQ(reply_state(), CommandState::failed);
        return read32(8027);
    };
    EXPECT_EQ(found(false, true), std::uint32_t{kFaultStrobe});
    EXPECT_EQ(found(true, false), std::uint32_t{kFaultSensor});
    inspector.answer.reason = algo::Reason::too_dark;
    EXPECT_EQ(found(true, true), std::uint32_t{kFaultLightLevel});
    inspector.answer.reason = algo::Reason::none;
    inspector.answer.failed = true;
    EXPECT_EQ(found(true, true), std::uint32_t{kFaultInspector});
    inspector.answer.failed = false;
    judgement = fail(ErrorCode::internal, "a drawn bad part was judged pass", "");
    EXPECT_EQ(found(true, true), std::uint32_t{kFaultInspector});
    EXPECT_THAT(troubles.back(), HasSubstr("inspector"));
}

TEST_F(SelfTest, is_refused_while_executing_and_with_a_device_down) {
    open();
    EXPECT_EQ(command(Command::self_test), CommandError::not_in_this_state);
    EXPECT_EQ(command(Command::initialise), CommandError::none);
    EXPECT_EQ(command(Command::self_test), CommandError::device_down);
    EXPECT_EQ(read32(8027), std::uint32_t{kFaultRejector});
    devices_up();
    EXPECT_EQ(command(Command::arm), CommandError::none);
    EXPECT_EQ(command(Command::start_continuous), CommandError::none);
    EXPECT_EQ(command(Command::self_test), CommandError::not_in_this_state);
}

TEST_F(SelfTest, that_is_cut_off_by_a_halt_fails) {
    open();
    ready();
    EXPECT_EQ(command(Command::self_test), CommandError::none);
    const std::uint32_t test = token;
    EXPECT_EQ(command(Command::halt), CommandError::none);
    loop.run_for(std::chrono::seconds(3));
    EXPECT_EQ(send(test, Command::self_test), Exception::none);  // the repeated token returns the outcome
    EXPECT_EQ(reply_state(), CommandState::failed);
}

TEST(JudgementCheck, tells_good_from_bad_at_every_number_of_bins) {
    for (int bins = 3; bins <= 15; ++bins) {
        const auto checked = check_judgement(bins, bins, 8);
        EXPECT_TRUE(checked) << bins << " bins: " << checked.error().message();
    }
    EXPECT_TRUE(check_judgement(9, 5, 12));
}

}  // namespace
}  // namespace hord::firmware
