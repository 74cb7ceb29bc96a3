// The modules that are known by name, as their manuals describe them (docs/hardware.md cites them).
#pragma once

#include <span>
#include <string_view>

#include "drivers/hal/module_map.h"

namespace hord::firmware {

struct ModuleProfile {
    std::string_view name;  // rejector.profile
    hal::ModuleMap map;
};

// The first one is the default: coils, and nothing else.
std::span<const ModuleProfile> module_profiles();

}  // namespace hord::firmware
