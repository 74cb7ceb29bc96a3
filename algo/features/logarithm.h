// The natural logarithm from exact operations: the same bits on every platform.
#pragma once

#include <bit>
#include <cstdint>

namespace hord::algo {

// Of a normal x in (0, 1]: |error| < 2^-50 * (1 + |ln x|).
inline double exact_logarithm(double x) {
    constexpr double kLn2 = 0.69314718055994531;
    const auto bits = std::bit_cast<std::uint64_t>(x);
    int exponent = static_cast<int>(bits >> 52) - 1023;
    double m = std::bit_cast<double>((bits & 0x000FFFFFFFFFFFFFU) | 0x3FF0000000000000U);  // 1..2
    if (m > 1.4142135623730951) {
        m *= 0.5;
        ++exponent;
    }
    const double s = (m - 1) / (m + 1);  // |s| < 0.1716: ln m = 2 (s + s^3/3 + ...), and s^23/23 < 1e-18
    const double s2 = s * s;
    double sum = 0;
    for (int k = 21; k >= 1; k -= 2) sum = sum * s2 + 1.0 / k;
    return exponent * kLn2 + 2 * s * sum;
}

}  // namespace hord::algo
