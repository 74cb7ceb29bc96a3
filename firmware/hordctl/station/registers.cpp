// hordctl registers: the register map, printed from the table that the station serves.
#include "common/cli/output.h"
#include "firmware/hordctl/commands.h"
#include "firmware/registers/register_map.h"

namespace hord::firmware {

void add_registers(CLI::App& program, Exit& /*status*/) {
    auto* command = program.add_subcommand("registers", "Print the Modbus register map");
    auto format = std::make_shared<std::string>("md");
    command->add_option("--format", *format, "Of the map")
        ->check(CLI::IsMember({"md", "csv", "json", "st", "telegraf"}))
        ->capture_default_str();
    command->footer("Example: hordctl registers --format csv > registers.csv");
    command->callback([format] { print_output(format_registers(*format)); });
}

}  // namespace hord::firmware
