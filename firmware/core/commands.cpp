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

std::string possible_commands_text(State state, bool (*offered)(Command)) {
    const auto next = next_command(state);
    std::string text = "the station is " + std::string(name_of(state)) + ": ";
    std::string others;
    for (const Command command : kValuesOf<Command>) {
        if (command == next || !is_possible(state, command) || (offered != nullptr && !offered(command))) continue;
        others += (others.empty() ? "" : ", ") + std::string(name_of(command));
    }
    if (!next) return text + "possible are " + others;
    text += "next is " + std::string(name_of(*next));
    return others.empty() ? text : text + "; possible are also " + others;
}

}  // namespace hord::firmware
