#include "firmware/diagnostics/pictures.h"

#include <algorithm>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/file_writing.h"
#include "common/png_codec.h"
#include "firmware/diagnostics/drawing.h"

namespace hord::firmware {
namespace {

cv::Mat to_mat(const Picture& picture) {
    return {picture.height, picture.width, CV_8UC3, const_cast<unsigned char*>(picture.bgr.data())};
}

}  // namespace

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

Picture montage(std::span<const MontageRow> rows, float letters) {
    constexpr int kGap = 8;
    const int label_width = scaled(110, letters);
    std::vector<int> columns;  // their widths
    int height = kGap;
    for (const MontageRow& row : rows) {
        columns.resize(std::max(columns.size(), row.pictures.size()));
        int row_height = 0;
        for (std::size_t k = 0; k < row.pictures.size(); ++k) {
            columns[k] = std::max(columns[k], row.pictures[k].width);
            row_height = std::max(row_height, row.pictures[k].height);
        }
        height += row_height + kGap;
    }
    int width = label_width + kGap;
    for (const int column : columns) width += column + kGap;
    cv::Mat sheet(height, width, CV_8UC3, kPaper);
    int y = kGap;
    for (const MontageRow& row : rows) {
        int x = label_width + kGap, row_height = 0;
        for (std::size_t k = 0; k < row.pictures.size(); ++k) {
            const Picture& picture = row.pictures[k];
            to_mat(picture).copyTo(sheet(cv::Rect(x, y, picture.width, picture.height)));
            x += columns[k] + kGap;
            row_height = std::max(row_height, picture.height);
        }
        // One word a line, so that long labels fit.
        int line = y + row_height / 2 - 8;
        for (std::size_t from = 0; from < row.label.size();) {
            const std::size_t to = std::min(row.label.find(' ', from), row.label.size());
            write_text(sheet, row.label.substr(from, to - from), {kGap, line},
                       fitting(row.label.substr(from, to - from), label_width - 4, 0.5 * letters));
            line += scaled(18, letters);
            from = to + 1;
        }
        y += row_height + kGap;
    }
    return to_picture(sheet);
}

Picture halved(const Picture& picture) {
    const cv::Mat whole = to_mat(picture);
    cv::Mat half;
    cv::resize(whole, half, {picture.width / 2, picture.height / 2}, 0, 0, cv::INTER_AREA);
    return to_picture(half);
}

Result<std::vector<std::uint8_t>> encode_png(const Picture& picture) {
    return common::encode_bgr_png(picture.width, picture.height, picture.bgr);
}

Result<void> write_png(const std::filesystem::path& file, const Picture& picture) {
    return encode_png(picture).and_then([&](const auto& bytes) { return common::write_atomically(file, bytes); });
}

}  // namespace hord::firmware
