// hordctl: the station's tool for people.
#include <cstdio>

#include <fmt/format.h>

#include "firmware/hordctl/commands.h"

namespace hord::firmware {

Exit complain(const Error& error) {
    fmt::print(stderr, "hordctl: {}\n", error.message());
    return Exit::bad_input;
}

}  // namespace hord::firmware

int main(int argc, char** argv) {
    using namespace hord::firmware;
    CLI::App program{"hordctl: inspect, render, run and watch an inspection cell for transparent parts"};
    program.set_version_flag("--version", "hordctl " HORD_VERSION);
    program.require_subcommand(1);
    program.footer(
        "Exit status: 0 all pass, 1 any reject, 2 usage or unreadable input, 3 unfit.\n"
        "Every command has its own --help with an example.");
    Exit status = Exit::good;
    try {
        add_inspect(program, status);
        add_learn(program, status);
        add_tune(program, status);
        add_render(program, status);
        add_run(program, status);
        add_status(program, status);
        add_watch(program, status);
        add_calibrate(program, status);
        add_soak(program, status);
        add_experiment(program, status);
        add_registers(program, status);
        add_scene(program, status);
        add_recipe(program, status);
        add_command(program, status);
        add_selftest(program, status);
        add_teach(program, status);
        add_latency(program, status);
        add_results(program, status);
        add_replay(program, status);
        program.parse(argc, argv);
    } catch (const CLI::Success& asked) {  // --help, --version
        return program.exit(asked);
    } catch (const CLI::ParseError& error) {
        fmt::print(stderr, "hordctl: {}: see hordctl --help\n", error.what());
        return static_cast<int>(Exit::bad_input);
    } catch (const std::exception& error) {
        fmt::print(stderr, "hordctl: stopped by an unexpected error: {}: please report it\n", error.what());
        return static_cast<int>(Exit::bad_input);
    }
    return static_cast<int>(status);
}
