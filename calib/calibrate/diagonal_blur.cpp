#include "calib/calibrate/diagonal_blur.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <optional>
#include <vector>

#include <Eigen/Dense>

#include "calib/calibrate/cell_light.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

constexpr std::size_t kLenslets = 300, kMinLenslets = 8;
constexpr int kSide = kCells;
constexpr double kMinEdgePx2 = 0.36;  // sharper edges count as these, as for round lenslets
// Of the corner's shape, by power: the part that neither a shear nor a turn of the lenslets has. Derivatives by
// differences over a twelfth of a step are right to 3 % of edges a tenth of a step wide: ten times the power of that.
constexpr double kMinApart = 0.01;
// Cosine of four times the angle between the lenslets' sides and the lattice's steps: a turn is fitted to its first
// order only.
constexpr double kMinAlong = 0.8;

using Light = CellLight;

// The part that changes its sign in a mirror along a step, and that which does not; both are even under a half turn.
Light odd_part(const Light& of) {
    const Light mirrored = of.rowwise().reverse();
    return (of - mirrored + of.reverse() - mirrored.reverse()) / 4;
}
Light even_part(const Light& of) {
    const Light mirrored = of.rowwise().reverse();
    return (of + mirrored + of.reverse() + mirrored.reverse()) / 4;
}

// Derivatives along the steps; 0 at the rim.
Light along_u(const Light& of) {
    Light out = Light::Zero();
    for (Eigen::Index k = 1; k + 1 < kSide; ++k) out.col(k) = (of.col(k + 1) - of.col(k - 1)) * (kSide / 2.0);
    return out;
}
Light along_v(const Light& of) { return along_u(of.transpose()).transpose(); }

// The steps that the lenslets' sides lie along: those of a hexagonal lattice have three ways. `lobes` are those of the
// lenslets' corners (CentreFinder::lobes). None if no step lies along them.
struct Way {
    double cosine = 1, sine = 0;  // of its turn from along_u
    [[nodiscard]] LensletGrid::Steps of(const LensletGrid::Steps& s) const {
        const auto mixed = [&](double p, double q) {
            return PixelPoint{p * s.along_u.x_px + q * s.along_v.x_px, p * s.along_u.y_px + q * s.along_v.y_px};
        };
        return {mixed(cosine, sine), mixed(-sine, cosine)};
    }
};
std::optional<Way> way_of(const LensletGrid& grid, std::complex<double> lobes) {
    std::vector<Way> ways{{}};
    if (grid.kind == algo::LatticeKind::hexagonal) ways = {{}, {0.5, algo::kHalfSqrt3}, {0.5, -algo::kHalfSqrt3}};
    const LensletGrid::Steps middle = grid.steps_px({0, 0});
    for (const Way& way : ways) {
        const PixelPoint along = way.of(middle).along_u;
        // Corners lie half a right angle from the sides.
        if (-(lobes * std::polar(1.0, -4 * std::atan2(along.y_px, along.x_px))).real() >= kMinAlong * std::abs(lobes))
            return way;
    }
    return std::nullopt;
}

double product(const Light& a, const Light& b, const Light& window) { return (a * b * window).sum(); }

// The variance of the edge's place, in steps: of an even light, along u, in the middle of the lenslet's side.
double edge_variance(const Light& of) {
    double all = 0, first = 0, second = 0;
    for (Eigen::Index k = kSide / 2; k + 1 < kSide; ++k) {
        const double fall = (of.col(k) - of.col(k + 1)).segment(kSide / 4, kSide / 2).sum(),
                     u = place_of(k) + 0.5 / kSide;
        if (fall <= 0) continue;
        all += fall;
        first += fall * u;
        second += fall * u * u;
    }
    return all > 0 ? second / all - std::pow(first / all, 2) : 0;
}

// What of a lenslet's light a blur along one diagonal makes, in units of the variance along that diagonal less that
// along the other, in squared steps: a product with the light. Of I, such a blur b adds b / 2 times the derivative of I
// along both steps. A shear adds u I_v + v I_u and a turn u I_v - v I_u, which are fitted together with it.
std::optional<Light> weight_for(const Light& even, const Light& window) {
    const Light by_u = along_u(even), by_v = along_v(even);
    Light u, v;
    for (Eigen::Index k = 0; k < kSide; ++k) u.col(k).setConstant(place_of(k)), v.row(k).setConstant(place_of(k));
    const std::array<Light, 3> shapes{along_v(by_u) / 2, u * by_v, v * by_u};
    Eigen::Matrix3d normal;
    for (Eigen::Index i = 0; i < 3; ++i) {
        for (Eigen::Index j = 0; j < 3; ++j)
            normal(i, j) = product(shapes[static_cast<std::size_t>(i)], shapes[static_cast<std::size_t>(j)], window);
    }
    const Eigen::Matrix3d inverse = normal.inverse();
    if (!(inverse(0, 0) > 0) || !(1 / inverse(0, 0) > kMinApart * normal(0, 0))) return {};
    Light out = Light::Zero();
    for (Eigen::Index i = 0; i < 3; ++i) out += inverse(0, i) * shapes[static_cast<std::size_t>(i)] * window;
    return out;
}

}  // namespace

EdgeBlur diagonal_blur(const WhiteImage& image, const LensletGrid& grid, std::span<const Observation> observations,
                       std::complex<double> lobes, double smooth_px2) {
    const auto way = way_of(grid, lobes);
    if (!way) return {};
    std::vector<Light> lights;
    const std::size_t every = std::max<std::size_t>(1, observations.size() / kLenslets);
    for (std::size_t k = 0; k < observations.size(); k += every) {
        if (!observations[k].used) continue;
        const LensletGrid::Steps steps = way->of(grid.steps_px(grid.uv(observations[k].m, observations[k].n)));
        if (const auto light = light_about(image, observations[k].centre_px, steps)) lights.push_back(*light);
    }
    if (lights.size() < kMinLenslets) return {};
    Light mean = Light::Zero();
    for (const Light& light : lights) mean += light / static_cast<double>(lights.size());
    // Rows of a hexagonal lattice are nearer to each other than their lenslets.
    Light window = Light::Ones();
    const auto narrow = [](Eigen::Index k) { return std::abs(place_of(k)) < algo::kHalfSqrt3 / 2; };
    for (Eigen::Index k = 0; k < kSide; ++k) {
        if (grid.stagger == algo::Stagger::rows && !narrow(k)) window.row(k).setZero();
        if (grid.stagger == algo::Stagger::columns && !narrow(k)) window.col(k).setZero();
    }
    const Light even = even_part(mean);
    const auto weight = weight_for(even, window);
    if (!weight) return {};
    const Light own = (even - even.mean());
    std::vector<double> more;
    for (const Light& light : lights) {
        const double amplitude = (light * own).sum() / own.square().sum();
        if (amplitude > 0) more.push_back((odd_part(light) * *weight).sum() / amplitude);
    }
    if (more.size() < kMinLenslets) return {};
    const double pitch2 = std::abs(grid.steps_px({0, 0}).area_px2());
    const double median = common::upper_median(std::span(more));
    for (double& value : more) value = std::abs(value - median);
    const double sigma =
        1.2533 / 0.6745 * common::upper_median(std::span(more)) / std::sqrt(static_cast<double>(more.size()));
    const double edges = pitch2 * (edge_variance(even) + edge_variance(even.transpose())) / 2 - smooth_px2;
    return {pitch2 * std::abs(median), pitch2 * sigma, std::max(kMinEdgePx2, edges)};
}

}  // namespace hord::calib
