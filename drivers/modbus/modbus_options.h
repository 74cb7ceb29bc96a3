// Options of the rejector behind a Modbus module. The configuration reads them from [rejector]; deploy/hordd.toml
// documents the keys.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "drivers/hal/clock.h"

namespace hord::drivers {

struct SerialSettings {
    std::string device;  // "/dev/ttyUSB0"
    int baud = 19200;    // 1200 or more
    char parity = 'E';   // 'N' (two stop bits), 'E', 'O'
    bool rs485 = true;   // the kernel switches the transmitter (TIOCSRS485)
    bool operator==(const SerialSettings&) const = default;
};

struct ModuleAddress {
    std::string host = "127.0.0.1";
    int port = 502;
    std::optional<SerialSettings> serial = {};  // Modbus RTU, instead of host and port
    int unit = 1;                               // 1..247; TCP: also 255, for a module that is addressed by its IP alone
    // As --module takes it: an IPv6 address in brackets.
    [[nodiscard]] std::string host_and_port() const {
        return (host.find(':') == std::string::npos ? host : "[" + host + "]") + ":" + std::to_string(port);
    }
    bool operator==(const ModuleAddress&) const = default;
};

// What differs between modules, filled from a profile (docs/hardware.md). Addresses are those on the wire, from 0; -1:
// the module has none.
struct ModuleMap {
    int first_output = 0;           // the lowest coil that is an output; those below it are inputs
    int read_back_offset = 0;       // a coil is read back at its address plus this
    int pulse_coil_offset = -1;     // an output's coil plus this is the coil that starts a pulse timed by the module
    int pulse_width_register = -1;  // holding register of the pulse's width; -1: the width is set in the module
    hal::Duration pulse_width_unit = std::chrono::milliseconds(1);

    // A watchdog that is set over Modbus. Its time can be changed only while it is stopped. Every write of a value that
    // differs from the last one triggers it.
    int watchdog_time_register = -1;
    hal::Duration watchdog_unit = std::chrono::milliseconds(100);
    int watchdog_trigger_register = -1;
    int watchdog_stop_register = -1;
    int watchdog_stop_value = 0;

    int alarm_coil = -1;  // reads 1 after the module's own watchdog expired; writing 1 enables the outputs again

    // The module's name, in input registers: text of two characters a register, or a number.
    int name_register = -1;
    int name_words = 0;                 // 0: a number in one register
    std::string_view name_prefix = "";  // printed before the number

    bool operator==(const ModuleMap&) const = default;
};

// Why `coil` can be no output of the station's beside `other`, as the end of a sentence; empty: it can. Written as an
// output, a pulse coil would move another output, and the alarm coil would release outputs that the watchdog dropped.
inline std::string not_an_output(const ModuleMap& map, int coil, int other) {
    const int pulse = map.pulse_coil_offset, read_back = map.read_back_offset;
    if (coil < map.first_output)
        return "is an input of this module: its first output is coil " + std::to_string(map.first_output);
    if (coil == other) return "is the other output's coil, too";
    if (coil == map.alarm_coil) return "is this module's alarm coil";
    // Outputs in a row, as many as the offset; their pulse coils follow.
    const int nth = coil - map.first_output;
    if (pulse > 0 && (coil == other + pulse || (nth >= pulse && nth < 2 * pulse)))
        return "starts the pulses of output " + std::to_string(coil - pulse) + " in this module";
    if (read_back > 0 && coil == other + read_back)
        return "is output " + std::to_string(other) + " of this module, as it is read back";
    return {};
}

// A rejection has three time-outs:
//   response_timeout  one Modbus request: the longest wait for its answer. Over TCP a coil's write and its reading back
//                     share it.
//   confirm_within    the confirm sensor: the longest time from the end of the pulse until it sees the ejected part.
//                     After it the driver reports the rejection as failed.
//   confirm_timeout   the station (CoreConfig, firmware/core/core_config.h): the longest time from the end of the pulse
//                     until the driver has reported. After it the rejection counts as failed. It must be longer than
//                     response_timeout; with a confirm sensor, than the other two together.
// A failed rejection stops the line.
//
// start() checks the ranges again: hordctl latency opens the driver without a configuration.
struct ModbusRejectorOptions {
    ModuleAddress address;
    ModuleMap map;
    int ejector_coil = 0;           // 0..65535, as on the wire (a manual's coil 00001 is 0 here)
    int permit_coil = 1;            // -1: none
    bool energise_to_pass = false;  // the ejector acts while its coil is 0: a module that lost its link rejects
    // Not zero: the module times the pulse by its pulse coil, and this is the width. A command acts only if the whole
    // pulse fits into its window.
    hal::Duration module_pulse{};
    int confirm_input = -1;  // discrete input of the sensor that an ejected part passes; -1: there is no such sensor
    bool confirm_active_low = false;
    hal::Duration confirm_within = std::chrono::milliseconds(50);
    hal::Duration watchdog{};  // the module drops its outputs after this time without the driver; zero: not changed
    hal::Duration response_timeout = std::chrono::milliseconds(30);  // 5 ms..1 s

    // Not in the configuration.
    hal::Duration reconnect_every = std::chrono::milliseconds(100);
    hal::Duration check_every = std::chrono::milliseconds(100);  // outputs are read back while nothing else is to do
    hal::Duration confirm_every = std::chrono::milliseconds(2);  // the confirm sensor is read, while a part is awaited
    bool operator==(const ModbusRejectorOptions&) const = default;
};

}  // namespace hord::drivers
