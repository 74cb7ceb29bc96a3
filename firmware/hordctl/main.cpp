// hordctl: the station's tool for people.
#include <algorithm>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include "firmware/core/commands.h"
#include "firmware/core/enum_values.h"
#include "firmware/hordctl/commands.h"
#include "firmware/service/early_signals.h"

namespace {

// Commands that hord-lab has now.
constexpr std::string_view kMovedToLab[] = {"experiment", "soak", "scene", "render"};

// How a station is told `word`, a command of the PLC or its beginning. Empty: it is none.
std::string station_command_for(std::string_view word) {
    using namespace hord::firmware;
    std::string names;
    for (const Command command : kValuesOf<Command>) {
        const std::string_view name = name_of(command);
        if (command == Command::teach || (name != word && !name.starts_with(std::string(word) + "_"))) continue;
        if (command == Command::use_recipe) return "call hordctl recipe use NUMBER";
        if (command == Command::commit_recipe)
            return "a PLC sends it (docs/plc.md); a file's: hordctl recipe use NUMBER";
        names += (names.empty() ? "call hordctl command " : " or ") + std::string(name);
    }
    return names;
}

// The loader calls it before the libraries' constructors, which take most of the time before main().
void hold_signals_of_run(int argc, char** argv, char**) {
    if (argc > 1 && std::string_view(argv[1]) == "run") hord::firmware::hold_signals();
}
[[gnu::section(".preinit_array"), gnu::used]] void (*const kFirst)(int, char**, char**) = hold_signals_of_run;

}  // namespace

int main(int argc, char** argv) {
    using namespace hord;
    using namespace hord::firmware;
    if (argc > 1 && std::ranges::find(kMovedToLab, std::string_view(argv[1])) != std::end(kMovedToLab)) {
        return static_cast<int>(
            complain({ErrorCode::invalid_argument, fmt::format("{} is a command of hord-lab", argv[1]),
                      fmt::format("call hord-lab {} with the same options", argv[1])}));
    }
    if (const std::string cure = argc > 1 ? station_command_for(argv[1]) : ""; !cure.empty()) {
        return static_cast<int>(
            complain({ErrorCode::invalid_argument, fmt::format("{} is a command of the station", argv[1]), cure}));
    }
    CLI::App program{"hordctl: inspect, learn, run and watch an inspection cell for transparent parts"};
    program.set_version_flag("--version", "hordctl " HORD_VERSION);
    program.require_subcommand(1);
    program.footer(
        "Exit status: 0 all pass, 1 any reject, 2 usage or unreadable input, 3 unfit.\n"
        "Every command has its own --help with an example. Experiments, soak and scenes: hord-lab --help.");
    Exit status = Exit::good;
    for (const auto add : {add_inspect, add_learn, add_tune, add_run, add_status, add_watch, add_calibrate,
                           add_registers, add_recipe, add_command, add_devices, add_selftest, add_teach, add_latency,
                           add_results, add_replay, add_export, add_import}) {
        add(program, status);
    }
    return run_command_line(program, argc, argv, status);
}
