// PNG in memory, with libpng: grey frames both ways, colour pictures to be looked at. Any thread; nothing is printed.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/frame.h"
#include "common/result.h"

namespace hord::common {

// How a PNG is packed. Runs alone (zlib's Z_RLE) are found several times faster than any repetition.
struct PngPacking {
    int level = 1;  // zlib's, 1 (fast) to 9 (small)
    bool runs_only = true;
};

// What is said of a frame beside its samples.
struct PngNote {
    std::string keyword;  // of an iTXt chunk, 1 to 79 Latin-1 characters
    std::string text;     // UTF-8
};

// 8- or 16-bit grey; 9- to 15-bit samples are right-aligned. With a note the frame's bits stand in sBIT, too; without
// one the file holds the samples alone. Fails with invalid_argument (an empty frame), internal.
Result<std::vector<std::uint8_t>> encode_grey_png(const FrameView& frame, const PngPacking& packing = {},
                                                  const std::optional<PngNote>& note = std::nullopt);

// 8-bit colour from blue, green, red; rows unpadded. Fails with invalid_argument (no pixels, or not 3 bytes each),
// internal.
Result<std::vector<std::uint8_t>> encode_bgr_png(int width_px, int height_px, std::span<const std::uint8_t> bgr);

struct GreyPng {
    Frame frame;                      // 8 bits; or 16, or what sBIT says where a note was asked for
    std::optional<std::string> note;  // the last of the asked keyword; not looked for without one
    std::size_t length = 0;           // of the PNG: what is behind it in the bytes is not its own
};

// Grey of 8 or 16 bits, interlaced or not. Every chunk's checksum is compared. No more memory is taken for the samples
// than the bytes can unpack to, and for a note 8 MB; other chunks are skipped. `name` goes into the message. Fails with
// unreadable.
Result<GreyPng> decode_grey_png(std::span<const std::uint8_t> bytes, std::string_view name,
                                const std::string& note_keyword = {});

}  // namespace hord::common
