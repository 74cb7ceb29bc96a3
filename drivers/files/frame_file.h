// Reads and writes a frame as a file. Blocking; any thread.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "common/frame.h"
#include "common/result.h"

namespace hord::drivers {

// The required format; 0 accepts any.
struct ExpectedFrame {
    int width_px = 0;
    int height_px = 0;
    // Significant bits of a sample. A 16-bit file may have right-aligned samples of 9 to 15 bits, which is not stated
    // in the file. A file with a larger sample is refused.
    int bits = 0;
};

// Reads PNG, TIFF (uncompressed, LZW, deflate or PackBits) or binary PGM, 8- or 16-bit grey. Fails with not_found;
// unreadable (no permission, not an image, truncated, damaged); unsupported (colour, palette, alpha, JPEG, other depths
// or compressions); invalid_argument (not the required format). A truncated file never returns a frame.
Result<Frame> read_frame(const std::filesystem::path& file, const ExpectedFrame& expected = {});

// The same from a file's bytes; `name` is used in the message.
Result<Frame> decode_frame(std::span<const std::byte> bytes, const std::string& name,
                           const ExpectedFrame& expected = {});

// Replaces each folder by its PNG, TIFF and PGM files (.png .tif .tiff .pgm), sorted by name. Fails with not_found (a
// folder without a frame, no name given), unreadable (a folder).
Result<std::vector<std::filesystem::path>> list_frames(const std::vector<std::filesystem::path>& files_or_folders);

// Writes a PNG, 8- or 16-bit grey (9- to 15-bit samples right-aligned). The file is replaced atomically.
// Fails with not_found (the folder), io, invalid_argument (an empty frame).
Result<void> write_frame(const std::filesystem::path& file, const FrameView& frame);

}  // namespace hord::drivers
