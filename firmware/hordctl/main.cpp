// hordctl: the station's tool for people.
#include <algorithm>
#include <string_view>

#include <fmt/format.h>

#include "firmware/hordctl/commands.h"

namespace {

// Commands that hord-lab has now.
constexpr std::string_view kMovedToLab[] = {"experiment", "soak", "scene", "render"};

}  // namespace

int main(int argc, char** argv) {
    using namespace hord;
    using namespace hord::firmware;
    if (argc > 1 && std::ranges::find(kMovedToLab, std::string_view(argv[1])) != std::end(kMovedToLab)) {
        return static_cast<int>(
            complain({ErrorCode::invalid_argument, fmt::format("{} is a command of hord-lab", argv[1]),
                      fmt::format("call hord-lab {} with the same options", argv[1])}));
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
