// Frames and comparisons for the tests of the image codecs.
#pragma once

#include <algorithm>
#include <cstring>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "common/frame.h"

namespace hord::common {

using Bytes = std::vector<std::uint8_t>;

// A test pattern: neighbouring samples differ, and both bytes of a 16-bit sample vary.
inline Frame pattern(int width, int height, int bits) {
    Frame frame(width, height, bits);
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x)
            frame.set(x, y, static_cast<std::uint32_t>(x * 2531 + y * 40503) & frame.view().full_scale());
    }
    return frame;
}

inline bool same(const Frame& a, const Frame& b) {
    return a.width_px() == b.width_px() && a.height_px() == b.height_px() && std::ranges::equal(a.bytes(), b.bytes());
}

inline cv::Mat decoded(const Bytes& file) { return cv::imdecode(file, cv::IMREAD_UNCHANGED); }

inline bool same(const Frame& frame, const cv::Mat& image) {
    return image.isContinuous() && image.type() == (frame.bits() > 8 ? CV_16UC1 : CV_8UC1) &&
        image.cols == frame.width_px() && image.rows == frame.height_px() &&
        std::memcmp(image.data, frame.bytes().data(), frame.bytes().size()) == 0;
}

}  // namespace hord::common
