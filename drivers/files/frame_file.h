// One recorded frame from a file, and one to a file. Blocking; any thread.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "common/frame.h"
#include "common/result.h"

namespace hord::drivers {

// What the caller insists on; 0 accepts what the file has.
struct ExpectedFrame {
    int width_px = 0;
    int height_px = 0;
    // Meaningful bits of a sample. A 16-bit file may hold 9- to 15-bit samples, right-aligned: it does not say so
    // itself, so say it here; a sample beyond it makes the file refused.
    int bits = 0;
};

// Reads PNG, TIFF (as it is, LZW, deflate or PackBits) or binary PGM, 8- or 16-bit grey. Fails with not_found;
// unreadable (no permission, not an image, cut off, damaged); unsupported (colour, palette, alpha, JPEG, other depths
// or packings); invalid_argument (not what was expected). The message names the file and the cure. Nothing of a cut-off
// file is ever returned.
Result<Frame> read_frame(const std::filesystem::path& file, const ExpectedFrame& expected = {});

// The same of a file's bytes; `name` goes into the message.
Result<Frame> decode_frame(std::span<const std::byte> bytes, const std::string& name,
                           const ExpectedFrame& expected = {});

// The files themselves; a folder stands for its PNG, TIFF and PGM files (.png .tif .tiff .pgm), sorted by name,
// everything else in it is left alone. Fails with not_found (a folder without a frame, nothing named), unreadable (a
// folder).
Result<std::vector<std::filesystem::path>> list_frames(const std::vector<std::filesystem::path>& files_or_folders);

// Writes a PNG, 8- or 16-bit grey (9- to 15-bit samples right-aligned). The file appears whole or not at all.
// Fails with not_found (the folder), io, invalid_argument (an empty frame).
Result<void> write_frame(const std::filesystem::path& file, const FrameView& frame);

}  // namespace hord::drivers
