// Every state with every event: first what must be refused, then what must pass.
#include <map>
#include <set>
#include <string>

#include "tests/firmware/core/core_rig.h"

namespace hord::firmware {
namespace {

constexpr State kStates[] = {State::preoperational,       State::initialized, State::ready, State::single_execution,
                             State::continuous_execution, State::error,       State::halted};
constexpr Command kCommands[] = {
    Command::initialise, Command::arm,   Command::disarm, Command::start_single, Command::start_continuous,
    Command::stop,       Command::abort, Command::halt,   Command::reset};
// Written down by hand from OPC 40100-1, not taken from the transition table under test. With an empty line, stop is
// finished at once.
const std::map<std::pair<State, Command>, State> kMustPass = {
    {{State::preoperational, Command::initialise}, State::initialized},
    {{State::preoperational, Command::halt}, State::halted},
    {{State::initialized, Command::arm}, State::ready},
    {{State::initialized, Command::reset}, State::initialized},
    {{State::initialized, Command::halt}, State::halted},
    {{State::ready, Command::disarm}, State::initialized},
    {{State::ready, Command::start_single}, State::single_execution},
    {{State::ready, Command::start_continuous}, State::continuous_execution},
    {{State::ready, Command::halt}, State::halted},
    {{State::single_execution, Command::stop}, State::ready},
    {{State::single_execution, Command::abort}, State::ready},
    {{State::single_execution, Command::halt}, State::halted},
    {{State::continuous_execution, Command::stop}, State::ready},
    {{State::continuous_execution, Command::abort}, State::ready},
    {{State::continuous_execution, Command::halt}, State::halted},
    {{State::error, Command::reset}, State::initialized},
    {{State::error, Command::halt}, State::halted},
    {{State::halted, Command::reset}, State::preoperational},
};

TEST(States, commands_that_must_fail_change_nothing) {
    int refused = 0;
    for (const State state : kStates) {
        for (const Command command : kCommands) {
            if (kMustPass.contains({state, command})) continue;
            CoreRig rig;
            rig.bring_to(state);
            const Snapshot before = rig.shot();
            EXPECT_EQ(rig.send(command), Answer::not_in_this_state) << name_of(state) << " " << name_of(command);
            EXPECT_EQ(rig.core.state(), state) << name_of(command);
            EXPECT_EQ(rig.actions.size(), 0U);
            EXPECT_EQ(rig.shot().faults_latched, before.faults_latched);
            EXPECT_EQ(rig.shot().run_permit, before.run_permit);
            ++refused;
        }
    }
    EXPECT_EQ(refused, 7 * 9 - 18);
}

TEST(States, commands_that_must_pass_lead_where_the_standard_says) {
    for (const auto& [pair, to] : kMustPass) {
        CoreRig rig;
        rig.bring_to(pair.first);
        EXPECT_EQ(rig.send(pair.second), Answer::done);
        EXPECT_EQ(rig.core.state(), to) << name_of(pair.first) << " " << name_of(pair.second);
    }
}

TEST(States, the_next_command_of_each_state_leads_to_the_line_running) {
    for (const State start : kStates) {
        State state = start;
        int steps = 0;
        for (auto next = next_command(state); next; next = next_command(state)) {
            ASSERT_TRUE(is_possible(state, *next)) << name_of(state);
            CoreRig rig;
            rig.bring_to(state);
            ASSERT_EQ(rig.send(*next), Answer::done) << name_of(state) << " " << name_of(*next);
            state = rig.core.state();
            ASSERT_LT(++steps, 5) << name_of(start);
        }
        EXPECT_TRUE(executing(state)) << name_of(start);
    }
}

TEST(States, people_are_told_the_next_command_and_the_other_possible_ones) {
    EXPECT_EQ(possible_commands_text(State::halted),
              "the station is Halted: next is reset; possible are also commit_recipe, use_recipe");
    EXPECT_EQ(possible_commands_text(State::continuous_execution),
              "the station is ContinuousExecution: possible are stop, abort, halt, teach");
}

TEST(States, the_table_has_no_pair_twice) {
    std::set<std::pair<State, Cause>> seen;
    for (const Transition& t : kTransitions) EXPECT_TRUE(seen.emplace(t.from, t.cause).second) << name_of(t.from);
}

// The other events, in every state. An event that belongs to no part and no running device changes no state.
// Exceptions: a lost device is an error while the station is ready or executing, and a part while the line has no
// permit.
TEST(States, events_change_the_state_only_where_a_device_is_lost_or_a_part_is_at_the_sensor) {
    const auto start = TimePoint(std::chrono::seconds(100));
    const std::vector<std::pair<const char*, Event>> events = {
        {"tick", Tick{}},
        {"edge arrives", hal::PartEdge{hal::PartEdge::Kind::arrives, start, 1, {}}},
        {"edge leaves", hal::PartEdge{hal::PartEdge::Kind::leaves, start, 1, {}}},
        {"encoder", hal::EncoderReading{start, 5}},
        {"frame", FrameArrived{1, {1, start, 1000, false}}},
        {"strobe report", hal::StrobeReport{1, true, start, microseconds(200)}},
        {"judged", Judged{1, false, algo::Verdict::pass, algo::Reason::none, 0, 0}},
        {"reject report", hal::RejectReport{1, hal::RejectReport::Outcome::failed, start}},
        {"up: part sensor", DeviceUp{Device::part_sensor}},
        {"up: strobe", DeviceUp{Device::strobe}},
        {"up: sensor", DeviceUp{Device::sensor}},
        {"up: rejector", DeviceUp{Device::rejector}},
        {"lost: part sensor", DeviceLost{Device::part_sensor}},
        {"lost: strobe", DeviceLost{Device::strobe}},
        {"lost: sensor", DeviceLost{Device::sensor}},
        {"lost: rejector", DeviceLost{Device::rejector}},
        {"trigger refused", TriggerRefused{1}},
        {"strobe refused", StrobeRefused{1}},
        {"inspect refused", InspectRefused{1}},
        {"reject refused", RejectRefused{1}},
        {"PLC lost", PlcLost{}},
        {"PLC back", PlcBack{}},
        {"outside faults", OutsideFaults{kFaultStore}},
    };
    for (const State state : kStates) {
        for (const auto& [name, event] : events) {
            CoreRig rig;
            rig.bring_to(state);
            rig.send(event);
            const bool operational = state == State::ready || executing(state);
            const auto* edge = std::get_if<hal::PartEdge>(&event);
            const bool part_was_there = edge != nullptr &&
                edge->kind == hal::PartEdge::Kind::leaves &&  // the first edge of all
                state != State::preoperational && state != State::halted;
            const bool part_comes = edge != nullptr && edge->kind == hal::PartEdge::Kind::arrives &&
                !executing(state) && state != State::halted;
            const bool device_lost = operational && std::holds_alternative<DeviceLost>(event);
            const State expected = part_was_there || part_comes || device_lost ? State::error : state;
            EXPECT_EQ(rig.core.state(), expected) << name_of(state) << ", " << name;
            EXPECT_TRUE(rig.rejects.empty()) << name_of(state) << ", " << name;
            EXPECT_TRUE(rig.inspections.empty()) << name_of(state) << ", " << name;
            EXPECT_EQ(rig.exposures.size(), executing(state) && std::string_view(name) == "edge arrives" ? 1U : 0U)
                << name_of(state) << ", " << name;
            if (std::holds_alternative<FrameArrived>(event)) {
                EXPECT_EQ(rig.released.size(), 1U) << name_of(state);
            }
        }
    }
}

TEST(States, initialise_opens_every_device_and_halt_closes_them) {
    CoreRig rig;
    rig.send(Command::initialise);
    EXPECT_EQ(rig.starts.size(), 4U);
    rig.send(Command::halt);
    EXPECT_EQ(rig.stops, 1);
}

TEST(States, arm_is_refused_until_every_device_is_up) {
    for (int k = 0; k < 2 * kDevices; ++k) {
        const int missing = k % kDevices;
        CoreRig rig;
        if (k >= kDevices) {  // all were up before a halt
            rig.bring_to(State::ready);
            rig.send(Command::halt);
            rig.send(Command::reset);
        }
        rig.send(Command::initialise);
        for (int d = 0; d < kDevices; ++d) {
            if (d != missing) rig.send(DeviceUp{static_cast<Device>(d)});
        }
        EXPECT_EQ(rig.send(Command::arm), Answer::device_down);
        EXPECT_EQ(rig.core.state(), State::initialized);
        EXPECT_NE(rig.shot().faults_active, 0U);
        rig.send(DeviceUp{static_cast<Device>(missing)});
        EXPECT_EQ(rig.shot().faults_active, 0U);
        EXPECT_EQ(rig.send(Command::arm), Answer::done);
    }
}

TEST(States, the_line_may_run_only_while_executing) {
    CoreRig rig;
    rig.bring_to(State::ready);
    EXPECT_FALSE(rig.shot().run_permit);
    rig.send(Command::start_continuous);
    EXPECT_EQ(rig.permits, std::vector<bool>{true});
    rig.send(Command::stop);
    EXPECT_EQ(rig.permits, (std::vector<bool>{true, false}));
}

TEST(States, a_lost_device_is_opened_again_by_reset_and_its_fault_stays_latched_until_then) {
    CoreRig rig;
    rig.bring_to(State::continuous_execution);
    rig.send(DeviceLost{Device::strobe});
    EXPECT_EQ(rig.core.state(), State::error);
    EXPECT_EQ(rig.permits, std::vector<bool>{false});
    EXPECT_EQ(rig.shot().first_fault, 2);  // kFaultStrobe is bit 1
    rig.send(Command::reset);
    EXPECT_EQ(rig.starts, std::vector<Device>{Device::strobe});
    EXPECT_EQ(rig.shot().faults_latched, std::uint32_t{kFaultStrobe});  // the strobe is still down
    rig.send(DeviceUp{Device::strobe});
    EXPECT_EQ(rig.shot().faults_active, 0U);
    EXPECT_EQ(rig.shot().faults_latched, std::uint32_t{kFaultStrobe});
    EXPECT_EQ(rig.send(Command::arm), Answer::done);
}

TEST(States, the_first_fault_is_kept_when_others_follow) {
    CoreRig rig;
    rig.bring_to(State::continuous_execution);
    rig.send(DeviceLost{Device::sensor});
    rig.send(DeviceLost{Device::part_sensor});
    EXPECT_EQ(rig.shot().faults_latched, kFaultSensor | kFaultPartSensor);
    EXPECT_EQ(rig.shot().first_fault, 3);  // kFaultSensor is bit 2
}

TEST(States, the_heartbeat_beats_by_time_alone) {
    CoreConfig config = quick_line();
    config.station_heartbeat = milliseconds(500);
    CoreRig rig(config);
    rig.send(Tick{});
    rig.advance(milliseconds(2600));
    EXPECT_EQ(rig.shot().station_heartbeat, 5);
}

TEST(ActionsDeathTest, an_action_without_room_ends_the_process) {
    Actions actions;
    for (std::size_t k = 0; k < Actions::kCapacity; ++k) actions.push(StopDevices{});
    EXPECT_EQ(actions.room(), 0U);
    EXPECT_EXIT(actions.push(StopDevices{}), ::testing::KilledBySignal(SIGABRT), "");
}

}  // namespace
}  // namespace hord::firmware
