#include "firmware/core/commands.h"

#include <algorithm>

#include "firmware/core/enum_values.h"
#include "firmware/core/states.h"

namespace hord::firmware {

std::string hyphenated_name_of(Command command) {
    std::string name(name_of(command));
    std::replace(name.begin(), name.end(), '_', '-');
    return name;
}

std::optional<Command> command_named(std::string_view name) {
    for (const Command command : kValuesOf<Command>) {
        if (name == name_of(command) || name == hyphenated_name_of(command)) return command;
    }
    return std::nullopt;
}

std::string possible_commands_text(State state) {
    const auto next = next_command(state);
    std::string text = "the station is " + std::string(name_of(state)) + ": ";
    if (next) text += "next is " + std::string(name_of(*next)) + "; possible are also ";
    else text += "possible are ";
    const char* comma = "";
    for (const Command command : kValuesOf<Command>) {
        if (command == next || !is_possible(state, command)) continue;
        text += comma + std::string(name_of(command));
        comma = ", ";
    }
    return text;
}

}  // namespace hord::firmware
