#include "firmware/station/timing_mismatch.h"

#include <cmath>

namespace hord::firmware {
namespace {

std::string ms(Duration time) {
    std::string text = std::to_string(std::abs(static_cast<double>(time.count())) / 1e6);
    text.erase(text.find('.') + 4);  // whole microseconds
    text.erase(text.find_last_not_of('0') + 1);
    if (text.back() == '.') text.pop_back();
    return text + " ms";
}

template <class Waits>
const Part* oldest(const Line& line, Waits waits) {
    for (std::uint32_t k = 0; k < line.size(); ++k) {
        if (line[k].phase == Part::Phase::waiting && waits(line[k])) return &line[k];
    }
    return nullptr;
}

bool outside(Duration off, Duration window) { return off > window || -off > window; }

const char* side(Duration off) { return off > Duration::zero() ? " after " : " before "; }

}  // namespace

std::optional<Error> mismatch_of(const hal::FrameInfo& frame, const Line& line, const CoreConfig& config) {
    const Part* const part = oldest(line, [&](const Part& one) {
        return one.frame_due && (frame.exposure == 0 || frame.exposure == one.number());
    });
    if (part == nullptr || frame.corrupt) return std::nullopt;  // a damaged frame's time may be that of its arrival
    for (std::uint32_t k = 0; frame.exposure == 0 && !frame.nobodys && k < line.size(); ++k) {
        if (line[k].exposed && !outside(frame.exposure_start - line[k].exposure_start, config.frame_window))
            return std::nullopt;
    }
    const Duration off = frame.exposure_start - part->exposure_start;
    const std::string number = std::to_string(part->number());
    if (frame.nobodys && !outside(off, config.frame_window)) {
        return Error{ErrorCode::timeout,
                     "a frame came while part " + number +
                         " waits for its own, and nothing proves that the trigger of this part made it",
                     "look why frames come late: a trigger before brought none in time, or this frame was exposed "
                     "before its trigger was sent"};
    }
    if (!outside(off, config.frame_window)) return std::nullopt;
    return Error{
        ErrorCode::timeout,
        (frame.exposure != 0 ? "the frame of part " + number + " was exposed " + ms(off) + side(off) + "its trigger"
                             : "a frame was exposed " + ms(off) + side(off) + "the trigger of part " + number +
                 ", which waits for its frame") +
            "; the window is " + ms(config.frame_window) + " (timing.frame_window_us)",
        "if the camera is as late for each part, raise line.exposure_delay_ms and then timing.frame_window_us; if "
        "for some, look what delays its trigger"};
}

std::optional<Error> mismatch_of(const hal::PartEdge& edge, const Line& line, const CoreConfig& config) {
    if (edge.kind != hal::PartEdge::Kind::arrives || line.size() == 0) return std::nullopt;
    const Part& ahead = line[line.size() - 1];
    const Duration gap = edge.at - ahead.arrived;
    if (!ahead.accepted || gap <= Duration::zero()) return std::nullopt;
    const auto closer = [](const std::string& distance, const std::string& least) {
        return Error{
            ErrorCode::refused,
            "a part came " + distance + " after the one ahead; one that is closer than " + least +
                " is rejected (parts-too-close)",
            "put parts on the line further apart, or lower that key if the camera can follow; if one part gives "
            "several edges, debounce the light barrier"};
    };
    if (gap < config.min_gap) return closer(ms(gap), ms(config.min_gap) + " (line.min_gap_ms)");
    const std::int64_t counts = edge.counts.value_or(0) - ahead.edge_counts;
    if (!config.by_encoder || !edge.counts || counts >= config.min_gap_counts) return std::nullopt;
    return closer(std::to_string(counts) + " encoder counts",
                  std::to_string(config.min_gap_counts) + " (line.min_gap_counts)");
}

std::optional<Error> mismatch_of(const hal::StrobeReport& report, const Line& line, const CoreConfig& config) {
    const Part* const part =
        oldest(line, [&](const Part& one) { return one.light_due && one.number() == report.exposure; });
    if (part == nullptr) return std::nullopt;
    const Duration off = report.start - (part->exposure_start + config.strobe_delay);
    if (!report.lit)
        return Error{ErrorCode::timeout,
                     "the light of part " + std::to_string(part->number()) + " did not come: the strobe said so " +
                         ms(off) + side(off) + "it was due",
                     "a strobe that is lost has a message of its own; without one the strobe's thread came too late to "
                     "fire it: look what else this machine does"};
    const Duration longer = report.width - config.strobe;
    const bool late = outside(off, config.strobe_window);
    if (!late && !outside(longer, config.strobe_window)) return std::nullopt;
    return Error{ErrorCode::timeout,
                 "the light of part " + std::to_string(part->number()) +
                     (late ? " began " + ms(off) + side(off) + "it was due"
                           : " was " + ms(longer) + (longer > Duration::zero() ? " longer" : " shorter") +
                              " than timing.strobe_us") +
                     "; the tolerance is " + ms(config.strobe_window) + " (timing.strobe_window_us)",
                 "look what delays the strobe; a light that a command over the network fires needs a tolerance of some "
                 "milliseconds"};
}

std::optional<Error> mismatch_of(TimePoint step, const Line& line, const CoreConfig&) {
    for (std::uint32_t k = 0; k < line.size(); ++k) {
        const Part& part = line[k];
        if (!part.exposed || part.asked_at != step || step <= part.exposure_start) continue;
        return Error{ErrorCode::timeout,
                     "part " + std::to_string(part.number()) + " was at the camera " + ms(step - part.exposure_start) +
                         " before the station could ask for its exposure: neither light nor camera was triggered",
                     "look what else this machine does, or raise line.exposure_delay_ms (move the camera downstream)"};
    }
    return std::nullopt;
}

}  // namespace hord::firmware
