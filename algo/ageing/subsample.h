// Subsampling and median, for the estimators of this folder.
#pragma once

#include <algorithm>
#include <vector>

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
    std::nth_element(values, values + count / 2, values + count);
    return values[count / 2];
}

}  // namespace hord::algo
