// TIFF in memory, with libtiff: grey frames are read, maps of floats are written. Any thread; nothing is printed.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "common/frame.h"
#include "common/result.h"

namespace hord::common {

// The first image: one channel of 8 or 16 bits, unsigned, in strips or tiles, either byte order, as it is or packed
// with LZW, deflate or PackBits; turned to the orientation that it names. No more memory and time are taken than the
// bytes can unpack to. `name` goes into the message. Fails with unreadable (damaged, cut off), unsupported (another
// layout or packing).
Result<Frame> decode_grey_tiff(std::span<const std::uint8_t> bytes, std::string_view name);

// One channel of 32-bit floats, unpacked, in this machine's byte order. `values` holds width * height, row by row.
// Fails with invalid_argument (not as many, or none), internal.
Result<std::vector<std::uint8_t>> encode_float_tiff(int width_px, int height_px, std::span<const float> values);

}  // namespace hord::common
