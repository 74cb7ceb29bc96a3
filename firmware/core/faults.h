// Each fault for people: what it is called, what it means, what to do.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "firmware/core/station_types.h"

namespace hord::firmware {

struct FaultText {
    FaultBit bit;
    std::string_view name;
    std::string_view meaning;
    std::string_view cure;
};

// Every FaultBit once, lowest first.
std::span<const FaultText> fault_texts();

// The names of the bits that are set, ", " between them; "none" for 0.
std::string names_of_faults(std::uint32_t bits);

}  // namespace hord::firmware
