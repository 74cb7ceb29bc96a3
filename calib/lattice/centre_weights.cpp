#include "calib/lattice/centre_weights.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <Eigen/Dense>

namespace hord::calib {
namespace {

constexpr double kRing = 0.6;         // px, width of the rings that represent the profile
constexpr double kSmoothRing = 0.8;   // px, of those that the weight is made of: wide enough for sampling by pixels
constexpr double kRingStep = 0.5;     // px, between rings
constexpr double kStiffness = 1e-5;   // weight of smoothness between neighbouring rings
constexpr double kPlateau = 0.92;     // of the top, half way to the half height
constexpr double kMaxVariance = 2.5;  // of an immune weight, over that of the most efficient one

Table window_table(double radius) {
    Table window(static_cast<std::size_t>(radius / kTableStep) + 2);
    for (std::size_t k = 0; k < window.size(); ++k) {
        const double left = (radius - static_cast<double>(k) * kTableStep) / kTaper;
        window[k] = left <= 0 ? 0 : left >= 1 ? 1 : 0.5 - 0.5 * std::cos(std::numbers::pi * left);
    }
    return window;
}

struct Ring {
    double value = 0, steepness = 0;  // and -d value / dr / r, smoothed
};
// A Gaussian ring of radius `index` steps with its mirror image.
Ring ring_at(Eigen::Index index, double r) {
    r = std::max(r, 0.25 * kTableStep);
    const double radius = static_cast<double>(index) * kRingStep;
    const auto gauss = [](double at) { return std::exp(-0.5 * at * at); };
    const double near = (r - radius) / kSmoothRing;
    const double far = (r + radius) / kSmoothRing;
    const double share = kRing / kSmoothRing;  // of height: smoothing keeps the ring's area
    return {gauss((r - radius) / kRing) + gauss((r + radius) / kRing),
            share * (near * gauss(near) + far * gauss(far)) / (kSmoothRing * r)};
}

}  // namespace

Profile raised_cosine(double radius) {
    Profile profile;
    profile.value.resize(static_cast<std::size_t>(radius / kTableStep) + 2);
    profile.steepness.resize(profile.value.size());
    for (std::size_t k = 0; k < profile.value.size(); ++k) {
        const double r = std::max(static_cast<double>(k), 0.25) * kTableStep;
        const double angle = std::numbers::pi * std::min(1.0, r / radius);
        profile.value[k] = 0.5 + 0.5 * std::cos(angle);
        profile.steepness[k] = 0.5 * std::numbers::pi / radius * std::sin(angle) / r;
    }
    return profile;
}

Profile measure_profile(const WhiteImage& image, std::span<const Spot> spots, double reach) {
    const auto count = static_cast<std::size_t>((reach + 2) / kTableStep) + 2;
    Table sums(count), hits(count);
    const int box = static_cast<int>(reach) + 3;
    for (const Spot& spot : spots) {
        const auto cx = static_cast<int>(std::lround(spot.centre_px.x_px));
        const auto cy = static_cast<int>(std::lround(spot.centre_px.y_px));
        for (int y = std::max(0, cy - box); y <= std::min(image.height_px() - 1, cy + box); ++y) {
            for (int x = std::max(0, cx - box); x <= std::min(image.width_px() - 1, cx + box); ++x) {
                const double dx = x - spot.centre_px.x_px;
                const double dy = y - spot.centre_px.y_px;
                const double r = std::sqrt(dx * dx + dy * dy);
                const auto k = static_cast<std::size_t>(std::lround(r / kTableStep));
                if (k >= count) continue;
                sums[k] += image.at(x, y) / spot.amplitude_dn;
                hits[k] += 1;
            }
        }
    }
    const auto rings = static_cast<Eigen::Index>((reach + 2) / kRingStep) + 2;
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(rings, rings);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(rings);
    Eigen::VectorXd here(rings);
    for (std::size_t k = 0; k < count; ++k) {
        if (hits[k] == 0) continue;
        const double weight =
            1 / std::max(static_cast<double>(k) * kTableStep, 0.5);  // every radius has the same weight
        for (Eigen::Index ring = 0; ring < rings; ++ring)
            here(ring) = ring_at(ring, static_cast<double>(k) * kTableStep).value;
        normal.selfadjointView<Eigen::Lower>().rankUpdate(here, weight * hits[k]);
        right += weight * sums[k] * here;
    }
    normal.triangularView<Eigen::StrictlyUpper>() = normal.transpose();
    // If the pitch is a whole number of pixels, some radii have no samples: rings there follow their neighbours.
    const double stiffness = kStiffness * normal.diagonal().mean();
    for (Eigen::Index ring = 1; ring + 1 < rings; ++ring) {
        for (int r = -1; r <= 1; ++r) {
            for (int c = -1; c <= 1; ++c)
                normal(ring + r, ring + c) += stiffness * (r == 0 ? -2 : 1) * (c == 0 ? -2 : 1);
        }
    }
    normal.diagonal().array() += 1e-9 * normal.diagonal().mean();
    const Eigen::VectorXd height = normal.ldlt().solve(right);
    Profile profile;
    profile.value.resize(static_cast<std::size_t>(reach / kTableStep) + 2);
    profile.steepness.resize(profile.value.size());
    for (std::size_t k = 0; k < profile.value.size(); ++k) {
        for (Eigen::Index ring = 0; ring < rings; ++ring) {
            const Ring part = ring_at(ring, static_cast<double>(k) * kTableStep);
            profile.value[k] += height(ring) * part.value;
            profile.steepness[k] += height(ring) * part.steepness;
        }
    }
    const auto [bottom, top] = std::minmax_element(profile.value.begin(), profile.value.end());
    const double low = *bottom;
    const double range = std::max(*top - low, 1e-12);
    profile.floor = low / range;
    for (double& value : profile.value) value = (value - low) / range;
    for (double& steepness : profile.steepness) steepness /= range;
    return profile;
}

std::size_t half_height(const Table& profile) {
    std::size_t half = 0;
    while (half + 1 < profile.size() && profile[half] > 0.5 * profile[0]) ++half;
    return half;
}

Weights design_weights(const Profile& profile, double radius, std::optional<AgainstGradients> against) {
    Weights weights;
    weights.radius = radius;
    weights.window = window_table(radius);
    const std::size_t count = weights.window.size();
    const Table& value = profile.value;
    const double floor = value[std::min(count, value.size()) - 1];
    weights.floor = profile.floor + floor;
    weights.profile.resize(count);
    weights.shift.resize(count);
    Table& steepness = weights.steepness;
    steepness.resize(count);
    for (std::size_t k = 0; k < std::min(count, value.size()); ++k) {
        weights.profile[k] = value[k] - floor;
        steepness[k] = profile.steepness[k];
        weights.shift[k] = steepness[k] * weights.window[k];
    }
    const Table efficient = weights.shift;
    // Inner products over the disc: of a weight with a gradient of background (u), with a gradient of light (u T), with
    // a shift (-T'); its noise (shot noise of T over a floor).
    const auto sum = [&](auto&& term) {
        double total = 0;
        for (std::size_t k = 0; k < count; ++k) {
            const double r = static_cast<double>(k) * kTableStep;
            total += term(k, r);
        }
        return total;
    };
    const auto background = [&](const Table& w) {
        return sum([&](std::size_t k, double r) { return w[k] * r * r * r; });
    };
    const auto vignetting = [&](const Table& w) {
        return sum([&](std::size_t k, double r) { return w[k] * weights.profile[k] * r * r * r; });
    };
    const auto gain = [&](const Table& w) {
        return sum([&](std::size_t k, double r) { return w[k] * steepness[k] * r * r * r; });
    };
    const auto variance = [&](const Table& w) {
        const double g = gain(w);
        return sum([&](std::size_t k, double r) { return w[k] * w[k] * (weights.profile[k] + 0.05) * r * r * r; }) /
            (g * g);
    };
    Table light(count);
    for (std::size_t k = 0; k < count; ++k) light[k] = weights.profile[k] * weights.window[k];
    const double best = variance(efficient);
    const auto minus = [&](const Table& w, double alpha, const Table& a, double beta, const Table& b) {
        Table out(count);
        for (std::size_t k = 0; k < count; ++k) out[k] = w[k] - alpha * a[k] - beta * b[k];
        return out;
    };
    // With a plateau, the noise of an immune weight has a limit by itself: at the softest plateau 70 times the
    // variance.
    double most = kMaxVariance;
    const auto accept = [&](const Table& w, bool against_background, bool against_vignetting) {
        if (!(gain(w) > 0) || !(variance(w) <= most * best)) return false;
        weights.shift = w;
        weights.immunity = {against_background, against_vignetting};
        return true;
    };
    if (!against) return weights;
    // A gradient of light can be separated from a shift only if the lenslet has a plateau: half way to its half height
    // it has nearly its full height (a Gaussian has 0.84 there).
    const std::size_t half = half_height(weights.profile);
    const bool plateau = weights.plateau = weights.profile[half / 2] > kPlateau * weights.profile[0];
    if (plateau && *against == AgainstGradients::always) most = std::numeric_limits<double>::infinity();
    // Try both, then vignetting alone, then the background alone.
    const double ll = vignetting(light), lw = vignetting(weights.window);
    const double bl = background(light), bw = background(weights.window);
    const double le = vignetting(efficient), be = background(efficient);
    const double determinant = ll * bw - lw * bl;
    if (plateau && std::abs(determinant) > 1e-9 * std::abs(ll * bw)) {
        const double alpha = (le * bw - lw * be) / determinant;
        const double beta = (ll * be - le * bl) / determinant;
        if (accept(minus(efficient, alpha, light, beta, weights.window), true, true)) return weights;
    }
    if (plateau && ll > 0 && accept(minus(efficient, le / ll, light, 0, light), false, true)) return weights;
    if (bw > 0 && accept(minus(efficient, be / bw, weights.window, 0, light), true, false)) return weights;
    return weights;
}

double shift_by_gradient(const Weights& of) {
    double light = 0, shift = 0;  // moments of a gradient, u T over its floor, and of a shift, -T'
    for (std::size_t k = 0; k < of.shift.size(); ++k) {
        const double r = static_cast<double>(k) * kTableStep, here = of.shift[k] * r * r * r;
        light += here * (of.profile[k] + of.floor);
        shift += here * of.steepness[k];
    }
    return shift > 0 ? std::abs(light) / shift : 0;
}

double unlike_by_shift(const Weights& of) {
    double area = 0, mean = 0, square = 0, change = 0;  // change: the square of T' cos(angle), whose mean is a half
    for (std::size_t k = 0; k < of.window.size(); ++k) {
        const double r = static_cast<double>(k) * kTableStep, here = of.window[k] * r, value = of.profile[k];
        area += here;
        mean += here * value;
        square += here * value * value;
        change += here * std::pow(of.steepness[k] * r, 2) / 2;
    }
    const double power = area > 0 ? square - mean * mean / area : 0;
    return power > 0 ? change / power : 0;
}

// A stretch by 1 + e along x and 1 - e across adds -e r T' cos(2 angle) to the light. Smoothing by a Gaussian of
// variance s after the stretch blurs all ways alike: with T the smoothed profile it adds -e (r T' + s (T'' - T' / r))
// cos(2 angle).
double stretch_shown(const Weights& of, double smoothed_px) {
    const double variance = smoothed_px * smoothed_px;
    const auto steepness = [&](std::size_t k) { return k < of.steepness.size() ? of.steepness[k] : 0; };
    double added = 0, all = 0;
    for (std::size_t k = 0; k < of.window.size(); ++k) {
        const double r = static_cast<double>(k) * kTableStep, here = of.window[k] * r * r * r;
        const double slope =
            (steepness(k + 1) - steepness(k == 0 ? 1 : k - 1)) / (2 * kTableStep);  // T'' - T' / r, over -r
        added += here * (r * r * of.steepness[k] + variance * r * slope) / 4;
        all += here * of.profile[k];
    }
    return all > 0 ? added / all : 1;
}

double edge_variance(const Weights& of) {
    double all = 0, mean = 0, square = 0;  // of r, each as much as the profile falls there
    for (std::size_t k = 0; k < of.steepness.size(); ++k) {
        const double r = static_cast<double>(k) * kTableStep, here = r * of.steepness[k];
        all += here;
        mean += here * r;
        square += here * r * r;
    }
    constexpr double kSmoothing = kSmoothRing * kSmoothRing - kRing * kRing;  // px^2
    return std::max(kRing * kRing, all > 0 ? square / all - std::pow(mean / all, 2) - kSmoothing : 0);
}

}  // namespace hord::calib
