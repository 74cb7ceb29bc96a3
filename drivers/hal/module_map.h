// What is particular about a Modbus module that moves a rejector's outputs: pure data, filled from a profile
// (docs/hardware.md).
#pragma once

#include "drivers/hal/clock.h"

namespace hord::hal {

// Addresses are those on the wire, from 0; -1: the module has none.
struct ModuleMap {
    int read_back_offset = 0;    // coils are read back at their address plus this
    int pulse_coil_offset = -1;  // at an output's coil plus this, a coil that has the module pulse the output by itself
    int pulse_width_register = -1;  // holding register that takes the pulse's width; -1: it is set in the module
    Duration pulse_width_unit = std::chrono::milliseconds(1);

    // A watchdog that is set over Modbus. Its time may be changed only while it stands; it is triggered by a value that
    // differs from the last one.
    int watchdog_time_register = -1;
    Duration watchdog_unit = std::chrono::milliseconds(100);
    int watchdog_trigger_register = -1;
    int watchdog_stop_register = -1;
    int watchdog_stop_value = 0;

    int alarm_coil =
        -1;  // reads 1 after the module's own watchdog has expired; 1 written to it gives the outputs free again

    // What it is, in registers: text of two characters a register, or a number.
    int name_register = -1;        // input register
    int name_words = 0;            // 0: a number in one register
    const char* name_prefix = "";  // said before the number

    bool operator==(const ModuleMap&) const = default;
};

}  // namespace hord::hal
