// Messages of a GigE Vision camera's message channel: its events. Aravis does not read them. Pure: no socket, no clock.
//
// The camera sends a message as a datagram and, where the station asked for it, sends it again until it is answered.
// Each message has the next request number, from 1 to 65535 and then 1 again: a repeated number is the same message,
// and a gap means that messages were lost.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/genicam/frame_identity.h"

namespace hord::drivers {

struct GvcpEvent {
    std::uint16_t id = 0;
    std::uint64_t ticks = 0;  // of the camera's clock
};

struct GvcpMessage {
    std::uint16_t command = 0, request = 0;
    bool wants_answer = false;
    std::vector<GvcpEvent> events;
};

// EVENT_CMD (any number of events) or EVENTDATA_CMD (the first event; its data is not read). None: another message, or
// a malformed one.
std::optional<GvcpMessage> parse_gvcp_message(std::span<const std::uint8_t> bytes);

std::array<std::uint8_t, 8> gvcp_answer(const GvcpMessage& message);

// The edges of an input, from the events of its two directions.
class InputEdges {
  public:
    struct Edge {
        bool active = false;
        std::uint32_t sequence = 0;  // from 1; a gap where messages were lost
        std::uint64_t ticks = 0;
    };

    InputEdges(std::uint16_t activates, std::uint16_t deactivates) : activates_(activates), deactivates_(deactivates) {}

    // Of a message that was sent again, or that comes after later ones (it counts as lost): none.
    std::vector<Edge> take(const GvcpMessage& message);

  private:
    std::uint16_t activates_, deactivates_;
    BlockCounter messages_;
    std::uint32_t last_message_ = 0, sequence_ = 0;
};

}  // namespace hord::drivers
