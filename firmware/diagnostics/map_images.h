// Maps as image files: float TIFF, pseudocolour PNG with a scale, montage.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/inspection/pipeline.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::firmware {

// What a pseudocolour picture shows. Colours run from `low` to `high` (viridis: dark blue to yellow); values outside
// have the end colours. Lenslets without a valid value are grey, valid ones that are not judged (rim, outside the
// inspection zones) keep their colour, dimmed. Defects are circled and numbered, the largest peak first; with `labels`,
// each has its own text; `caption`, a sentence, goes below the map.
struct MapPicture {
    std::string title;  // drawn above the map
    std::string unit;   // drawn at the scale
    float low = 0;
    float high = 1;
};

// An 8-bit BGR picture, rows unpadded.
struct Picture {
    int width = 0;
    int height = 0;
    std::vector<unsigned char> bgr;
};

// The range of a map's judged values: low = 0 (or the smallest, if negative), high = all but the largest thousandth,
// and at least `limit` (the recipe's, so that tolerated values look uniform); never equal.
MapPicture scale_to(std::string title, std::string unit, algo::Map map, std::span<const std::uint8_t> mask,
                    float limit);

// `map` and `mask` hold one value a lenslet, m*n of `extents`. Small maps are enlarged by whole factors.
Picture draw(const MapPicture& what, algo::Map map, std::span<const std::uint8_t> mask, const algo::Extents& extents,
             std::span<const algo::Defect> defects, std::span<const std::string> labels = {},
             const std::string& caption = {});

// The raw frame, as grey, reduced to about the size of a map's picture and stretched to its brightest pixel.
Picture draw(const std::string& title, const FrameView& frame, const algo::Extents& extents);

// Rows of pictures with a label on the left of each.
struct MontageRow {
    std::string label;
    std::vector<Picture> pictures;
};
Picture montage(std::span<const MontageRow> rows);

// The picture as the bytes of a PNG file. Fails with invalid_argument (no pixels), internal.
Result<std::vector<std::uint8_t>> encode_png(const Picture& picture);

// The file appears whole or not at all. Fail with not_found (the folder) and io, naming the file and the cure; with
// invalid_argument (nothing in it, or a map of another size), internal.
Result<void> write_png(const std::filesystem::path& file, const Picture& picture);
Result<void> write_float_tiff(const std::filesystem::path& file, algo::Map map, const algo::Extents& extents);

}  // namespace hord::firmware
