#include "firmware/core/commands.h"

#include <algorithm>

#include "firmware/core/enum_values.h"

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

}  // namespace hord::firmware
