// Circles and labels of defects on an enlarged map. Needs OpenCV; for sources of this folder alone.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "algo/inspection/pipeline.h"

namespace hord::firmware {

constexpr int kLabelOutline = 3;  // px, around the letters

// Circle and label of a defect, in pixels of the enlarged map.
struct Mark {
    cv::Point centre;
    int radius = 0;
    std::string label;
    cv::Rect text;  // the letters of the label, and what of them is below the base line

    [[nodiscard]] cv::Rect circle() const { return {centre.x - radius, centre.y - radius, 2 * radius, 2 * radius}; }
};

// Of the first kMaxMarked (map_images.h). `map`: size of the enlarged map, px.
std::vector<Mark> marks_of(std::span<const algo::Defect> defects, std::span<const std::string> labels, int zoom,
                           const cv::Size& map);

// Draws the marks. Labels are above all circles.
void draw_defects(cv::Mat& map, std::span<const algo::Defect> defects, std::span<const std::string> labels, int zoom);

}  // namespace hord::firmware
