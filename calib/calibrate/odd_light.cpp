#include "calib/calibrate/odd_light.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include <Eigen/Dense>

#include "calib/lattice/centre_weights.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;
using Light = Eigen::ArrayXXd;  // row by y, column by x: whole pixels from the lenslet's centre

// Smaller shifts are left, px: what rounding adds to the positions that lenslets are decoded at, RMS. And in standard
// errors.
constexpr double kMinShift = 1.0 / 32 / (2 * std::numbers::sqrt3), kMinDeviations = 8;
constexpr std::size_t kMaxLenslets = 400, kMinLenslets = 8;
constexpr int kRim = 1;              // px around the window: differences reach so far
constexpr double kTaper = 2;         // px, over which the window falls to zero
constexpr double kNormal = 0.6745;   // median deviation of a normal distribution, over its standard deviation
constexpr double kPixels = 400'000;  // of all windows together, to limit the time
constexpr int kMaxRounds = 4;        // the first leaves a fifth of the shift, each next one a tenth
constexpr double kSmallStep = 0.1;   // of kMinShift: where the rounds end
constexpr Eigen::Index kShapes = 6;

// Weights of four samples for a place between the middle two: a cubic through all four. Unlike a line through two of
// them it has no third moment, which would look like light that is odd.
std::array<double, 4> between(double t) {
    return {-t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2, -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6};
}

// The light at whole pixels from `centre`; both places of a pair lie alike between the pixels. None where that leaves
// the frame.
std::optional<Light> light_around(const WhiteImage& image, PixelPoint centre, int reach) {
    const int left = static_cast<int>(std::floor(centre.x_px)), top = static_cast<int>(std::floor(centre.y_px));
    if (left - reach < 1 || top - reach < 1 || left + reach + 2 >= image.width_px() ||
        top + reach + 2 >= image.height_px())
        return std::nullopt;
    const auto along_x = between(centre.x_px - left), along_y = between(centre.y_px - top);
    const int side = 2 * reach + 1;
    Light rows(side + 3, side);
    for (int y = 0; y < side + 3; ++y) {
        for (int x = 0; x < side; ++x) {
            double sum = 0;
            for (int k = 0; k < 4; ++k)
                sum += along_x[static_cast<std::size_t>(k)] * image.at(left - reach + x + k - 1, top - reach + y - 1);
            rows(y, x) = sum;
        }
    }
    Light out = Light::Zero(side, side);
    for (int k = 0; k < 4; ++k) out += along_y[static_cast<std::size_t>(k)] * rows.middleRows(k, side);
    return out;
}

// Central differences; 0 at the rim.
Light along_x(const Light& of) {
    Light out = Light::Zero(of.rows(), of.cols());
    const auto inner = of.cols() - 2;
    out.middleCols(1, inner) = (of.rightCols(inner) - of.leftCols(inner)) / 2;
    return out;
}
Light along_y(const Light& of) { return along_x(of.transpose()).transpose(); }

Eigen::VectorXd flat(const Light& of) { return Eigen::Map<const Eigen::VectorXd>(of.data(), of.size()); }

struct Window {
    int reach = 0;
    Light weight, x, y;
};
Window window_of(const CentreFinder& finder) {
    Window out{.reach = static_cast<int>(std::ceil(finder.window_radius_px())) + kRim, .weight = {}, .x = {}, .y = {}};
    const int side = 2 * out.reach + 1;
    out.weight = out.x = out.y = Light::Zero(side, side);
    for (int row = 0; row < side; ++row) {
        for (int column = 0; column < side; ++column) {
            const double x = column - out.reach, y = row - out.reach;
            out.x(row, column) = x, out.y(row, column) = y;
            out.weight(row, column) = std::clamp((finder.window_radius_px() - std::hypot(x, y)) / kTaper, 0.0, 1.0);
        }
    }
    return out;
}

// What a shift of the lenslets, a gradient of their light and one of the background add to an even light, along x and
// y.
Eigen::Matrix<double, Eigen::Dynamic, kShapes> shapes_of(const Light& even, const Window& window) {
    Eigen::Matrix<double, Eigen::Dynamic, kShapes> out(even.size(), kShapes);
    out << flat(-along_x(even)), flat(-along_y(even)), flat(window.x * even), flat(window.y * even), flat(window.x),
        flat(window.y);
    return out;
}

struct Median {
    double of = 0, sigma = 0;
};
Median median_of(std::vector<double> values) {
    const double median = common::upper_median(std::span(values));
    for (double& value : values) value = std::abs(value - median);
    return {median,
            1.2533 / kNormal * common::upper_median(std::span(values)) / std::sqrt(static_cast<double>(values.size()))};
}

// The light of some lenslets, each over its own amplitude: the part that a half turn leaves, their mean; and the part
// whose sign it changes, of each.
struct Sampled {
    Light even;
    std::vector<Light> odd;
    // Of every second lenslet, from `first` on.
    [[nodiscard]] Eigen::VectorXd mean_odd(std::size_t first) const {
        Light sum = Light::Zero(even.rows(), even.cols());
        for (std::size_t k = first; k < odd.size(); k += 2) sum += odd[k];
        return flat(sum) / static_cast<double>((odd.size() + 1 - first) / 2);
    }
};
std::optional<Sampled> sampled(const WhiteImage& image, const Window& window, std::span<const Observation> observations,
                               PixelPoint moved) {
    const int side = 2 * window.reach + 1;
    Sampled out{.even = Light::Zero(side, side), .odd = {}};
    const std::size_t most = std::min(kMaxLenslets, static_cast<std::size_t>(kPixels / (side * side)));
    const std::size_t every = std::max<std::size_t>(1, observations.size() / std::max(kMinLenslets, most));
    for (std::size_t k = 0; k < observations.size(); k += every) {
        const Observation& seen = observations[k];
        if (!seen.used || !(seen.light_dn > 0)) continue;
        const PixelPoint at{seen.centre_px.x_px + moved.x_px, seen.centre_px.y_px + moved.y_px};
        const auto light = light_around(image, at, window.reach);
        if (!light) continue;
        const Light turned = light->reverse();
        out.even += (*light + turned) / (2 * seen.light_dn);
        out.odd.push_back((*light - turned) / (2 * seen.light_dn));
    }
    if (out.odd.size() < kMinLenslets) return std::nullopt;
    out.even /= static_cast<double>(out.odd.size());
    return out;
}

using Shapes = Eigen::Matrix<double, Eigen::Dynamic, kShapes>;
using Parts = Eigen::Matrix<double, kShapes, 1>;

// The least-squares fit of the shapes to odd light.
struct Fit {
    Shapes shapes;
    Eigen::Matrix<double, kShapes, Eigen::Dynamic> parts_of;  // the light's parts are this, times the light
    Eigen::VectorXd weight;
    Parts alone;  // power of each shape that no other one has

    Fit(const Light& even, const Window& window) : shapes(shapes_of(even, window)), weight(flat(window.weight)) {
        const Eigen::Matrix<double, kShapes, Eigen::Dynamic> weighted = shapes.transpose() * weight.asDiagonal();
        const Eigen::Matrix<double, kShapes, kShapes> inverse = (weighted * shapes).inverse();
        parts_of = inverse * weighted;
        alone = inverse.diagonal().cwiseInverse();
    }
    [[nodiscard]] Eigen::VectorXd left(const Eigen::VectorXd& light) const {
        return light - shapes * (parts_of * light);
    }
    [[nodiscard]] double product(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const {
        return a.dot(weight.asDiagonal() * b);
    }
};

// What one round finds: `shift_px` from where the light was sampled.
OddLight found_in(const Sampled& light, const Window& window) {
    const Fit fit(light.even, window);
    std::array<std::vector<double>, kShapes> parts;
    for (const Light& odd : light.odd) {
        const Parts here = fit.parts_of * flat(odd);
        for (std::size_t k = 0; k < parts.size(); ++k) parts[k].push_back(here(static_cast<Eigen::Index>(k)));
    }
    const Median x = median_of(parts[0]), y = median_of(parts[1]);
    // Two halves of the lenslets have independent noise, of which their product has none.
    const double left = std::max(0.0, fit.product(fit.left(light.mean_odd(0)), fit.left(light.mean_odd(1))));
    const Eigen::VectorXd even = flat(light.even - (window.weight * light.even).sum() / window.weight.sum());
    return {.shift_px = {x.of, y.of},
            .sigma_px = std::hypot(x.sigma, y.sigma),
            .unsure_px = std::sqrt(left / fit.alone.head<2>().minCoeff()),
            .left_share = left / fit.product(even, even),
            .gradient = {median_of(parts[2]).of, median_of(parts[3]).of},
            .by_light_px = {}};
}

bool significant(const OddLight& of) { return of.shift() > std::max(kMinShift, kMinDeviations * of.sigma_px); }

}  // namespace

bool OddLight::known() const { return significant(*this) && 2 * unsure_px < shift(); }
bool OddLight::by_light() const {
    const double off = std::hypot(shift_px.x_px - by_light_px.x_px, shift_px.y_px - by_light_px.y_px);
    return significant(*this) && 2 * off < std::hypot(by_light_px.x_px, by_light_px.y_px);
}

OddLight odd_light(const WhiteImage& image, const CentreFinder& finder, std::span<const Observation> observations) {
    const Window window = window_of(finder);
    const bool separable = finder.weights().plateau;
    OddLight out;
    double step = kMinShift;
    for (int round = 0; round < kMaxRounds && step > kSmallStep * kMinShift; ++round) {
        const auto light = sampled(image, window, observations, out.shift_px);
        if (!light) return {};
        const PixelPoint before = out.shift_px;
        out = found_in(*light, window);
        if (!separable) {
            OddLight of_spots;
            of_spots.left_share = out.left_share;
            return of_spots;
        }
        step = out.shift();
        out.shift_px = {before.x_px + out.shift_px.x_px, before.y_px + out.shift_px.y_px};
    }
    const double by_light = finder.shift_by_gradient_px2();
    out.by_light_px = {-by_light * out.gradient.x_px, -by_light * out.gradient.y_px};
    return out;
}

void move_to_lenslets(GridCalibration& of) {
    const PixelPoint by = of.odd_light.shift_px;
    LensletGrid& grid = of.fit.grid;
    const std::size_t half = grid.parameters.size() / 2;
    const bool polynomial = grid.model == algo::GridModelKind::cubic || grid.model == algo::GridModelKind::quintic;
    grid.parameters[0] += by.x_px;
    grid.parameters[polynomial ? half : 1] += by.y_px;
    grid.middle_x_px += by.x_px;
    grid.middle_y_px += by.y_px;
    for (Observation& seen : of.observations)
        seen.centre_px = {seen.centre_px.x_px + by.x_px, seen.centre_px.y_px + by.y_px};
}

}  // namespace hord::calib
