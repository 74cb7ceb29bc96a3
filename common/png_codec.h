// PNG in memory, by libpng: reads and writes grey frames, writes colour pictures and palette images. Any thread; prints
// nothing.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/frame.h"
#include "common/frame_size.h"
#include "common/result.h"

namespace hord::common {

// zlib's settings. Run-length matches only (Z_RLE) are several times faster than general matches.
struct PngPacking {
    int level = 1;  // 1 (fast) to 9 (small)
    bool runs_only = true;
};

// Metadata of a frame, in an iTXt chunk.
struct PngNote {
    std::string keyword;  // 1 to 79 Latin-1 characters
    std::string text;     // UTF-8
};

// 8- or 16-bit grey; 9- to 15-bit samples are right-aligned. With a note, sBIT holds the frame's bits; without one the
// file has only the samples. Fails with invalid_argument (an empty frame), internal.
Result<std::vector<std::uint8_t>> encode_grey_png(const FrameView& frame, const PngPacking& packing = {},
                                                  const std::optional<PngNote>& note = std::nullopt);

// 8-bit colour from blue, green, red; rows unpadded. Fails with invalid_argument (no pixels, or not 3 bytes each),
// internal.
Result<std::vector<std::uint8_t>> encode_bgr_png(int width_px, int height_px, std::span<const std::uint8_t> bgr);

struct PngColour {
    std::uint8_t red = 0, green = 0, blue = 0;
};

// 8-bit indexes into `palette` (1 to 256 colours); rows unpadded. The note goes into an iTXt chunk. Fails with
// invalid_argument (no pixels, another number of indexes, an index beyond the palette), internal.
Result<std::vector<std::uint8_t>> encode_index_png(int width_px, int height_px, std::span<const std::uint8_t> indexes,
                                                   std::span<const PngColour> palette,
                                                   const std::optional<PngNote>& note = std::nullopt);

struct GreyPng {
    Frame frame;                      // 8 or 16 bits; if a note was requested, the bits of sBIT
    std::optional<std::string> note;  // the last one with the requested keyword
    std::size_t length = 0;           // of the PNG in bytes; data after it is ignored
};

// Grey of 8 or 16 bits, interlaced or not. Checks every chunk's checksum. Memory is limited: for the samples to what
// the bytes can decompress to, for a note to 8 MB; other chunks are skipped. `name` is used in the message. Fails with
// unreadable (truncated, damaged), unsupported (not grey, too large) and as `accept`.
Result<GreyPng> decode_grey_png(std::span<const std::uint8_t> bytes, std::string_view name,
                                const std::string& note_keyword = {}, const AcceptSize& accept = {});

}  // namespace hord::common
