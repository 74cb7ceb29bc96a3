// The commands of hord-lab. Each file adds one sub-command to the program; main.cpp adds all of them.
#pragma once

#include "common/cli/program.h"

namespace hord::lab {

// Each adds its sub-command; when that command is parsed and run, it leaves its status in `status`.
void add_design(CLI::App& program, Exit& status);
void add_experiment(CLI::App& program, Exit& status);
void add_soak(CLI::App& program, Exit& status);
void add_scene(CLI::App& program, Exit& status);
void add_render(CLI::App& program, Exit& status);

}  // namespace hord::lab
