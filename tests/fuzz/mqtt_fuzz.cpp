// Messages [topic, length, payload...] from a broker to the edge node: commands, states of the primary host, others.
// The node publishes births, deaths and data only. Each input gets a copy of a node that is connected: its first birth
// depends on no input, and took half of the time.
#include <algorithm>
#include <cstdlib>
#include <string_view>

#include "firmware/mqtt/edge_node.h"

namespace {

using namespace hord::firmware::mqtt;

constexpr UtcMs kConnected = 1'790'000'000'000;

EdgeNode connected(const char* primary_host) {
    NodeOptions options;
    options.group = "g";
    options.node = "n";
    options.primary_host = primary_host;
    EdgeNode node(options, {});
    (void)node.begin_session(kConnected);
    node.connected(kConnected);
    return node;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const EdgeNode waits = connected("h"), born = connected("");
    EdgeNode node = size % 2 == 0 ? waits : born;
    UtcMs now = kConnected;
    static const std::string topics[] = {"spBv1.0/g/NCMD/n", "spBv1.0/STATE/h", "spBv1.0/g/NCMD/other"};
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
