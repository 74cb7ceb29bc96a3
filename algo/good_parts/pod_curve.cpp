#include "algo/good_parts/pod_curve.h"

#include <algorithm>
#include <cmath>

namespace hord::algo {
namespace {

double logistic(double x) { return 1 / (1 + std::exp(-x)); }

}  // namespace

double PodCurve::at(double size) const { return logistic(b0 + b1 * std::log(size)); }

PodCurve pod_curve(std::span<const DetectionTrial> tried) {
    PodCurve curve;
    if (tried.empty()) return curve;
    // Around the mean, so that the two coefficients are nearly independent.
    double middle = 0;
    for (const DetectionTrial& t : tried) middle += std::log(t.size);
    middle /= static_cast<double>(tried.size());
    double c0 = 0, c1 = 0, v00 = 0, v01 = 0, v11 = 0;
    constexpr int kSteps = 200;
    for (int step = 0; step < kSteps; ++step) {
        double i00 = 0, i01 = 0, i11 = 0;  // Fisher information
        for (const DetectionTrial& t : tried) {
            const double x = std::log(t.size) - middle, p = logistic(c0 + c1 * x), w = p * (1 - p);
            i00 += w, i01 += w * x, i11 += w * x * x;
        }
        const double det = i00 * i11 - i01 * i01;
        if (!(det > 1e-12)) break;
        v00 = i11 / det, v01 = -i01 / det, v11 = i00 / det;
        double u0 = 0, u1 = 0;  // score with Firth's penalty
        for (const DetectionTrial& t : tried) {
            const double x = std::log(t.size) - middle, p = logistic(c0 + c1 * x);
            const double leverage = p * (1 - p) * (v00 + 2 * v01 * x + v11 * x * x);
            const double residual = (t.found ? 1.0 : 0.0) - p + leverage * (0.5 - p);
            u0 += residual, u1 += residual * x;
        }
        double d0 = v00 * u0 + v01 * u1, d1 = v01 * u0 + v11 * u1;
        const double most = std::max(std::abs(d0), std::abs(d1));
        if (most > 1) d0 /= most, d1 /= most;  // no step beyond one: Firth's score is not concave everywhere
        c0 += d0, c1 += d1;
        if (most < 1e-10) break;
    }
    curve.b0 = c0 - c1 * middle;
    curve.b1 = c1;
    if (!(c1 > 0)) return curve;
    const double logit90 = std::log(9.0);
    curve.a50 = std::exp(-curve.b0 / curve.b1);
    curve.a90 = std::exp((logit90 - curve.b0) / curve.b1);
    // Lower bound of the linear predictor crosses logit(0.9): (c0 + c1 x - L)^2 = z^2 var(x), the root above x90.
    constexpr double kOneSided95 = 1.6448536269514722;
    const double z2 = kOneSided95 * kOneSided95, e = c0 - logit90;
    const double a = c1 * c1 - z2 * v11, b = c1 * e - z2 * v01, c = e * e - z2 * v00;
    const double root = b * b - a * c;
    if (a > 0 && root >= 0) curve.a90_95 = std::exp(middle + (-b + std::sqrt(root)) / a);
    return curve;
}

}  // namespace hord::algo
