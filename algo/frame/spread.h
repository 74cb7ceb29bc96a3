// A regular subsample of rows or columns.
#pragma once

#include <algorithm>
#include <vector>

namespace hord::algo {

// At most `most` indices of 0..count-1, evenly spaced, in ascending order.
inline std::vector<int> spread(int count, int most) {
    std::vector<int> out;
    const int taken = std::min(count, most);
    for (int k = 0; k < taken; ++k) out.push_back(static_cast<int>((k + 0.5) * count / taken));
    return out;
}

}  // namespace hord::algo
