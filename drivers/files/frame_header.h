// What an image file says of itself, checked before anything is decoded: PNG, TIFF, binary PGM.
//
// A decoder stops where it has what it wants: what is cut off or changed behind that, it never sees. So the file is
// walked here first: every PNG chunk up to IEND with its checksum, every TIFF strip or tile inside the file, every PGM
// row.
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
    int width_px = 0;  // of the frame, turned to the orientation that a TIFF may name
    int height_px = 0;
    int bits = 8;                // 8 or 16 for PNG and TIFF; a PGM's maximum says 8..16
    std::size_t samples_at = 0;  // PGM: where the samples begin
};

// `file` is the whole file, `name` goes into the messages. Fails with unreadable (not one of these formats, cut off,
// damaged) or unsupported (colour, palette, alpha, other depths, several pages, larger than any light field).
Result<FrameHeader> read_frame_header(std::span<const std::byte> file, std::string_view name);

}  // namespace hord::drivers
