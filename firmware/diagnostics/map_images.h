// Maps as image files: float TIFF, mask PNG, pseudocolour PNG with axes, scale and legend, montage.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "common/frame.h"
#include "common/result.h"
#include "firmware/diagnostics/feature_views.h"

namespace hord::firmware {

// What a picture of a map shows. Colours run from `low` to `high` (viridis: dark blue to yellow); values outside
// have the end colours. Lenslets without a value are hatched grey, which the colour map does not have; lenslets with a
// value that is not judged (rim, outside the inspection zones) keep their colour, dimmed. A legend below the map
// explains both where they occur. Defects are circled and numbered, the worst first, at most kMaxMarked; "20 of 53
// shown" says that there are more. With `labels`, each has its own text; `caption`, a sentence, goes below.
struct MapPicture {
    std::string title;  // drawn above the map, with the unit
    std::string unit;   // drawn at the scale
    float low = 0;
    float high = 1;
    float limit = 0;                            // marked on the scale; 0: none
    std::string limit_text = {};                // beside the mark; empty: "limit 0.4"
    std::uint8_t no_value = algo::kNoGradient;  // mask bits of lenslets without a value. A NaN is none, either
    std::uint8_t not_judged = algo::kNotJudged;
    // Axes: numbers of lenslets, from that of the top-left one; or with the pitch of a lenslet, mm from the middle.
    int first_m = 0, first_n = 0;
    float lenslet_mm = 0;
    bool grey = false;  // a picture instead of a map: from black (low) to white (high)
    // For figures of many pictures: size of all letters, and whether axes and the legend of what is hatched are drawn.
    float letters = 1;
    bool axes = true;
};
constexpr std::size_t kMaxMarked = 20;

// An 8-bit BGR picture, rows unpadded.
struct Picture {
    int width = 0;
    int height = 0;
    std::vector<unsigned char> bgr;
};

// The range of a map's judged values: low = 0 (or the smallest, if negative), high = all but the largest thousandth,
// and at least `limit` (the recipe's, so that tolerated values look uniform); never equal. The limit is marked.
MapPicture scale_to(std::string title, std::string unit, algo::Map map, std::span<const std::uint8_t> mask,
                    float limit);

// The same of a view: no data, limit and axes are the view's and the recipe's.
MapPicture scale_to(std::string title, const FeatureView& view, const algo::Recipe& recipe);

// `map` and `mask` hold one value a lenslet, m*n of `extents`. Small maps are enlarged by whole factors.
Picture draw(const MapPicture& what, algo::Map map, std::span<const std::uint8_t> mask, const algo::Extents& extents,
             std::span<const algo::Defect> defects, std::span<const std::string> labels = {},
             const std::string& caption = {});

// The pixel at which a place of the map, in lenslets, is in such a picture with letters of size 1 and axes.
struct PicturePoint {
    int x = 0, y = 0;
};
PicturePoint point_in_picture(const algo::Extents& extents, float m, float n);

// The box around circle and label of defect `k` (below kMaxMarked) in such a picture, pixels. The box may reach beyond
// the edges of the picture.
struct PictureBox {
    int x = 0, y = 0, width = 0, height = 0;
};
PictureBox mark_in_picture(const algo::Extents& extents, std::span<const algo::Defect> defects,
                           std::span<const std::string> labels, std::size_t k);

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

// The file appears whole or not at all. Fail with not_found (the folder) and io, naming the file and the cure; with
// invalid_argument (nothing in it, or a map of another size), internal.
Result<void> write_png(const std::filesystem::path& file, const Picture& picture);
Result<void> write_float_tiff(const std::filesystem::path& file, algo::Map map, const algo::Extents& extents);

// The view as float TIFF: NaN where a lenslet has no value.
Result<void> write_float_tiff(const std::filesystem::path& file, const FeatureView& view, const algo::Extents& extents);

// Why lenslets have no value or are not judged: an 8-bit palette PNG, a pixel a lenslet, whose index is the mask value
// (algo/frame/mask.h). Its iTXt chunk "hord-mask" names feature, bits, colours, and the bits without a value, in JSON.
Result<void> write_mask_png(const std::filesystem::path& file, const FeatureView& view, const algo::Extents& extents);

}  // namespace hord::firmware
