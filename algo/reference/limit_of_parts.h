// Limits that one of 10,000 good parts exceeds, from few parts.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

namespace hord::algo {

constexpr std::size_t kMinLimited = 8;  // parts
constexpr double kLimitNoises = 3.9;    // standard deviations of a normal variable that one of 10,000 exceeds

// Student's t of 1 in 10,000 on both sides together, by its expansion in 1 / degrees of freedom (Abramowitz and Stegun,
// 26.7.5); from 7 degrees on right to 3 %.
constexpr double t_of_limit(double degrees) {
    const double v = 1 / degrees;
    return kLimitNoises + v * (15.7 + v * (56.4 + v * 152));
}

// What one of 10,000 parts exceeds, if their values are normally distributed: the mean and t times the deviation of the
// next part's. 0 of less than kMinLimited.
inline double limit_of_parts(double sum, double squares, std::size_t count) {
    if (count < kMinLimited) return 0;
    const auto parts = static_cast<double>(count);
    const double mean = sum / parts, variance = std::max(squares / parts - mean * mean, 0.0) * parts / (parts - 1);
    return mean + t_of_limit(parts - 1) * std::sqrt(variance * (1 + 1 / parts));
}
inline double limit_of_parts(std::span<const double> values) {
    double sum = 0, squares = 0;
    for (const double v : values) sum += v, squares += v * v;
    return limit_of_parts(sum, squares, values.size());
}

}  // namespace hord::algo
