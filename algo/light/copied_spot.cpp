#include "algo/light/copied_spot.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace hord::algo {
namespace {

constexpr int kHalvings = 10;  // of the range of distances: to a 400th of a bin
constexpr int kSteps = 8;

struct Cumulants {
    double third = 0, fifth = 0;  // bins to this power
};

double periodic(std::span<const double> axis, int at) {
    const int bins = static_cast<int>(axis.size());
    return axis[static_cast<std::size_t>((at % bins + bins) % bins)];
}

// The bins about the core that are taken for one period begin where the light is least, so that no copy is cut in two.
int first_of_period(std::span<const double> axis, double core) {
    const int bins = static_cast<int>(axis.size()), middle = static_cast<int>(std::lround(core)) - bins / 2;
    int first = middle;
    const auto at_ends = [&](int from) { return periodic(axis, from) + periodic(axis, from + bins - 1); };
    for (const int from : {middle - 1, middle + 1}) {
        if (at_ends(from) < at_ends(first)) first = from;
    }
    return first;
}

Cumulants cumulants_of(std::span<const double> axis, double core) {
    const int first = first_of_period(axis, core), end = first + static_cast<int>(axis.size());
    double sum = 0, mean = 0;
    for (int at = first; at < end; ++at) sum += periodic(axis, at), mean += at * periodic(axis, at);
    mean /= sum;
    std::array<double, 6> moments{};
    for (int at = first; at < end; ++at) {
        double power = periodic(axis, at) / sum;
        for (double& moment : moments) moment += power, power *= at - mean;
    }
    return {moments[3], moments[5] - 10 * moments[2] * moments[3]};
}

// Third central moment of the light in the core, over all light. Of a bin partly within it, at the middle of that part.
double skewness_of_core(std::span<const double> axis, double core, double half_core) {
    double all = 0, sum = 0, mean = 0, third = 0;
    const auto for_each = [&](auto&& visit) {
        for (std::size_t k = 0; k < axis.size(); ++k) {
            const double at = static_cast<double>(k), begin = std::max(core - half_core, at - 0.5),
                         end = std::min(core + half_core, at + 0.5);
            if (end > begin) visit((begin + end) / 2, axis[k] * (end - begin));
        }
    };
    for (const double light : axis) all += light;
    for_each([&](double at, double light) { sum += light, mean += at * light; });
    if (!(sum > 0)) return 0;
    mean /= sum;
    for_each([&](double at, double light) { third += light * std::pow(at - mean, 3); });
    return third / all;
}

// v of a third cumulant over d^3.
double product_of_shares(double third) {
    constexpr double kLargest = 1.0 / 6;  // of v sqrt(1 - 4 v)
    double v = std::min(third, kLargest);
    for (int step = 0; step < kSteps; ++step) v = std::min(third / std::sqrt(1 - 4 * v), kLargest);
    return v;
}

}  // namespace

double copied_share(std::span<const double> axis, double core, double half_core) {
    if (axis.size() < static_cast<std::size_t>(kMinBinsForCopies)) return 0;
    double sum = 0;
    for (const double light : axis) sum += light;
    if (!(sum > 0)) return 0;
    const Cumulants all = cumulants_of(axis, core);
    if (all.third == 0) return 0;
    const double third = std::abs(all.third - skewness_of_core(axis, core, half_core)), ratio = all.fifth / all.third;
    // k5 / k3 grows with the distance.
    double near = kMinCopyBins, far = 0.5 * static_cast<double>(axis.size());
    for (int step = 0; step < kHalvings; ++step) {
        const double d = (near + far) / 2;
        (d * d * (1 - 12 * product_of_shares(third / (d * d * d))) < ratio ? near : far) = d;
    }
    const double v = product_of_shares(third / (near * near * near));
    return (1 - std::sqrt(1 - 4 * v)) / 2;
}

}  // namespace hord::algo
