// An answer of a strobe controller. What is read of a channel must be settings that the station can have made of it:
// finite numbers, a known mode. A reply without its end, and settings without one of their seven fields, are refused.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "drivers/gardasoft/gardasoft_protocol.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord::drivers;
    const std::string_view raw(reinterpret_cast<const char*>(data), size);
    if (const auto text = gardasoft::text_of_reply("ST1", raw)) {
        if (raw.find('>') == std::string_view::npos || text->size() >= raw.size()) std::abort();
        // Nothing but events acknowledges a command.
        const bool printed = text->find_first_not_of("Evt0123456789,; \r\n\t") != std::string::npos;
        if (printed && gardasoft::acknowledged("ST1", *text)) std::abort();
    }
    if (const auto event = gardasoft::error_of_events("GR", raw); event && *event && (*event)->empty()) std::abort();
    if (const auto version = gardasoft::parse_version(raw); version && version->find("RT") == std::string::npos)
        std::abort();
    if (const auto state = gardasoft::parse_channel(raw)) {
        if (state->mode > gardasoft::ChannelState::Mode::selected || state->output < 0 || state->output > 255)
            std::abort();
        if (!std::isfinite(state->percent) || !std::isfinite(state->rated_a)) std::abort();
        for (const char* field : {"CH", "MD", "S", "DL", "PU", "RT", "RA"}) {
            if (raw.find(field) == std::string_view::npos) std::abort();
        }
        const GardasoftChannel channel{.output = 1, .rated_ma = 500, .limits = {}};
        (void)gardasoft::difference(*state, channel, std::chrono::milliseconds(1), std::chrono::microseconds(20));
    }
    return 0;
}
