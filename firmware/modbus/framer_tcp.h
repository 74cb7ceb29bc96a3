// Modbus TCP framing: bytes in, requests out. No I/O; one a connection; always 260 bytes of memory.
//
//     transaction (2)  protocol = 0 (2)  length = 1 + PDU (2)  unit (1)  PDU (1..253)      all big endian
//
// After a wrong protocol or length the frame boundaries are lost: the framer stays broken, and the connection must be
// closed.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace hord::firmware::modbus {

inline constexpr std::size_t kMaxPdu = 253;
inline constexpr std::size_t kMbapSize = 7;
inline constexpr std::size_t kMaxTcpFrame = kMbapSize + kMaxPdu;

struct Request {
    std::uint16_t transaction = 0;
    std::uint8_t unit = 0;
    std::span<const std::uint8_t> pdu;  // 1..253 bytes; valid until the framer is used again
};

class FramerTcp {
  public:
    // Consumes bytes from the front of `bytes` until one request is complete or none are left. Call again with the
    // rest. Nothing: more bytes are needed, or the framer is broken.
    [[nodiscard]] std::optional<Request> take(std::span<const std::uint8_t>& bytes);

    [[nodiscard]] bool broken() const { return broken_; }

  private:
    std::array<std::uint8_t, kMaxTcpFrame> frame_{};
    std::size_t filled_ = 0;
    bool broken_ = false;
};

// Writes the header in front of a reply's PDU. `frame`: kMbapSize + pdu_size bytes, the PDU already in place.
void write_mbap(const Request& request, std::size_t pdu_size, std::span<std::uint8_t> frame);

}  // namespace hord::firmware::modbus
