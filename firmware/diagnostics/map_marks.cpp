#include "firmware/diagnostics/map_marks.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "firmware/diagnostics/drawing.h"
#include "firmware/diagnostics/map_images.h"

namespace hord::firmware {
namespace {

constexpr int kLetters = 12, kDescent = 5;  // px, of a label, above and below its base line

// The label of mark `k` is beside its circle, or below it where the map ends. Where it would cover a circle or an
// earlier label, it takes the next free line below or above, if there is one.
void place_label(std::span<Mark> marks, std::size_t k, const cv::Size& map) {
    constexpr int kLine = kLetters + kDescent, kMaxLines = 8;
    Mark& mark = marks[k];
    const int right = mark.centre.x + mark.radius + 3,
              left = std::max(0, std::min(right, map.width - mark.text.width - 2));
    const bool beside = left == right;
    const int down = mark.centre.y + (beside ? 4 - kLetters : mark.radius + 2),
              up = beside ? down - kLine : mark.centre.y - mark.radius - 2 - kLine;
    const auto is_free = [&](int top) {
        mark.text.y = top;
        if (top < 0 || top + kLine > map.height) return false;
        const auto covers = [&](const cv::Rect& other) { return (other & mark.text).area() > 0; };
        return std::ranges::none_of(marks, [&](const Mark& one) { return covers(one.circle()); }) &&
            std::ranges::none_of(marks.first(k), [&](const Mark& one) { return covers(one.text); });
    };
    mark.text.x = left;
    for (int line = 0; line < kMaxLines; ++line) {
        if (is_free(down + line * kLine) || is_free(up - line * kLine)) return;
    }
    mark.text.y = down;
}

}  // namespace

std::vector<Mark> marks_of(std::span<const algo::Defect> defects, std::span<const std::string> labels, int zoom,
                           const cv::Size& map) {
    std::vector<Mark> marks;
    for (std::size_t k = 0; k < std::min(defects.size(), kMaxMarked); ++k) {
        Mark mark;
        mark.centre = {static_cast<int>((defects[k].m + 0.5F) * static_cast<float>(zoom)),
                       static_cast<int>((defects[k].n + 0.5F) * static_cast<float>(zoom))};
        const double radius_lenslets = std::sqrt(static_cast<double>(defects[k].area) / 3.14159) + 2.0;
        mark.radius = std::max(8, static_cast<int>(radius_lenslets * zoom));
        mark.label = k < labels.size() ? fmt::format("{} {}", k + 1, labels[k]) : std::to_string(k + 1);
        mark.text = {0, 0, cv::getTextSize(mark.label, cv::FONT_HERSHEY_SIMPLEX, 0.45, 1, nullptr).width,
                     kLetters + kDescent};
        marks.push_back(std::move(mark));
    }
    for (std::size_t k = 0; k < marks.size(); ++k) place_label(marks, k, map);
    return marks;
}

void draw_defects(cv::Mat& map, std::span<const algo::Defect> defects, std::span<const std::string> labels, int zoom) {
    const std::vector<Mark> marks = marks_of(defects, labels, zoom, map.size());
    for (const Mark& mark : marks) {
        cv::circle(map, mark.centre, mark.radius + 1, cv::Scalar(255, 255, 255), 3, cv::LINE_AA);
        cv::circle(map, mark.centre, mark.radius, kMark, 2, cv::LINE_AA);
    }
    for (std::size_t k = 0; k < marks.size(); ++k) {
        const cv::Point at(marks[k].text.x, marks[k].text.y + kLetters);
        if (k < labels.size()) {  // legible on any colour
            cv::putText(map, marks[k].label, at, cv::FONT_HERSHEY_SIMPLEX, 0.45, cv::Scalar(255, 255, 255),
                        kLabelOutline, cv::LINE_AA);
        }
        write_text(map, marks[k].label, at, 0.45, kMark);
    }
}

}  // namespace hord::firmware
