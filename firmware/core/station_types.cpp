#include "firmware/core/station_types.h"

namespace hord::firmware {

std::string_view name_of(PartReason reason) {
    switch (reason) {
        case PartReason::none: return "none";
        case PartReason::deflection: return "deflection";
        case PartReason::slope: return "slope";
        case PartReason::absorption: return "absorption";
        case PartReason::too_dark: return "too-dark";
        case PartReason::saturated: return "saturated";
        case PartReason::nothing_to_see: return "nothing-to-see";
        case PartReason::not_registered: return "not-registered";
        case PartReason::verdict_late: return "verdict-late";
        case PartReason::frame_lost: return "frame-lost";
        case PartReason::frame_stale: return "frame-stale";
        case PartReason::frame_duplicate: return "frame-duplicate";
        case PartReason::frame_short: return "frame-short";
        case PartReason::frame_corrupt: return "frame-corrupt";
        case PartReason::strobe_failed: return "strobe-failed";
        case PartReason::parts_too_close: return "parts-too-close";
        case PartReason::station_not_running: return "station-not-running";
        case PartReason::device_lost: return "device-lost";
        case PartReason::line_full: return "line-full";
        case PartReason::edge_lost: return "edge-lost";
        case PartReason::inspector_failed: return "inspector-failed";
        case PartReason::plc_lost: return "plc-lost";
    }
    return "unknown";
}

}  // namespace hord::firmware
