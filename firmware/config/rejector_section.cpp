#include <tuple>

#include "firmware/config/device_sections.h"
#include "firmware/config/module_profiles.h"
#include "firmware/config/shared_keys.h"

namespace hord::firmware {

using common::TomlTable;

namespace {

// The profile's addresses, overridden by the keys in the file.
void read_module(TomlTable& rejector, drivers::ModuleMap& map) {
    std::vector<std::string_view> names;
    for (const ModuleProfile& profile : module_profiles()) names.push_back(profile.name);
    if (const auto chosen = rejector.choice("profile", names)) map = module_profiles()[*chosen].map;
    rejector.integer("read_back_offset", map.read_back_offset, 0, 65535);
    rejector.integer("pulse_coil_offset", map.pulse_coil_offset, -1, 65535);
    rejector.integer("pulse_width_register", map.pulse_width_register, -1, 65535);
    ms(rejector, "pulse_width_unit_ms", map.pulse_width_unit, 0.001, 1000);
    rejector.integer("watchdog_time_register", map.watchdog_time_register, -1, 65535);
    ms(rejector, "watchdog_unit_ms", map.watchdog_unit, 0.1, 60'000);
    rejector.integer("watchdog_trigger_register", map.watchdog_trigger_register, -1, 65535);
    rejector.integer("watchdog_stop_register", map.watchdog_stop_register, -1, 65535);
    rejector.integer("watchdog_stop_value", map.watchdog_stop_value, 0, 65535);
    rejector.integer("alarm_coil", map.alarm_coil, -1, 65535);
}

void check_module(TomlTable& rejector, const drivers::ModbusRejectorOptions& modbus, const CoreConfig& core) {
    const drivers::ModuleAddress& address = modbus.address;
    const drivers::ModuleMap& map = modbus.map;
    for (const auto& [key, coil, other] : {std::tuple("reject_coil", modbus.ejector_coil, modbus.permit_coil),
                                           {"run_permit_coil", modbus.permit_coil, modbus.ejector_coil}}) {
        if (const std::string why = drivers::not_an_output(map, coil, other); !why.empty())
            rejector.problem(key, "is " + std::to_string(coil) + ", which " + why,
                             "give each output a coil of its own; docs/hardware.md says which coils a profile has");
    }
    if (address.serial && (address.unit < 1 || address.unit > 247))
        rejector.problem("unit", "is none of a serial line", "use 1 to 247");
    if (address.serial && address.port != drivers::ModuleAddress{}.port) {
        rejector.problem("port", "is given, and a serial line, too", "name either rejector.device, or host and port");
    }
    if (modbus.module_pulse > Duration::zero()) {
        if (map.pulse_coil_offset < 0) {
            rejector.problem("module_pulse_ms", "asks for a pulse that this module does not time",
                             "choose the profile of a module that does, or leave it 0");
        }
        if (modbus.module_pulse > core.reject_pulse)
            rejector.problem("module_pulse_ms", "is longer than pulse_ms",
                             "a command acts only where the module's whole pulse fits into pulse_ms");
        if (modbus.energise_to_pass)
            rejector.problem("module_pulse_ms", "cannot be with energise_to = \"pass\"",
                             "a module pulses an output on, not off: leave it 0");
        if (map.pulse_width_register >= 0 && modbus.module_pulse < map.pulse_width_unit) {
            rejector.problem("module_pulse_ms", "is shorter than pulse_width_unit_ms",
                             "the module cannot be told that");
        }
    }
    if (modbus.watchdog > Duration::zero()) {
        if (map.watchdog_time_register < 0 || map.watchdog_trigger_register < 0 || map.watchdog_stop_register < 0) {
            rejector.problem(
                "watchdog_ms", "cannot be set in this module over Modbus",
                "set it in the module itself and leave this 0; the station asks often enough to keep it alive");
        }
        if (modbus.watchdog < 3 * modbus.response_timeout)
            rejector.problem("watchdog_ms", "is shorter than three response_timeout_ms",
                             "one lost answer would stop the line");
        if (modbus.watchdog / map.watchdog_unit > 65535)
            rejector.problem("watchdog_ms", "does not fit into the module's register", "shorten it");
    }
    if (modbus.confirm_input >= 0 && modbus.confirm_within + modbus.response_timeout >= core.confirm_timeout) {
        rejector.problem("confirm_within_ms", "and response_timeout_ms end after confirm_timeout_ms",
                         "raise confirm_timeout_ms: until then the station waits for the confirmation");
    } else if (modbus.response_timeout >= core.confirm_timeout) {
        rejector.problem("confirm_timeout_ms", "is not longer than response_timeout_ms",
                         "raise it: until then the station waits for the module's answer");
    }
}

void refuse_other_modules_keys(TomlTable& rejector, bool real, const drivers::ModbusRejectorOptions& modbus,
                               const drivers::SerialSettings& serial) {
    const drivers::ModbusRejectorOptions unset;
    const drivers::SerialSettings unset_line;
    const bool other_host = modbus.address.host != unset.address.host, line = !serial.device.empty();
    const char* const simulated = "take it out, or set rejector.backend to \"modbus\"";
    refuse(rejector, !real && other_host, "host", simulated);
    refuse(rejector, !real && modbus.address.port != unset.address.port, "port", simulated);
    refuse(rejector, !real && line, "device", simulated);
    refuse(rejector, real && line && other_host, "host", "name either rejector.device, or host and port",
           "is given, and a serial line, too");
    constexpr std::string_view kNoLine = "has no effect without rejector.device";
    const char* const no_line = "take it out, or name the serial line in rejector.device";
    refuse(rejector, !line && serial.baud != unset_line.baud, "baud", no_line, kNoLine);
    refuse(rejector, !line && serial.parity != unset_line.parity, "parity", no_line, kNoLine);
    refuse(rejector, !line && serial.rs485 != unset_line.rs485, "rs485", no_line, kNoLine);
    constexpr std::string_view kNoSensor = "has no effect without rejector.confirm_input";
    const char* const no_sensor = "take it out, or name the sensor's input in rejector.confirm_input";
    const bool confirms = modbus.confirm_input >= 0;
    refuse(rejector, !confirms && modbus.confirm_active_low, "confirm_active_low", no_sensor, kNoSensor);
    refuse(rejector, !confirms && modbus.confirm_within != unset.confirm_within, "confirm_within_ms", no_sensor,
           kNoSensor);
}

}  // namespace

void read_rejector(TomlTable rejector, RejectorConfig& value, CoreConfig& core) {
    bool real = false;
    rejector.choice("backend", {"simulated", "modbus"}, real);
    drivers::ModbusRejectorOptions modbus;
    drivers::ModuleAddress& address = modbus.address;
    drivers::SerialSettings serial;
    host(rejector, "host", address.host);
    rejector.integer("port", address.port, 1, 65535);
    rejector.text("device", serial.device);
    baud(rejector, serial.baud);
    std::size_t parity = 1;
    rejector.choice("parity", {"none", "even", "odd"}, parity);
    serial.parity = "NEO"[parity];
    rejector.boolean("rs485", serial.rs485);
    if (!serial.device.empty()) address.serial = serial;
    rejector.integer("unit", address.unit, 0, 255);
    read_module(rejector, modbus.map);
    rejector.integer("reject_coil", modbus.ejector_coil, 0, 65535);
    rejector.integer("run_permit_coil", modbus.permit_coil, 0, 65535);
    rejector.choice("energise_to", {"reject", "pass"}, modbus.energise_to_pass);
    ms(rejector, "module_pulse_ms", modbus.module_pulse, 0, 10'000);
    rejector.integer("confirm_input", modbus.confirm_input, -1, 65535);
    rejector.boolean("confirm_active_low", modbus.confirm_active_low);
    ms(rejector, "confirm_within_ms", modbus.confirm_within, 0.1, 60'000);
    ms(rejector, "watchdog_ms", modbus.watchdog, 0, 600'000);
    ms(rejector, "response_timeout_ms", modbus.response_timeout, 5, 1000);
    ms(rejector, "lead_ms", core.reject_lead, 0, 10'000);
    ms(rejector, "early_ms", core.reject_early, 0.1, 10'000);
    ms(rejector, "pulse_ms", core.reject_pulse, 0.1, 10'000);
    ms(rejector, "confirm_timeout_ms", core.confirm_timeout, 1, 60'000);
    check_module(rejector, modbus, core);
    refuse_other_modules_keys(rejector, real, modbus, serial);
    if (real) value = modbus;
    else value = SimulatedRejector{modbus};
}

}  // namespace hord::firmware
