#include "firmware/config/module_profiles.h"

#include <array>

namespace hord::firmware {
namespace {

using std::chrono::milliseconds;

constexpr std::array<ModuleProfile, 4> kProfiles = {{
    {"plain-coils", {}},
    // WAGO 750 Ethernet couplers and controllers (750-352, 750-841, 750-843, 750-880, 750-882). Reading coil n reads
    // input n; outputs are read back 0x200 higher. An expired watchdog sets all outputs to 0 and refuses writes until
    // it is started again.
    {"wago-750",
     {.read_back_offset = 0x0200,
      .watchdog_time_register = 0x1000,
      .watchdog_unit = milliseconds(100),
      .watchdog_trigger_register = 0x1003,
      .watchdog_stop_register = 0x1008,
      .watchdog_stop_value = 0xAA55,
      .name_register = 0x2012,
      .name_prefix = "WAGO 750-"}},
    // Moxa ioLogik E1200. A digital output in pulse mode has a second coil, 16 higher, that starts its pulses. Pulse
    // width, number of pulses and the watchdog, which sets an alarm, are configured in the module's web console.
    {"moxa-iologik", {.pulse_coil_offset = 16, .alarm_coil = 4144, .name_register = 5000, .name_words = 10}},
    // Advantech ADAM-6050, ADAM-6060, ADAM-6066. DO n is coil 00017 + n of the manual, which counts from 1; coils from
    // 00001 on are the inputs. The watchdog and the outputs' pulse mode are set by Advantech's utility.
    {"advantech-adam-6000", {.first_output = 16}},
}};

}  // namespace

std::span<const ModuleProfile> module_profiles() { return kProfiles; }

}  // namespace hord::firmware
