// Windows, subsampling and median, for the estimators of this folder.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "common/statistics.h"

namespace hord::algo {

// At most `most` indices of 0..count-1, evenly spaced.
inline std::vector<int> spread(int count, int most) {
    std::vector<int> out;
    const int taken = std::min(count, most);
    for (int k = 0; k < taken; ++k) out.push_back(static_cast<int>((k + 0.5) * count / taken));
    return out;
}

// Fails with invalid_argument for extents that check() refuses, or a window of fewer or more parts.
inline Result<void> check_window(const Extents& extents, int window, int fewest, int most) {
    if (window >= fewest && window <= most) return check(extents);
    return fail(ErrorCode::invalid_argument, "a window of " + std::to_string(window) + " parts",
                "use " + std::to_string(fewest) + " to " + std::to_string(most));
}

// The upper median of `count` > 0 values; reorders them.
inline float median(float* values, int count) {
    return common::upper_median(std::span(values, static_cast<std::size_t>(count)));
}

}  // namespace hord::algo
