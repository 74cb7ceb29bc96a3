// Probability of detection by size, with its confidence bound.
#pragma once

#include <optional>
#include <span>

namespace hord::algo {

// Probability of detection by size: logistic in the logarithm of the size, POD = 1 / (1 + exp(-(b0 + b1 ln a))), fitted
// with Firth's penalty (Biometrika 80 (1993) 27), which stays finite where hits and misses are separated. a90: the size
// found with 90 % probability; a90_95: the same with 95 % confidence (Wald bound of the curve, MIL-HDBK-1823A). Empty
// if the curve, or its bound, does not reach 0.9.
struct DetectionTrial {
    double size = 0;  // > 0
    bool found = false;
};
struct PodCurve {
    double b0 = 0, b1 = 0;
    std::optional<double> a50, a90, a90_95;
    [[nodiscard]] double at(double size) const;
};
PodCurve pod_curve(std::span<const DetectionTrial> tried);

}  // namespace hord::algo
