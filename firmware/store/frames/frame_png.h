// A frame and its metadata as one lossless PNG.
//
// Grey, 8 or 16 bits; 9- to 15-bit samples are right-aligned and their depth stands in sBIT. The metadata is UTF-8 text
// (JSON, frame_metadata.h) in an iTXt chunk "hord". Any thread.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/frame.h"
#include "common/result.h"

namespace hord::firmware::store {

struct AnnotatedFrame {
    Frame frame;
    std::string metadata;
};

// `level` is zlib's, 1 (fast) to 9 (small). Fails with invalid_argument (an empty frame), internal.
Result<std::vector<std::uint8_t>> encode_png(const FrameView& frame, std::string_view metadata, int level = 1);

// Checks every chunk's checksum. Fails with unreadable (a byte missing, changed or added). `name`: for the message.
Result<AnnotatedFrame> decode_png(std::span<const std::uint8_t> bytes, const std::string& name);

// Fails with not_found and as decode_png().
Result<AnnotatedFrame> read_annotated_frame(const std::filesystem::path& file);

// SHA-256 of the samples, rows unpadded, in hexadecimal.
std::string digest_of_samples(const FrameView& frame);

}  // namespace hord::firmware::store
