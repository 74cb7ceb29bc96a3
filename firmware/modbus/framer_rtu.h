// Modbus RTU framing for a server on a serial line: bytes and their times in, requests out. Pure; 256 bytes
// of memory.
//
//     unit (1)  PDU (1..253)  CRC-16 (2, low byte first)
//
// The length follows from the function code, so that a request is answered as soon as its last byte is there
// and no timer decides where a frame ends. A silence of `gap` begins a new frame whatever came before. A
// frame that is not understood makes the framer deaf until the next silence: an event on the line costs at
// most the request that it hits, and no request is ever put together from the middle of other bytes. Frames
// for other units, and their replies, are passed over; the next frame may follow them without a silence.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "drivers/hal/clock.h"
#include "firmware/modbus/framer_tcp.h"

namespace hord::firmware::modbus {

inline constexpr std::size_t kMaxRtuFrame = 1 + kMaxPdu + 2;

// CRC-16 of Modbus: reflected polynomial 0xA001, start 0xFFFF.
[[nodiscard]] std::uint16_t crc16(std::span<const std::uint8_t> bytes);

class FramerRtu {
  public:
    // `gap`: a longer silence ends a frame. The line needs 3.5 characters (1.75 ms from 19200 baud up); an
    // adapter that hands bytes over in batches needs more than its latency.
    FramerRtu(std::uint8_t unit, hal::Duration gap) : unit_(unit), gap_(gap) {}

    // Takes bytes that arrived at `at` from the front of `bytes` until one request for this unit, or for all
    // (unit 0: executed and not answered), is complete or none are left; moves `bytes` past them. Call again
    // with the rest.
    [[nodiscard]] std::optional<Request> take(std::span<const std::uint8_t>& bytes, hal::TimePoint at);

    // Frames with a wrong CRC or of unknown length, since the start.
    [[nodiscard]] std::uint64_t damaged() const { return damaged_; }

  private:
    // Of the frame that begins in frame_, as far as it is known.
    enum class Shape : std::uint8_t { incomplete, frame, damaged };
    [[nodiscard]] Shape shape(std::size_t& size) const;
    [[nodiscard]] bool good(std::size_t size) const;

    const std::uint8_t unit_;
    const hal::Duration gap_;
    std::array<std::uint8_t, kMaxRtuFrame> frame_{};
    std::size_t filled_ = 0;
    bool deaf_ = false;
    std::optional<hal::TimePoint> last_at_;
    std::uint64_t damaged_ = 0;
};

// Appends the CRC to `frame`, which holds unit, PDU and room for two bytes more.
void write_crc16(std::span<std::uint8_t> frame);

}  // namespace hord::firmware::modbus
