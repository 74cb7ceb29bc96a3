// The first byte chooses how the rest is cut into pieces; the requests found must not depend on it.
#include <algorithm>
#include <cstdlib>
#include <vector>

#include "firmware/modbus/framer_tcp.h"

namespace {

using hord::firmware::modbus::FramerTcp;
using Requests = std::vector<std::uint8_t>;  // length and PDU of each

Requests requests_in(std::span<const std::uint8_t> bytes, std::size_t piece) {
    FramerTcp framer;
    Requests all;
    while (!bytes.empty()) {
        auto part = bytes.first(std::min(piece, bytes.size()));
        bytes = bytes.subspan(part.size());
        while (const auto request = framer.take(part)) {
            if (request->pdu.empty() || request->pdu.size() > hord::firmware::modbus::kMaxPdu) std::abort();
            all.push_back(static_cast<std::uint8_t>(request->pdu.size()));
            all.insert(all.end(), request->pdu.begin(), request->pdu.end());
        }
        if (!part.empty() && !framer.broken()) std::abort();  // all bytes are consumed, unless the stream is broken
    }
    return all;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size == 0) return 0;
    const std::span bytes(data + 1, size - 1);
    if (requests_in(bytes, std::size_t{data[0]} + 1) != requests_in(bytes, bytes.size() + 1)) std::abort();
    return 0;
}
