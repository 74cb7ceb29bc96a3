#include "firmware/config/module_profiles.h"

#include <array>

namespace hord::firmware {
namespace {

// WAGO 750 Ethernet couplers and controllers (750-352, 750-841, 750-843, 750-880, 750-882). Reading coil n reads input
// n; outputs are read back 0x200 higher. An expired watchdog sets all outputs to 0 and refuses writes until it is
// started again.
constexpr drivers::ModuleMap wago_750() {
    drivers::ModuleMap map;
    map.read_back_offset = 0x0200;
    map.watchdog_time_register = 0x1000;
    map.watchdog_unit = std::chrono::milliseconds(100);
    map.watchdog_trigger_register = 0x1003;
    map.watchdog_stop_register = 0x1008;
    map.watchdog_stop_value = 0xAA55;
    map.name_register = 0x2012;
    map.name_prefix = "WAGO 750-";
    return map;
}

// Moxa ioLogik E1200. A digital output in pulse mode has a second coil, 16 higher, that starts its pulses. Pulse width,
// number of pulses and the watchdog, which sets an alarm, are configured in the module's web console.
constexpr drivers::ModuleMap moxa_iologik() {
    drivers::ModuleMap map;
    map.pulse_coil_offset = 16;
    map.alarm_coil = 4144;
    map.name_register = 5000;
    map.name_words = 10;
    return map;
}

constexpr std::array<ModuleProfile, 3> kProfiles = {
    {{"plain-coils", {}}, {"wago-750", wago_750()}, {"moxa-iologik", moxa_iologik()}}};

}  // namespace

std::span<const ModuleProfile> module_profiles() { return kProfiles; }

}  // namespace hord::firmware
