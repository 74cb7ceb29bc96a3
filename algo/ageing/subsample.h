// Windows and median, for the estimators of this folder.
#pragma once

#include <span>
#include <string>

#include "algo/frame/extents.h"
#include "algo/frame/spread.h"
#include "common/statistics.h"

namespace hord::algo {

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
