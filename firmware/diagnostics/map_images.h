// Maps as pictures: pseudocolours with axes, scale, legend and marked defects.
#pragma once

#include <span>
#include <string>

#include "algo/frame/extents.h"
#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "firmware/diagnostics/feature_views.h"
#include "firmware/diagnostics/pictures.h"

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

}  // namespace hord::firmware
