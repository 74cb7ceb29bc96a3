// Modbus RTU framing for a server on a serial line: bytes with arrival times in, requests out. No I/O.
//
//     unit (1)  PDU (1..253)  CRC-16 (2, low byte first)
//
// The length follows from the function code: a request is complete with its last byte, without a timer. A silence of
// `gap` starts a new frame. After a frame with a wrong CRC or of unknown length, everything up to the next silence is
// discarded, so no request starts in the middle of other bytes. Frames for other units and their replies are skipped.
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

class FramerRtu {
  public:
    // `gap`: a longer silence ends a frame. At least 3.5 characters (1.75 ms from 19200 baud up), and more than the
    // latency of an adapter that delivers bytes in batches.
    FramerRtu(std::uint8_t unit, hal::Duration gap) : unit_(unit), gap_(gap) {}

    // Consumes bytes that arrived at `at` from the front of `bytes` until one request for this unit or a broadcast
    // (unit 0: executed, not answered) is complete, or none are left. Call again with the rest.
    [[nodiscard]] std::optional<Request> take(std::span<const std::uint8_t>& bytes, hal::TimePoint at);

  private:
    // State of the frame that begins in frame_.
    enum class Shape : std::uint8_t { incomplete, frame, damaged };
    [[nodiscard]] Shape shape(std::size_t& size) const;
    [[nodiscard]] bool good(std::size_t size) const;

    const std::uint8_t unit_;
    const hal::Duration gap_;
    std::array<std::uint8_t, kMaxRtuFrame> frame_{};
    std::size_t filled_ = 0;
    bool deaf_ = false;
    std::optional<hal::TimePoint> last_at_;
};

}  // namespace hord::firmware::modbus
