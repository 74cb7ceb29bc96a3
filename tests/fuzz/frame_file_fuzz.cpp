// Arbitrary bytes as a frame file: the result must be a frame whose size the bytes can hold, or an error that names the
// file. The first byte chooses the decoder: a frame file, a TIFF, or a kept frame. The checksums of a PNG are
// corrected; otherwise libpng would reject nearly every input.
#include <cstdlib>
#include <cstring>
#include <vector>

#include <zlib.h>

#include "common/png_codec.h"
#include "common/tiff_codec.h"
#include "drivers/files/frame_file.h"

namespace {

void repair_checksums(std::vector<std::uint8_t>& file) {
    if (file.size() < 8 || std::memcmp(file.data(), "\x89PNG\r\n\x1a\n", 8) != 0) return;
    for (std::size_t at = 8; file.size() - at >= 12;) {
        const std::size_t length = std::size_t{file[at]} << 24U | std::size_t{file[at + 1]} << 16U |
            std::size_t{file[at + 2]} << 8U | file[at + 3];
        if (length > file.size() - at - 12) return;
        const auto sum = static_cast<std::uint32_t>(crc32(0, file.data() + at + 4, static_cast<uInt>(4 + length)));
        for (unsigned k = 0; k < 4; ++k) file[at + 8 + length + k] = static_cast<std::uint8_t>(sum >> (24 - 8 * k));
        at += 12 + length;
    }
}

void check(const hord::Result<hord::Frame>& read, std::size_t file_size) {
    if (!read) {
        if (read.error().what.find("the.file") == std::string::npos || read.error().cure.empty()) std::abort();
        return;
    }
    const auto view = read->view();
    if (read->bytes().size() > 2731 * file_size) std::abort();
    for (int y = 0; y < view.height_px; ++y) {
        for (int x = 0; x < view.width_px; ++x) {
            if (view.sample(x, y) > view.full_scale()) std::abort();
        }
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord;
    if (size == 0) return 0;
    std::vector<std::uint8_t> file(data + 1, data + size);
    repair_checksums(file);
    switch (data[0] % 3) {
        case 0:
            check(drivers::decode_frame(std::as_bytes(std::span(file)), "the.file", {.bits = data[0] >= 128 ? 12 : 0}),
                  file.size());
            break;
        case 1: check(common::decode_grey_tiff(file, "the.file"), file.size()); break;
        default:
            check(
                common::decode_grey_png(file, "the.file", "hord").and_then([](common::GreyPng&& png) -> Result<Frame> {
                    // Another depth comes from the note of a kept frame; samples are not checked against it.
                    if (png.frame.bits() != 8 && png.frame.bits() != 16) {
                        return Frame(png.frame.width_px(), png.frame.height_px(), png.frame.bits());
                    }
                    return std::move(png.frame);
                }),
                file.size());
    }
    return 0;
}
