// The commands of hordctl. Each file adds one sub-command to the program; main.cpp joins them.
#pragma once

#include "common/cli/program.h"

namespace hord::firmware {

// Each adds its sub-command, whose callback runs it and sets `status`.
void add_inspect(CLI::App& program, Exit& status);
void add_export(CLI::App& program, Exit& status);
void add_import(CLI::App& program, Exit& status);
void add_learn(CLI::App& program, Exit& status);
void add_tune(CLI::App& program, Exit& status);
void add_run(CLI::App& program, Exit& status);
void add_status(CLI::App& program, Exit& status);
void add_watch(CLI::App& program, Exit& status);
void add_calibrate(CLI::App& program, Exit& status);
void add_registers(CLI::App& program, Exit& status);
void add_recipe(CLI::App& program, Exit& status);
void add_command(CLI::App& program, Exit& status);
void add_devices(CLI::App& program, Exit& status);
void add_selftest(CLI::App& program, Exit& status);
void add_teach(CLI::App& program, Exit& status);
void add_latency(CLI::App& program, Exit& status);
void add_results(CLI::App& program, Exit& status);
void add_replay(CLI::App& program, Exit& status);  // also adds merge

// The service's store.
constexpr const char* kDefaultStore = "/var/lib/hord/store";

}  // namespace hord::firmware
