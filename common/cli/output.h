// What a program writes on stdout, and what it says when that does not reach its file or its reader.
#pragma once

#include <cstddef>
#include <string_view>

#include "common/result.h"

namespace hord {

// Writes through stdout's buffer. Unlike fmt::print() it does not throw: end_output() tells what is lost.
void print_output(std::string_view text);

// What stdout took, and errno of what failed (0: nothing).
struct Written {
    std::size_t bytes = 0;
    int reason = 0;
};

// For programs that must go on. Writes past stdout's buffer, and waits at most so long without progress (0: not).
Written write_output(std::string_view text, int patience_ms);

// The output could not be written for this reason (errno; 0: not known), and what to do.
Error lost_output(int reason);

// Keeps the reason for end_output(): the first counts.
void note_lost_output(int reason);

// Writes what stdout still holds. Returns `status`, or bad_input with one line on stderr if it could not be written.
int end_output(int status);

}  // namespace hord
