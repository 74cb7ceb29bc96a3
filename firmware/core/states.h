// The state machine (OPC 40100-1): every transition.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <variant>

#include "firmware/core/events.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

// Conditions that the core detects by itself and that cause a transition.
enum class Trigger : std::uint8_t {
    finished,   // the single part, or the last one of a stop, is past the ejector
    fault,      // a device was lost, or too many parts in a row failed, in Ready or while executing
    line_stop,  // a rejection ended failed or late, or parts are on the line that are not tracked
};
using Cause = std::variant<Command, Trigger>;

struct Transition {
    State from;
    Cause cause;
    State to;
};

// A command that is not listed for a state is refused; a trigger that is not listed changes nothing.
constexpr std::array kTransitions{
    Transition{State::preoperational, Command::initialise, State::initialized},
    Transition{State::preoperational, Command::halt, State::halted},
    Transition{State::preoperational, Trigger::line_stop, State::error},

    Transition{State::initialized, Command::arm, State::ready},
    Transition{State::initialized, Command::reset, State::initialized},  // looks for absent devices again
    Transition{State::initialized, Command::halt, State::halted},
    Transition{State::initialized, Trigger::line_stop, State::error},

    Transition{State::ready, Command::disarm, State::initialized},
    Transition{State::ready, Command::start_single, State::single_execution},
    Transition{State::ready, Command::start_continuous, State::continuous_execution},
    Transition{State::ready, Command::halt, State::halted},
    Transition{State::ready, Trigger::fault, State::error},
    Transition{State::ready, Trigger::line_stop, State::error},

    Transition{State::single_execution, Command::stop, State::single_execution},  // drains
    Transition{State::single_execution, Command::abort, State::ready},
    Transition{State::single_execution, Trigger::finished, State::ready},
    Transition{State::single_execution, Command::halt, State::halted},
    Transition{State::single_execution, Trigger::fault, State::error},
    Transition{State::single_execution, Trigger::line_stop, State::error},

    Transition{State::continuous_execution, Command::stop, State::continuous_execution},  // drains
    Transition{State::continuous_execution, Command::abort, State::ready},
    Transition{State::continuous_execution, Trigger::finished, State::ready},
    Transition{State::continuous_execution, Command::halt, State::halted},
    Transition{State::continuous_execution, Trigger::fault, State::error},
    Transition{State::continuous_execution, Trigger::line_stop, State::error},

    Transition{State::error, Command::reset, State::initialized},
    Transition{State::error, Command::halt, State::halted},

    Transition{State::halted, Command::reset, State::preoperational},
};

constexpr std::optional<State> next_state(State from, Cause cause) {
    for (const Transition& t : kTransitions) {
        if (t.from == from && t.cause == cause) return t.to;
    }
    return std::nullopt;
}

constexpr bool executing(State s) { return s == State::single_execution || s == State::continuous_execution; }

// Whether the state allows the command. A device that is down, a lost PLC or parts on the line may still refuse it.
constexpr bool is_possible(State state, Command command) {
    if (is_state_command(command)) return next_state(state, command).has_value();
    const bool open = state == State::initialized || state == State::ready;
    switch (command) {
        case Command::commit_recipe:
        case Command::use_recipe: return !executing(state);
        case Command::self_test: return open;
        case Command::teach: return open || executing(state);
        default: return false;
    }
}

// The command that brings the station nearer to inspecting every part; none while it executes.
constexpr std::optional<Command> next_command(State state) {
    switch (state) {
        case State::preoperational: return Command::initialise;
        case State::initialized: return Command::arm;
        case State::ready: return Command::start_continuous;
        case State::error:
        case State::halted: return Command::reset;
        case State::single_execution:
        case State::continuous_execution: break;
    }
    return std::nullopt;
}

// For people: "the station is Halted: next is reset; possible are also commit_recipe, use_recipe". `offered`: names
// only those that the asking program sends; null: all.
std::string possible_commands_text(State state, bool (*offered)(Command) = nullptr);

}  // namespace hord::firmware
