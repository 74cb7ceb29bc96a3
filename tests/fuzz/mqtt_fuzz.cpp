// Messages [topic, length, payload...] from a broker to the edge node: commands, states of the primary host, others.
// The node publishes births, deaths and data only.
#include <algorithm>
#include <cstdlib>
#include <string_view>

#include "firmware/mqtt/edge_node.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord::firmware::mqtt;
    NodeOptions options;
    options.group = "g";
    options.node = "n";
    options.primary_host = size % 2 == 0 ? "h" : "";
    EdgeNode node(options, {});
    UtcMs now = 1'790'000'000'000;
    (void)node.begin_session(now);
    node.connected(now);
    const std::string topics[] = {"spBv1.0/g/NCMD/n", "spBv1.0/STATE/h", "spBv1.0/g/NCMD/other"};
    std::string_view rest(reinterpret_cast<const char*>(data), size);
    for (int messages = 0; messages < 32 && rest.size() > 3; ++messages) {
        const auto length = std::min<std::size_t>(
            static_cast<std::uint8_t>(rest[1]) + 256U * static_cast<std::uint8_t>(rest[2]), rest.size() - 3);
        const auto kind = static_cast<std::uint8_t>(rest[0]);
        node.message(topics[kind % 3], rest.substr(3, length), now, kind >= 128);
        rest.remove_prefix(3 + length);
        node.step(now += 700);
        for (const Outgoing& out : node.take_outgoing()) {
            if (!out.topic.starts_with("spBv1.0/g/N") || out.topic.find("CMD") != std::string::npos) std::abort();
        }
    }
    return 0;
}
