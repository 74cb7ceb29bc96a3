// See core.hpp.
#pragma once

#include <algorithm>
#include <utility>

#include "opencv2/core.hpp"

namespace cv {

// The largest value of the 3x3 neighbours.
inline void dilate(const Mat1b& from, Mat1b& to, const Mat& /*3x3*/) {
    to.create(from.rows, from.cols);
    for (int y = 0; y < from.rows; ++y) {
        for (int x = 0; x < from.cols; ++x) {
            unsigned char most = 0;
            for (int v = std::max(0, y - 1); v <= std::min(from.rows - 1, y + 1); ++v) {
                for (int u = std::max(0, x - 1); u <= std::min(from.cols - 1, x + 1); ++u)
                    most = std::max(most, from(v, u));
            }
            to(y, x) = most;
        }
    }
}

// Labels regions of 8 neighbours from 1; returns the number of labels, 0 (the background) among them.
inline int connectedComponents(const Mat1b& image, Mat1i& labels, int /*8*/, int /*CV_32S*/) {
    labels.create(image.rows, image.cols);
    std::fill(labels.values.begin(), labels.values.end(), 0);
    int count = 1;
    std::vector<std::pair<int, int>> open;
    for (int y = 0; y < image.rows; ++y) {
        for (int x = 0; x < image.cols; ++x) {
            if (image(y, x) == 0 || labels(y, x) != 0) continue;
            labels(y, x) = count, open.emplace_back(x, y);
            while (!open.empty()) {
                const auto [a, b] = open.back();
                open.pop_back();
                for (int v = std::max(0, b - 1); v <= std::min(image.rows - 1, b + 1); ++v) {
                    for (int u = std::max(0, a - 1); u <= std::min(image.cols - 1, a + 1); ++u) {
                        if (image(v, u) == 0 || labels(v, u) != 0) continue;
                        labels(v, u) = count, open.emplace_back(u, v);
                    }
                }
            }
            ++count;
        }
    }
    return count;
}

}  // namespace cv
