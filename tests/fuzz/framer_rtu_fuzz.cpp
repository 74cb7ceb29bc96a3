// Each piece is [size, silence before it, bytes...]. Every request that the framer returns must have a legal length and
// the address of this unit (17) or broadcast (0). After a silence a good frame must be recognised, independent of
// earlier bytes.
#include <algorithm>
#include <cstdlib>

#include "firmware/modbus/framer_rtu.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord;
    using namespace hord::firmware::modbus;
    using namespace std::chrono_literals;
    FramerRtu framer(17, 20ms);
    hord::hal::TimePoint now{};
    std::span<const std::uint8_t> rest(data, size);
    while (rest.size() > 2) {
        now += std::chrono::milliseconds(rest[1]);
        auto piece = rest.subspan(2, std::min<std::size_t>(rest[0], rest.size() - 2));
        rest = rest.subspan(2 + piece.size());
        while (const auto request = framer.take(piece, now)) {
            if (request->pdu.empty() || request->pdu.size() > kMaxPdu) std::abort();
            if (request->unit != 17 && request->unit != 0) std::abort();
        }
        if (!piece.empty()) std::abort();
    }
    now += 21ms;
    const std::uint8_t good[] = {0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87};
    std::span<const std::uint8_t> frame(good);
    const auto request = framer.take(frame, now);
    if (!request || request->pdu.size() != 5 || !frame.empty()) std::abort();
    return 0;
}
