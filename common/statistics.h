// Medians and quantiles. No value may be NaN. Functions over a span reorder the values and do not allocate.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

namespace hord::common {

// The value of rank `rank` in ascending order; 0 is the smallest. rank < values.size().
template <class T>
T nth_smallest(std::span<T> values, std::size_t rank) {
    const auto nth = values.begin() + static_cast<std::ptrdiff_t>(rank);
    std::nth_element(values.begin(), nth, values.end());
    return *nth;
}

// The median of at least one value. An even number has two middle values; the name says which one is returned.
template <class T>
T lower_median(std::span<T> values) {
    return nth_smallest(values, (values.size() - 1) / 2);
}
template <class T>
T upper_median(std::span<T> values) {
    return nth_smallest(values, values.size() / 2);
}

// The value below which `share` (0..1) of the values lie, interpolated linearly between neighbours. 0 for no values.
inline double quantile(std::vector<double> values, double share) {
    if (values.empty()) return 0;
    std::ranges::sort(values);
    const double at = share * static_cast<double>(values.size() - 1);
    const auto below = static_cast<std::size_t>(at);
    const std::size_t above = std::min(below + 1, values.size() - 1);
    return values[below] + (at - static_cast<double>(below)) * (values[above] - values[below]);
}

}  // namespace hord::common
