// Shared by the command-line programs: exit statuses, error output, and running a command line.
#pragma once

#include <CLI/CLI.hpp>

#include "common/result.h"

namespace hord {

// Exit statuses of every command (`hordctl --help`).
enum class Exit : int {
    good = 0,       // done; all parts pass
    rejected = 1,   // done; at least one part rejected
    bad_input = 2,  // usage or unreadable input: one clear line on stderr
    unfit = 3,      // done; at least one frame could not be judged, none rejected
};

// Prints `error` after the program's name as one line (more, when there are several problems) on stderr. Returns
// bad_input.
Exit complain(const Error& error);

// Parses the command line, which runs the command's callback, and returns the exit status for main(): `status` as the
// callback left it, or bad_input with one line on stderr for wrong usage and unexpected exceptions.
int run_command_line(CLI::App& program, int argc, char** argv, const Exit& status);

}  // namespace hord
