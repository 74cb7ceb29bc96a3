#include "firmware/core/faults.h"

namespace hord::firmware {

std::string text_of(const LineStop& why) {
    const std::string part = why.part == 0 ? "a part" : "part " + std::to_string(why.part);
    switch (why.cause) {
        case LineStopCause::none: return {};
        case LineStopCause::reject_failed: return "the rejection of " + part + " was not confirmed";
        case LineStopCause::reject_late: return "the rejection of " + part + " came too late";
        case LineStopCause::place_lost:
            return "the line had no run permit while " + part + " came or was on its way: its place is not known";
        case LineStopCause::untracked_part: return part + " came that the station cannot follow";
        case LineStopCause::part_sensor_lost: return "the part sensor was lost or missed edges: a part may have passed";
        case LineStopCause::encoder_silent: return "the encoder is silent while parts are on the line";
        case LineStopCause::line_unknown: return "nothing proves that the line was empty when the station started";
    }
    return {};
}

std::string text_of(const FaultInfo& fault, const LineStop& why) {
    std::string text = std::string(fault.name) + ": " + std::string(fault.meaning);
    if (const std::string because = text_of(why); fault.bit == kFaultRejectUnconfirmed && !because.empty())
        text += " (" + because + ")";
    return text + ": " + std::string(fault.cure);
}

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
