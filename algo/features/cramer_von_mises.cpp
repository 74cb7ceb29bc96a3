#include "algo/features/cramer_von_mises.h"

#include <algorithm>
#include <map>

#include "algo/features/logarithm.h"

namespace hord::algo {
namespace {

constexpr double kPi = 3.14159265358979324, kEuler = 0.57721566490153286;

// exp(-s) for s >= 0: Taylor's series at s / 2^k <= 1/2, then k squarings.
double exp_minus(double s) {
    if (s > 700) return 0;
    int squarings = 0;
    for (; s > 0.5; s *= 0.5) ++squarings;
    double sum = 1;
    for (int k = 16; k >= 1; --k) sum = 1 - s / k * sum;
    for (; squarings > 0; --squarings) sum *= sum;
    return sum;
}

// The exponential integral E1(s), s > 0 (Abramowitz & Stegun 5.1.11 and 5.1.22).
double e1(double s) {
    if (s <= 1) {
        double term = 1, sum = 0;
        for (int k = 1; k <= 20; ++k) {
            term *= -s / k;
            sum -= term / k;
        }
        return -kEuler - exact_logarithm(s) + sum;
    }
    double fraction = 0;
    for (int k = 80; k >= 1; --k) fraction = k / (1 + k / (s + fraction));
    return exp_minus(s) / (s + fraction);
}

}  // namespace

CramerVonMises::CramerVonMises(std::span<const Direction> directions, double width)
    : bins_(directions.size()), g_(bins_ * bins_) {
    std::map<double, double> of_distance;  // a regular grid has few distances
    for (std::size_t a = 0; a < bins_; ++a) {
        for (std::size_t b = 0; b < bins_; ++b) {
            const double x = directions[a].x - directions[b].x, y = directions[a].y - directions[b].y;
            const double squared = x * x + y * y;
            if (squared == 0) continue;
            const auto [at, is_new] = of_distance.try_emplace(squared);
            if (is_new) {
                const double s = squared / (4 * width * width);
                at->second = kPi / 2 * (width * width * (1 - exp_minus(s)) + squared / 4 * e1(s));
            }
            g_[a * bins_ + b] = at->second;
        }
    }
}

double CramerVonMises::squared(const Difference& difference) const {
    const auto count = static_cast<std::size_t>(difference.count);
    double sum = 0;
    for (std::size_t k = 1; k < count; ++k) {
        const double* g = g_.data() + difference.bin[k] * bins_;
        double row = 0;
        for (std::size_t l = 0; l < k; ++l) row += difference.mass[l] * g[difference.bin[l]];
        sum += difference.mass[k] * row;
    }
    return std::max(0.0, -2 * sum);
}

}  // namespace hord::algo
