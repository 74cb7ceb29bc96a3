// The station's states (OPC 40100-1) and every way from one to another.
#pragma once

#include <array>
#include <optional>

#include "firmware/core/events.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

// What moves the state machine: the commands, and three things the core finds out by itself.
enum class Cause : std::uint8_t {
    initialise,
    arm,
    disarm,
    start_single,
    start_continuous,
    stop,
    abort,
    halt,
    reset,      // in Command's order
    finished,   // the single part, or the last one of a stop, is past the ejector
    fault,      // a device was lost, or failed too many parts in a row, in Ready or while executing
    line_stop,  // a rejection could not be confirmed, or parts are on the line that nobody knows
};
constexpr int kCauses = 12;
constexpr Cause cause_of(Command command) { return static_cast<Cause>(command); }

struct Transition {
    State from;
    Cause cause;
    State to;
};

// Whatever is not here is refused (commands) or changes nothing (the core's own causes).
constexpr std::array kTransitions{
    Transition{State::preoperational, Cause::initialise, State::initialized},
    Transition{State::preoperational, Cause::halt, State::halted},
    Transition{State::preoperational, Cause::line_stop, State::error},

    Transition{State::initialized, Cause::arm, State::ready},
    Transition{State::initialized, Cause::reset, State::initialized},  // looks for absent devices again
    Transition{State::initialized, Cause::halt, State::halted},
    Transition{State::initialized, Cause::line_stop, State::error},

    Transition{State::ready, Cause::disarm, State::initialized},
    Transition{State::ready, Cause::start_single, State::single_execution},
    Transition{State::ready, Cause::start_continuous, State::continuous_execution},
    Transition{State::ready, Cause::halt, State::halted},
    Transition{State::ready, Cause::fault, State::error},
    Transition{State::ready, Cause::line_stop, State::error},

    Transition{State::single_execution, Cause::stop, State::single_execution},  // drains
    Transition{State::single_execution, Cause::abort, State::ready},
    Transition{State::single_execution, Cause::finished, State::ready},
    Transition{State::single_execution, Cause::halt, State::halted},
    Transition{State::single_execution, Cause::fault, State::error},
    Transition{State::single_execution, Cause::line_stop, State::error},

    Transition{State::continuous_execution, Cause::stop, State::continuous_execution},  // drains
    Transition{State::continuous_execution, Cause::abort, State::ready},
    Transition{State::continuous_execution, Cause::finished, State::ready},
    Transition{State::continuous_execution, Cause::halt, State::halted},
    Transition{State::continuous_execution, Cause::fault, State::error},
    Transition{State::continuous_execution, Cause::line_stop, State::error},

    Transition{State::error, Cause::reset, State::initialized},
    Transition{State::error, Cause::halt, State::halted},

    Transition{State::halted, Cause::reset, State::preoperational},
};

constexpr std::optional<State> next_state(State from, Cause cause) {
    for (const Transition& t : kTransitions) {
        if (t.from == from && t.cause == cause) return t.to;
    }
    return std::nullopt;
}

constexpr bool executing(State s) { return s == State::single_execution || s == State::continuous_execution; }

}  // namespace hord::firmware
