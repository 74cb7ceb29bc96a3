#include "algo/reference/clipped_noise.h"

#include <cmath>

namespace hord::algo {
namespace {

// e^x, x >= 0, by operations that IEEE 754 rounds alike on every machine.
double exact_exp(double x) {
    int halved = 0;
    for (; x > 0.5; x *= 0.5) ++halved;
    double sum = 1, term = 1;
    for (int k = 1; k <= 14; ++k) sum += term *= x / k;
    for (; halved > 0; --halved) sum *= sum;
    return sum;
}

}  // namespace

ClippedNoise clipped_noise(double variance, double clip) {
    const double sigma = std::sqrt(variance), from = clip / sigma, step = 1.0 / 32;
    double mean = 0, square = 0;
    for (int k = 0; k < 8 * 32; ++k) {
        const double above = (k + 0.5) * step, z = from + above, density = 0.3989422804 * step / exact_exp(0.5 * z * z);
        mean += density * above;
        square += density * above * above;
    }
    return {sigma * mean, variance * (square - mean * mean)};
}

}  // namespace hord::algo
