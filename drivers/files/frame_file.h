// Reads and writes a frame as a file. Blocking; any thread.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/frame.h"
#include "common/result.h"
#include "drivers/files/frame_geometry.h"

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

// A frame with its geometry note (drivers/files/frame_geometry.h), if its file has one.
struct NotedFrame {
    Frame frame;
    std::optional<FrameGeometry> geometry;
};

// read_frame() with the note of the PNG or of the sidecar. A note says how many bits the samples have: `expected.bits`
// counts only without one, and the caller compares. Also fails with unreadable (a damaged note, one that contradicts
// the frame, a PNG and a sidecar that contradict each other) and unsupported (a note of another schema).
Result<NotedFrame> read_noted_frame(const std::filesystem::path& file, const ExpectedFrame& expected = {});

// NAME.frame.json beside NAME.png, NAME.tiff or NAME.pgm.
std::filesystem::path sidecar_of(const std::filesystem::path& file);

// read_frame() from a file's bytes; `name` is used in the message.
Result<Frame> decode_frame(std::span<const std::byte> bytes, const std::string& name,
                           const ExpectedFrame& expected = {});

// Replaces each folder by its PNG, TIFF and PGM files (.png .tif .tiff .pgm) that are not hidden, sorted by name. Fails
// with not_found (a folder without a frame, no name given), unreadable (a folder).
Result<std::vector<std::filesystem::path>> list_frames(const std::vector<std::filesystem::path>& files_or_folders);

// Writes a PNG, 8- or 16-bit grey (9- to 15-bit samples right-aligned), with the note if there is one. The file is
// replaced atomically. Fails with not_found (the folder), refused (a link or device is there), io, invalid_argument (an
// empty frame).
Result<void> write_frame(const std::filesystem::path& file, const FrameView& frame,
                         const std::optional<FrameGeometry>& geometry = std::nullopt);

}  // namespace hord::drivers
