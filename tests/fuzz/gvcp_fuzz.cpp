// A message of a GigE camera's message channel. Every event that is read lies in the message, and the edges' sequence
// only grows.
#include <cstdint>
#include <cstdlib>

#include "drivers/genicam/gvcp_events.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord::drivers;
    static InputEdges input(0x9011, 0x9012);
    static std::uint32_t last = 0;
    const auto message = parse_gvcp_message({data, size});
    if (!message) return 0;
    if (message->events.empty() || message->events.size() * 16 + 8 > size) std::abort();
    const auto answer = gvcp_answer(*message);
    if (answer[6] != data[6] || answer[7] != data[7]) std::abort();
    for (const InputEdges::Edge& edge : input.take(*message)) {
        if (static_cast<std::int32_t>(edge.sequence - last) <= 0) std::abort();
        last = edge.sequence;
    }
    return 0;
}
