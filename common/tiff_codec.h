// TIFF in memory, by libtiff: reads and writes grey frames, writes maps of floats. Any thread; prints nothing.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "common/frame.h"
#include "common/frame_size.h"
#include "common/result.h"

namespace hord::common {

// The only image: one channel of 8 or 16 bits, unsigned, in strips or tiles, either byte order, uncompressed or with
// LZW, deflate or PackBits; turned by its orientation tag. Memory and time are limited to what the bytes can decompress
// to. `name` is used in the message. Fails with unreadable (damaged, truncated), unsupported (another layout or
// compression, several images).
Result<Frame> decode_grey_tiff(std::span<const std::uint8_t> bytes, std::string_view name,
                               const AcceptSize& accept = {});

// One channel of 32-bit floats, uncompressed, in this machine's byte order. `values` has width * height, row by row.
// Fails with invalid_argument (another number of values, or none), internal.
Result<std::vector<std::uint8_t>> encode_float_tiff(int width_px, int height_px, std::span<const float> values);

// One channel of 8 bits, or of 16 for frames above 8 bits (right-aligned), uncompressed, in this machine's byte order.
// Fails with internal.
Result<std::vector<std::uint8_t>> encode_grey_tiff(const FrameView& frame);

}  // namespace hord::common
