// The commands of hordctl. Each file adds one sub-command to the program; main.cpp joins them.
#pragma once

#include <string>

#include <CLI/CLI.hpp>

#include "algo/result.h"

namespace hord::firmware {

// Exit statuses of every command (`hordctl --help`).
enum class Exit : int {
    good = 0,       // done; all parts pass
    rejected = 1,   // done; at least one part rejected
    bad_input = 2,  // usage or unreadable input: one clear line on stderr
    unfit = 3,      // done; at least one frame could not be judged, none rejected
};

// Each adds its sub-command; when that command is parsed and run, it leaves its status in `status`.
void add_inspect(CLI::App& program, Exit& status);
void add_learn(CLI::App& program, Exit& status);
void add_tune(CLI::App& program, Exit& status);
void add_render(CLI::App& program, Exit& status);
void add_run(CLI::App& program, Exit& status);
void add_status(CLI::App& program, Exit& status);
void add_watch(CLI::App& program, Exit& status);
void add_calibrate(CLI::App& program, Exit& status);
void add_soak(CLI::App& program, Exit& status);
void add_experiment(CLI::App& program, Exit& status);
void add_registers(CLI::App& program, Exit& status);
void add_scene(CLI::App& program, Exit& status);
void add_recipe(CLI::App& program, Exit& status);
void add_command(CLI::App& program, Exit& status);
void add_selftest(CLI::App& program, Exit& status);
void add_teach(CLI::App& program, Exit& status);
void add_latency(CLI::App& program, Exit& status);
void add_results(CLI::App& program, Exit& status);
void add_replay(CLI::App& program, Exit& status);  // and merge

// Where the service keeps what outlives it.
constexpr const char* kDefaultStore = "/var/lib/hord/store";

// Prints `error` as one line (more, when there are several problems) on stderr. Returns bad_input.
Exit complain(const Error& error);

}  // namespace hord::firmware
