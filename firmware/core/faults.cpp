#include "firmware/core/faults.h"

namespace hord::firmware {

std::string names_of_faults(std::uint32_t bits) {
    std::string names;
    for (const FaultInfo& fault : kFaultTable) {
        if ((bits & fault.bit) == 0) continue;
        if (!names.empty()) names += ", ";
        names += fault.name;
    }
    return names.empty() ? "none" : names;
}

}  // namespace hord::firmware
