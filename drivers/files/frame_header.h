// Checks the headers and the completeness of an image file before it is decoded: PNG, TIFF, binary PGM.
//
// A decoder does not notice damage behind the data that it needs. So the whole file is checked here first: all PNG
// chunks up to IEND with their checksums, all TIFF strips or tiles, all PGM rows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "common/result.h"

namespace hord::drivers {

struct FrameHeader {
    enum class Format : std::uint8_t { png, tiff, pgm };
    Format format = Format::png;
    int width_px = 0;  // after turning by a TIFF's orientation tag
    int height_px = 0;
    int bits = 8;                // 8 or 16 for PNG and TIFF; 8..16 by a PGM's maximum
    std::size_t samples_at = 0;  // PGM: offset of the samples
};

// `file` is the whole file; `name` is used in the messages. Fails with unreadable (not one of these formats, truncated,
// damaged) or unsupported (colour, palette, alpha, other depths, several pages, larger than any light field).
Result<FrameHeader> read_frame_header(std::span<const std::byte> file, std::string_view name);

}  // namespace hord::drivers
