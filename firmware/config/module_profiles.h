// The known modules, from their manuals (cited in docs/hardware.md).
#pragma once

#include <span>
#include <string_view>

#include "drivers/modbus/modbus_options.h"

namespace hord::firmware {

struct ModuleProfile {
    std::string_view name;  // rejector.profile
    drivers::ModuleMap map;
};

// The first one is the default: coils only.
std::span<const ModuleProfile> module_profiles();

}  // namespace hord::firmware
