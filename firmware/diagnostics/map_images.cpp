#include "firmware/diagnostics/map_images.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/file_writing.h"
#include "common/png_codec.h"
#include "common/statistics.h"
#include "common/tiff_codec.h"

namespace hord::firmware {
namespace {

constexpr int kMapSide = 444;  // pictures are enlarged until their longer side has at least this many pixels
constexpr int kTitleHeight = 26;
constexpr int kScaleWidth = 92;
const cv::Scalar kInk(40, 40, 40);
const cv::Scalar kPaper(255, 255, 255);

int enlargement(int side) { return std::max(1, (kMapSide + side - 1) / side); }

void write_text(cv::Mat& image, const std::string& text, cv::Point at, double size, const cv::Scalar& colour = kInk) {
    cv::putText(image, text, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
}

// Largest text size up to `size` at which `text` fits into `width` pixels.
double fitting(const std::string& text, int width, double size) {
    int baseline = 0;
    const int needed = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, size, 1, &baseline).width;
    return needed <= width ? size : size * width / needed;
}

Picture to_picture(const cv::Mat& image) {
    Picture picture{image.cols, image.rows, {}};
    picture.bgr.assign(image.datastart, image.dataend);
    return picture;
}

cv::Mat to_mat(const Picture& picture) {
    return {picture.height, picture.width, CV_8UC3, const_cast<unsigned char*>(picture.bgr.data())};
}

void draw_scale(cv::Mat& sheet, const MapPicture& what, int top, int height) {
    const int left = sheet.cols - kScaleWidth + 8;
    cv::Mat ramp(height, 1, CV_8U);
    for (int y = 0; y < height; ++y)
        ramp.at<unsigned char>(y) = static_cast<unsigned char>(255 - 255 * y / std::max(1, height - 1));
    cv::Mat colours;
    cv::applyColorMap(ramp, colours, cv::COLORMAP_VIRIDIS);
    cv::resize(colours, sheet(cv::Rect(left, top, 14, height)), cv::Size(14, height), 0, 0, cv::INTER_NEAREST);
    constexpr int kTicks = 4;
    for (int k = 0; k <= kTicks; ++k) {
        const int y = top + (height - 1) * k / kTicks;
        const float value = what.high + (what.low - what.high) * static_cast<float>(k) / kTicks;
        cv::line(sheet, {left + 14, y}, {left + 18, y}, kInk);
        write_text(sheet, fmt::format("{:.3g}", value), {left + 21, std::clamp(y + 4, top + 9, top + height - 1)},
                   0.36);
    }
    write_text(sheet, what.unit, {left - 4, top - 8}, fitting(what.unit, kScaleWidth - 6, 0.36));
}

void draw_defects(cv::Mat& map, std::span<const algo::Defect> defects, std::span<const std::string> labels, int zoom) {
    constexpr std::size_t kMax = 20;
    for (std::size_t k = 0; k < std::min(defects.size(), kMax); ++k) {
        const algo::Defect& defect = defects[k];
        const cv::Point centre(static_cast<int>((defect.m + 0.5F) * static_cast<float>(zoom)),
                               static_cast<int>((defect.n + 0.5F) * static_cast<float>(zoom)));
        const double radius_lenslets = std::sqrt(static_cast<double>(defect.area) / 3.14159) + 2.0;
        const int radius = std::max(8, static_cast<int>(radius_lenslets * zoom));
        cv::circle(map, centre, radius + 1, cv::Scalar(255, 255, 255), 3, cv::LINE_AA);
        cv::circle(map, centre, radius, cv::Scalar(40, 40, 230), 2, cv::LINE_AA);
        const std::string label = k < labels.size() ? fmt::format("{} {}", k + 1, labels[k]) : std::to_string(k + 1);
        const int width = cv::getTextSize(label, cv::FONT_HERSHEY_SIMPLEX, 0.45, 1, nullptr).width;
        const int right = centre.x + radius + 3, left = std::max(0, std::min(right, map.cols - width - 2));
        const int below = left < right ? radius + 14 : 4;  // where it does not fit beside the circle
        if (k < labels.size()) {                           // legible on any colour
            cv::putText(map, label, {left, centre.y + below}, cv::FONT_HERSHEY_SIMPLEX, 0.45, cv::Scalar(255, 255, 255),
                        3, cv::LINE_AA);
        }
        write_text(map, label, {left, centre.y + below}, 0.45, cv::Scalar(40, 40, 230));
    }
}

}  // namespace

MapPicture scale_to(std::string title, std::string unit, algo::Map map, std::span<const std::uint8_t> mask,
                    float limit) {
    std::vector<float> judged;
    for (std::size_t k = 0; k < map.size(); ++k) {
        if (mask[k] == algo::kValid) judged.push_back(map[k]);
    }
    float low = 0, high = limit;
    if (!judged.empty()) {
        low = std::min(low, *std::min_element(judged.begin(), judged.end()));
        high = std::max(high, common::nth_smallest(std::span(judged), (judged.size() - 1) * 999 / 1000));
    }
    if (!(high > low)) high = low + 1;
    return {std::move(title), std::move(unit), low, high};
}

Picture draw(const MapPicture& what, algo::Map map, std::span<const std::uint8_t> mask, const algo::Extents& extents,
             std::span<const algo::Defect> defects, std::span<const std::string> labels, const std::string& caption) {
    cv::Mat level(extents.n, extents.m, CV_8U);
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m) {
            const float share = (map[static_cast<std::size_t>(n * extents.m + m)] - what.low) / (what.high - what.low);
            level.at<unsigned char>(n, m) =
                static_cast<unsigned char>(std::lround(255.0F * std::clamp(share, 0.0F, 1.0F)));
        }
    }
    cv::Mat colours;
    cv::applyColorMap(level, colours, cv::COLORMAP_VIRIDIS);
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m) {
            const std::uint8_t bits = mask[static_cast<std::size_t>(n * extents.m + m)];
            auto& pixel = colours.at<cv::Vec3b>(n, m);
            if ((bits & (algo::kDark | algo::kSaturated | algo::kBorder)) != 0) {
                const unsigned char grey = (bits & algo::kSaturated) != 0 ? 225 : 120;
                pixel = {grey, grey, grey};
            } else if (bits != algo::kValid) {
                for (int channel = 0; channel < 3; ++channel)
                    pixel[channel] = static_cast<unsigned char>(pixel[channel] / 2 + 60);
            }
        }
    }
    const int zoom = enlargement(std::max(extents.m, extents.n));
    cv::Mat map_picture;
    cv::resize(colours, map_picture, {}, zoom, zoom, cv::INTER_NEAREST);
    draw_defects(map_picture, defects, labels, zoom);

    const int foot = caption.empty() ? 0 : kTitleHeight;
    cv::Mat sheet(map_picture.rows + kTitleHeight + foot, map_picture.cols + kScaleWidth, CV_8UC3, kPaper);
    if (foot > 0) write_text(sheet, caption, {4, sheet.rows - 8}, fitting(caption, sheet.cols - 8, 0.5));
    map_picture.copyTo(sheet(cv::Rect(0, kTitleHeight, map_picture.cols, map_picture.rows)));
    write_text(sheet, what.title, {4, 18}, fitting(what.title, map_picture.cols - 8, 0.5));
    draw_scale(sheet, what, kTitleHeight, map_picture.rows);
    return to_picture(sheet);
}

Picture draw(const std::string& title, const FrameView& frame, const algo::Extents& extents) {
    cv::Mat samples(frame.height_px, frame.width_px, frame.bits > 8 ? CV_16U : CV_8U,
                    const_cast<std::byte*>(frame.data), static_cast<std::size_t>(frame.stride_bytes));
    // Most bins are dark: reduced and stretched to the brightest pixel, else the picture would be black.
    const int zoom = enlargement(std::max(extents.m, extents.n));
    cv::Mat reduced, resized;
    cv::resize(samples, reduced, cv::Size(extents.m * zoom, extents.n * zoom), 0, 0, cv::INTER_AREA);
    double brightest = 0;
    cv::minMaxLoc(reduced, nullptr, &brightest);
    reduced.convertTo(resized, CV_8U, brightest > 0 ? 255.0 / brightest : 0.0);
    cv::Mat sheet(resized.rows + kTitleHeight, resized.cols, CV_8UC3, kPaper);
    cv::Mat inner = sheet(cv::Rect(0, kTitleHeight, resized.cols, resized.rows));
    cv::cvtColor(resized, inner, cv::COLOR_GRAY2BGR);
    write_text(sheet, title, {4, 18}, fitting(title, resized.cols - 8, 0.5));
    return to_picture(sheet);
}

Picture montage(std::span<const MontageRow> rows) {
    constexpr int kGap = 8;
    constexpr int kLabelWidth = 110;
    int width = 0, height = kGap;
    for (const MontageRow& row : rows) {
        int row_width = kLabelWidth + kGap, row_height = 0;
        for (const Picture& picture : row.pictures) {
            row_width += picture.width + kGap;
            row_height = std::max(row_height, picture.height);
        }
        width = std::max(width, row_width);
        height += row_height + kGap;
    }
    cv::Mat sheet(height, std::max(width, 1), CV_8UC3, kPaper);
    int y = kGap;
    for (const MontageRow& row : rows) {
        int x = kLabelWidth + kGap, row_height = 0;
        for (const Picture& picture : row.pictures) {
            to_mat(picture).copyTo(sheet(cv::Rect(x, y, picture.width, picture.height)));
            x += picture.width + kGap;
            row_height = std::max(row_height, picture.height);
        }
        // One word a line, so that long labels fit.
        int line = y + row_height / 2 - 8;
        for (std::size_t from = 0; from < row.label.size();) {
            const std::size_t to = std::min(row.label.find(' ', from), row.label.size());
            write_text(sheet, row.label.substr(from, to - from), {kGap, line},
                       fitting(row.label.substr(from, to - from), kLabelWidth - 4, 0.5));
            line += 18;
            from = to + 1;
        }
        y += row_height + kGap;
    }
    return to_picture(sheet);
}

Result<std::vector<std::uint8_t>> encode_png(const Picture& picture) {
    return common::encode_bgr_png(picture.width, picture.height, picture.bgr);
}

Result<void> write_png(const std::filesystem::path& file, const Picture& picture) {
    return encode_png(picture).and_then([&](const auto& bytes) { return common::write_atomically(file, bytes); });
}

Result<void> write_float_tiff(const std::filesystem::path& file, algo::Map map, const algo::Extents& extents) {
    return common::encode_float_tiff(extents.m, extents.n, map).and_then([&](const auto& bytes) {
        return common::write_atomically(file, bytes);
    });
}

}  // namespace hord::firmware
