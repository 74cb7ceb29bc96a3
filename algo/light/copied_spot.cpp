#include "algo/light/copied_spot.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace hord::algo {
namespace {

constexpr int kHalvings = 10;  // of the range of distances: to a 400th of a bin
constexpr int kSteps = 8;

struct Cumulants {
    double third = 0, fourth = 0, fifth = 0, sixth = 0;  // bins to this power
};

// A copy of the share s at the distance d: v = s (1 - s).
struct Copy {
    double v = 0, distance = 0;  // bins
    [[nodiscard]] double share() const { return (1 - std::sqrt(1 - 4 * v)) / 2; }
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
    std::array<double, 7> m{};  // central moments
    for (int at = first; at < end; ++at) {
        double power = periodic(axis, at) / sum;
        for (double& moment : m) moment += power, power *= at - mean;
    }
    return {m[3], m[4] - 3 * m[2] * m[2], m[5] - 10 * m[2] * m[3],
            m[6] - 15 * m[4] * m[2] - 10 * m[3] * m[3] + 30 * m[2] * m[2] * m[2]};
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

// The distance, from kMinCopyBins to `far`, at which a ratio of cumulants that grows with it has this value.
template <class RatioAt>
double distance_of(double ratio, double far, RatioAt&& ratio_at) {
    double near = kMinCopyBins;
    for (int step = 0; step < kHalvings; ++step) {
        const double d = (near + far) / 2;
        (ratio_at(d) < ratio ? near : far) = d;
    }
    return near;
}

// On one side.
Copy copy_of(const Cumulants& all, double skewness, double far) {
    if (all.third == 0) return {};
    const double third = std::abs(all.third - skewness);
    const auto v_at = [&](double d) { return product_of_shares(third / (d * d * d)); };
    const double d = distance_of(all.fifth / all.third, far, [&](double at) { return at * at * (1 - 12 * v_at(at)); });
    return {v_at(d), d};
}

// On both sides alike: of what the copy on one side leaves. 0 of what is not positive, as a wide disc's is.
double share_of_pair(const Cumulants& all, const Copy& copy, double far) {
    const double v = copy.v, dd = copy.distance * copy.distance, fourth = all.fourth - v * (1 - 6 * v) * dd * dd,
                 sixth = all.sixth - v * (1 - 30 * v + 120 * v * v) * dd * dd * dd;
    if (!(fourth > 0)) return 0;
    constexpr double kLargest = 1.0 / 12;  // of s (1 - 3 s)
    const auto share_at = [&](double d) {
        return (1 - std::sqrt(1 - 12 * std::min(fourth / (d * d * d * d), kLargest))) / 6;
    };
    return share_at(distance_of(sixth / fourth, far, [&](double at) {
        const double s = share_at(at);
        return at * at * (1 - 15 * s + 30 * s * s) / std::max(1 - 3 * s, 0.5);
    }));
}

}  // namespace

double copied_share(std::span<const double> axis, double core, double half_core) {
    if (axis.size() < static_cast<std::size_t>(kMinBinsForCopies)) return 0;
    double sum = 0;
    for (const double light : axis) sum += light;
    if (!(sum > 0)) return 0;
    const Cumulants all = cumulants_of(axis, core);
    const double far = 0.5 * static_cast<double>(axis.size());
    const Copy copy = copy_of(all, skewness_of_core(axis, core, half_core), far);
    return std::max(copy.share(), share_of_pair(all, copy, far));
}

}  // namespace hord::algo
