// Subsampling and median, for the estimators of this folder.
#pragma once

#include <algorithm>
#include <vector>

#include "common/statistics.h"

namespace hord::algo {

// At most `most` indices of 0..count-1, evenly spaced.
inline std::vector<int> spread(int count, int most) {
    std::vector<int> out;
    const int taken = std::min(count, most);
    for (int k = 0; k < taken; ++k) out.push_back(static_cast<int>((k + 0.5) * count / taken));
    return out;
}

// The upper median of `count` > 0 values; reorders them.
inline float median(float* values, int count) {
    return common::upper_median(std::span(values, static_cast<std::size_t>(count)));
}

}  // namespace hord::algo
