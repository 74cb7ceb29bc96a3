#include "drivers/genicam/gvcp_events.h"

namespace hord::drivers {
namespace {

constexpr std::size_t kHeader = 8, kEvent = 16, kExtendedEvent = 24;  // bytes; extended: block ids of 64 bits
constexpr std::uint8_t kKey = 0x42, kAnswerFlag = 0x01, kExtendedFlag = 0x10;
constexpr std::uint16_t kEventCommand = 0x00C0, kEventDataCommand = 0x00C2;

std::uint64_t number(std::span<const std::uint8_t> bytes) {
    std::uint64_t value = 0;
    for (const std::uint8_t byte : bytes) value = value << 8U | byte;
    return value;
}

}  // namespace

std::optional<GvcpMessage> parse_gvcp_message(std::span<const std::uint8_t> bytes) {
    if (bytes.size() < kHeader || bytes[0] != kKey) return std::nullopt;
    GvcpMessage message;
    message.wants_answer = (bytes[1] & kAnswerFlag) != 0;
    message.command = static_cast<std::uint16_t>(number(bytes.subspan(2, 2)));
    message.request = static_cast<std::uint16_t>(number(bytes.subspan(6, 2)));
    const bool data = message.command == kEventDataCommand;
    const std::span events = bytes.subspan(kHeader);
    const std::size_t size = (bytes[1] & kExtendedFlag) != 0 ? kExtendedEvent : kEvent;
    if ((message.command != kEventCommand && !data) || message.request == 0 ||
        number(bytes.subspan(4, 2)) != events.size() || events.size() < size || (!data && events.size() % size != 0))
        return std::nullopt;
    const std::size_t count = data ? 1 : events.size() / size;
    for (std::size_t k = 0; k < count; ++k) {
        const std::span event = events.subspan(k * size, size);
        message.events.push_back(
            {static_cast<std::uint16_t>(number(event.subspan(2, 2))), number(event.subspan(size - 8))});
    }
    return message;
}

std::array<std::uint8_t, 8> gvcp_answer(const GvcpMessage& message) {
    return {0,
            0,
            0,
            static_cast<std::uint8_t>(message.command + 1),
            0,
            0,
            static_cast<std::uint8_t>(message.request >> 8U),
            static_cast<std::uint8_t>(message.request & 0xFFU)};
}

std::vector<InputEdges::Edge> InputEdges::take(const GvcpMessage& message) {
    const std::uint32_t number = messages_.sequence_of(message.request);
    if (static_cast<std::int32_t>(number - last_message_) <= 0) return {};
    sequence_ += number - last_message_ - 1;
    last_message_ = number;
    std::vector<Edge> edges;
    for (const GvcpEvent& event : message.events) {
        if (event.id == activates_ || event.id == deactivates_)
            edges.push_back({event.id == activates_, ++sequence_, event.ticks});
    }
    return edges;
}

}  // namespace hord::drivers
