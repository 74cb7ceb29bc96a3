#include "firmware/modbus/framer_tcp.h"

#include <algorithm>

namespace hord::firmware::modbus {
namespace {

// `length` of the header counts the unit, which is the header's last byte, and the PDU.
constexpr std::size_t kLengthField = 6;

}  // namespace

std::optional<Request> FramerTcp::take(std::span<const std::uint8_t>& bytes) {
    while (!broken_) {
        std::size_t wanted = kLengthField;
        if (filled_ >= kLengthField) {
            const std::size_t length = std::size_t{frame_[4]} << 8U | frame_[5];
            if (frame_[2] != 0 || frame_[3] != 0 || length < 2 || length > 1 + kMaxPdu) {
                broken_ = true;
                break;
            }
            wanted = kLengthField + length;
            if (filled_ == wanted) {
                filled_ = 0;
                return Request{.transaction = static_cast<std::uint16_t>(frame_[0] << 8U | frame_[1]),
                               .unit = frame_[6],
                               .pdu = std::span<const std::uint8_t>(frame_).subspan(kMbapSize, wanted - kMbapSize)};
            }
        }
        if (bytes.empty()) break;
        const std::size_t count = std::min(wanted - filled_, bytes.size());
        std::copy_n(bytes.begin(), count, frame_.begin() + static_cast<std::ptrdiff_t>(filled_));
        filled_ += count;
        bytes = bytes.subspan(count);
    }
    return std::nullopt;
}

void write_mbap(const Request& request, std::size_t pdu_size, std::span<std::uint8_t> frame) {
    const std::size_t length = pdu_size + 1;
    const auto byte = [](std::size_t value) { return static_cast<std::uint8_t>(value & 0xFFU); };
    frame[0] = byte(request.transaction >> 8U);
    frame[1] = byte(request.transaction);
    frame[2] = frame[3] = 0;
    frame[4] = byte(length >> 8U);
    frame[5] = byte(length);
    frame[6] = request.unit;
}

}  // namespace hord::firmware::modbus
