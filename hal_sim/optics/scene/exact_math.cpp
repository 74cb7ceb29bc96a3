#include "hal_sim/optics/scene/exact_math.h"

#include <cmath>

namespace hord::sim::exact {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kLn2High = 6.93147180369123816490e-01;  // 33 bits, so that k * kLn2High is exact
constexpr double kLn2Low = 1.90821492927058770002e-10;
constexpr double kPiHalfHigh = 1.57079632673412561417e+00;
constexpr double kPiHalfLow = 6.07710050650619224932e-11;

// atan on [0, inf).
double atan_positive(double x) {
    double offset = 0;
    if (x > 2.41421356237309504880) {  // tan(3 pi / 8)
        offset = kPi / 2;
        x = -1 / x;
    } else if (x > 0.66) {
        offset = kPi / 4;
        x = (x - 1) / (x + 1);
    }
    const double z = x * x;
    const double p =
        (((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z -
         1.228866684490136173410e2) *
            z -
        6.485021904942025371773e1;
    const double q =
        ((((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z +
         4.853903996359136964868e2) *
            z +
        1.945506571482613964425e2;
    return offset + (x + x * (z * p / q));
}

}  // namespace

double atan2(double y, double x) {
    if (x == 0 && y == 0) return 0;
    const double ax = x < 0 ? -x : x, ay = y < 0 ? -y : y;
    double angle = ax > 0 ? atan_positive(ay / ax) : kPi / 2;
    if (x < 0) angle = kPi - angle;
    return y < 0 ? -angle : angle;
}

double log(double x) {
    int exponent = 0;
    double f = std::frexp(x, &exponent);  // exact
    if (f < 0.70710678118654752440) {
        f *= 2;
        --exponent;
    }
    const double s = (f - 1) / (f + 1);
    const double z = s * s;
    double series = 0;
    for (int k = 23; k >= 3; k -= 2) series = (series + 1.0 / k) * z;
    return exponent * kLn2High + (exponent * kLn2Low + 2 * (s + s * series));
}

double exp(double x) {
    if (x > 700) x = 700;
    if (x < -700) x = -700;
    const double k = std::floor(x / (kLn2High + kLn2Low) + 0.5);
    const double r = (x - k * kLn2High) - k * kLn2Low;
    double sum = 1;
    for (int n = 16; n >= 1; --n) sum = 1 + sum * r / n;
    return std::ldexp(sum, static_cast<int>(k));  // exact
}

void sin_cos(double x, double& sine, double& cosine) {
    const double quarter = std::floor(x / (kPi / 2) + 0.5);
    const double r = (x - quarter * kPiHalfHigh) - quarter * kPiHalfLow;
    const double z = r * r;
    double s = 1, c = 1;
    for (int n = 18; n >= 2; n -= 2) {
        s = 1 - s * z / (n * (n + 1));
        c = 1 - c * z / (n * (n - 1));
    }
    s *= r;
    switch (static_cast<long>(quarter) & 3) {
        case 0: sine = s, cosine = c; break;
        case 1: sine = c, cosine = -s; break;
        case 2: sine = -s, cosine = -c; break;
        default: sine = -c, cosine = s; break;
    }
}

}  // namespace hord::sim::exact
