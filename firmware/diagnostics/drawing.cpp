#include "firmware/diagnostics/drawing.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

namespace hord::firmware {

int enlargement(int side) {
    constexpr int kMapSide = 444;  // pictures are enlarged until their longer side has at least this many pixels
    return std::max(1, (kMapSide + side - 1) / side);
}

int scaled(int px, float letters) { return static_cast<int>(std::lround(static_cast<float>(px) * letters)); }

void write_text(cv::Mat& image, const std::string& text, cv::Point at, double size, const cv::Scalar& colour) {
    const int thickness = std::max(1, static_cast<int>(std::lround(1.6 * size)));
    cv::putText(image, text, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, thickness, cv::LINE_AA);
}

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

}  // namespace hord::firmware
