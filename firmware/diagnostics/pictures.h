// Pictures in colour: of a raw frame, many beside one another, as PNG.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::firmware {

// An 8-bit BGR picture, rows unpadded.
struct Picture {
    int width = 0;
    int height = 0;
    std::vector<unsigned char> bgr;
};

// The raw frame, as grey, reduced to about the size of a map's picture and stretched to its brightest pixel.
Picture draw(const std::string& title, const FrameView& frame, const algo::Extents& extents);

// Rows of pictures, in columns, with a label on the left of each row, its letters this large.
struct MontageRow {
    std::string label;
    std::vector<Picture> pictures;
};
Picture montage(std::span<const MontageRow> rows, float letters = 1);

// The picture at half its size, averaged.
Picture halved(const Picture& picture);

// The picture as the bytes of a PNG file. Fails with invalid_argument (no pixels), internal.
Result<std::vector<std::uint8_t>> encode_png(const Picture& picture);

// The file appears whole or not at all. Fails with not_found (the folder) and io, naming the file and the cure; with
// invalid_argument (no pixels), internal.
Result<void> write_png(const std::filesystem::path& file, const Picture& picture);

}  // namespace hord::firmware
