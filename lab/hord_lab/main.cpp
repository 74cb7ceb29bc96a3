// hord-lab: experiments, soak and scenes of the simulated cell.
#include "lab/hord_lab/commands.h"

int main(int argc, char** argv) {
    using namespace hord;
    using namespace hord::lab;
    CLI::App program{"hord-lab: experiments, soak and scenes on the simulated inspection cell"};
    program.set_version_flag("--version", "hord-lab " HORD_VERSION);
    program.require_subcommand(1);
    program.footer(
        "Exit status: 0 done and as expected, 1 a claim or a promise does not hold, 2 usage or unreadable input.\n"
        "Every command has its own --help with an example.");
    Exit status = Exit::good;
    add_design(program, status);
    add_experiment(program, status);
    add_soak(program, status);
    add_scene(program, status);
    add_render(program, status);
    return run_command_line(program, argc, argv, status);
}
