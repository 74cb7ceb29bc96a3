// The commands of people and PLCs: the only list of their numbers and names.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace hord::firmware {

// A value is the command's code in the registers: once released, it keeps its meaning. In brackets: the method of
// OPC 40100-1.
enum class Command : std::uint16_t {
    // Of the state machine; core/states.h lists the states that allow each.
    initialise = 1,        // opens the devices
    arm = 2,               // [PrepareRecipe] refused while a device is down
    disarm = 3,            // [UnprepareRecipe]
    start_single = 4,      // [StartSingleJob] inspects the next part, then Ready
    start_continuous = 5,  // [StartContinuous]
    stop = 6,              // [Stop] inspects no new part; Ready when the last inspected one is past the ejector
    abort = 7,             // [Abort] Ready at once; parts under way are rejected
    halt = 8,              // [Halt] closes the devices; lights and run permit are off
    reset = 9,  // [Reset] after an error (a person has looked at the line) or halt; opens absent devices again
    // Of the command handler (firmware/plc/command_handler.h); the core answers not_in_this_state.
    commit_recipe = 20,  // argument: staged_crc32
    teach = 21,          // argument: number of parts, 0: 16; result: parts taken, at the end the new recipe's CRC-32
    self_test = 22,      // result: FaultBits of what failed
    use_recipe = 23,     // argument: the recipe's number; argument2: its CRC-32, 0: any; result: its CRC-32
};

constexpr std::string_view name_of(Command command) {
    switch (command) {
        case Command::initialise: return "initialise";
        case Command::arm: return "arm";
        case Command::disarm: return "disarm";
        case Command::start_single: return "start_single";
        case Command::start_continuous: return "start_continuous";
        case Command::stop: return "stop";
        case Command::abort: return "abort";
        case Command::halt: return "halt";
        case Command::reset: return "reset";
        case Command::commit_recipe: return "commit_recipe";
        case Command::teach: return "teach";
        case Command::self_test: return "self_test";
        case Command::use_recipe: return "use_recipe";
    }
    return "unknown";
}

constexpr bool is_state_command(Command command) { return command >= Command::initialise && command <= Command::reset; }

// The name in messages to people: "start-continuous".
std::string hyphenated_name_of(Command command);

// Parses a name typed by a person: "start_continuous" or "start-continuous". Empty: no such command.
std::optional<Command> command_named(std::string_view name);

}  // namespace hord::firmware
