#include "calib/calibrate/pattern_shape.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <numeric>
#include <vector>

namespace hord::calib {

using algo::LensletGrid;
using algo::PixelPoint;

namespace {

// The mean of some lenslets, in cells along the primitive steps of the lattice: u and v, or for a hexagonal one two
// steps 60 degrees apart.
struct MeanLenslet {
    static constexpr int kSide = 16;  // cells along each step
    // Of the light and of the places of a cell's pixels, and their number.
    std::array<double, static_cast<std::size_t>(kSide) * kSide> sums{}, us{}, vs{}, hits{};

    static std::size_t cell(double u, double v) {
        const auto part = [](double at) { return static_cast<std::size_t>((at - std::floor(at)) * kSide) % kSide; };
        return part(v + 0.5) * kSide + part(u + 0.5);
    }
    // Light about a place, in steps from the lenslet's centre: the mean of 4x4 cells.
    [[nodiscard]] double at(double u, double v) const {
        double sum = 0, count = 0;
        for (const double dv : {-1.5, -0.5, 0.5, 1.5}) {
            for (const double du : {-1.5, -0.5, 0.5, 1.5}) {
                const std::size_t k = cell(u + du / kSide, v + dv / kSide);
                sum += sums[k];
                count += hits[k];
            }
        }
        return count > 0 ? sum / count : 0;
    }
};

MeanLenslet mean_lenslet(const WhiteImage& image, const GridCalibration& calibration) {
    constexpr std::size_t kLenslets = 300;
    const LensletGrid& grid = calibration.fit.grid;
    MeanLenslet mean;
    const std::size_t every = std::max<std::size_t>(1, calibration.observations.size() / kLenslets);
    for (std::size_t k = 0; k < calibration.observations.size(); k += every) {
        const Observation& seen = calibration.observations[k];
        if (!seen.used) continue;
        const LensletGrid::Steps steps = grid.steps_px(grid.uv(seen.m, seen.n));
        PixelPoint a = steps.along_u, b = steps.along_v;
        const auto mixed = [](PixelPoint p, double s, PixelPoint q, double t) {
            return PixelPoint{s * p.x_px + t * q.x_px, s * p.y_px + t * q.y_px};
        };
        if (grid.stagger == algo::Stagger::rows) b = mixed(a, 0.5, b, algo::kHalfSqrt3);
        if (grid.stagger == algo::Stagger::columns) a = mixed(b, 0.5, a, algo::kHalfSqrt3);
        const double det = a.x_px * b.y_px - a.y_px * b.x_px;
        const int reach = static_cast<int>(std::ceil(0.75 * (std::hypot(a.x_px, a.y_px) + std::hypot(b.x_px, b.y_px))));
        const auto cx = static_cast<int>(std::lround(seen.centre_px.x_px));
        const auto cy = static_cast<int>(std::lround(seen.centre_px.y_px));
        if (cx < reach || cy < reach || cx + reach >= image.width_px() || cy + reach >= image.height_px()) continue;
        for (int y = cy - reach; y <= cy + reach; ++y) {
            for (int x = cx - reach; x <= cx + reach; ++x) {
                const double dx = x - seen.centre_px.x_px, dy = y - seen.centre_px.y_px;
                const double u = (dx * b.y_px - dy * b.x_px) / det, v = (dy * a.x_px - dx * a.y_px) / det;
                if (std::abs(u) >= 0.5 || std::abs(v) >= 0.5) continue;
                const std::size_t cell = MeanLenslet::cell(u, v);
                mean.sums[cell] += image.at(x, y);
                mean.us[cell] += u;
                mean.vs[cell] += v;
                mean.hits[cell] += 1;
            }
        }
    }
    return mean;
}

// Share of the cells with less than half of the light.
double dark_share(const MeanLenslet& mean) {
    std::vector<double> light;
    for (std::size_t k = 0; k < mean.sums.size(); ++k) {
        if (mean.hits[k] > 0) light.push_back(mean.sums[k] / mean.hits[k]);
    }
    if (light.empty()) return 1;
    const auto [low, high] = std::ranges::minmax_element(light);
    const double half = (*low + *high) / 2;
    return static_cast<double>(std::ranges::count_if(light, [=](double of) { return of < half; })) /
        static_cast<double>(light.size());
}

// Light in the middle of a lenslet, half way to the neighbours, and in the places farthest from all lenslets.
struct LightAlong {
    double middle = 0, between = 0, farthest = 0;
    // Of one place, less that of a second, over that in the middle, less that of the second. 0 if it is dark there.
    [[nodiscard]] double share(double of, double less) const {
        return middle > less ? (of - less) / (middle - less) : 0;
    }
};
LightAlong light_along(const MeanLenslet& mean, algo::LatticeKind kind) {
    if (kind == algo::LatticeKind::square)
        return {mean.at(0, 0), (mean.at(0.5, 0) + mean.at(0, 0.5)) / 2, mean.at(0.5, 0.5)};
    // The third neighbour lies at the difference of the steps.
    return {mean.at(0, 0), (mean.at(0.5, 0) + mean.at(0, 0.5) + mean.at(0.5, -0.5)) / 3,
            (mean.at(1 / 3.0, 1 / 3.0) + mean.at(-1 / 3.0, -1 / 3.0)) / 2};
}

// Of harmonics' real parts: those of order p along the first step and q along the second stand in row q, column p.
constexpr int kHarmonics = 4, kOrders = 2 * kHarmonics + 1;
struct RealParts {
    std::array<std::array<double, kOrders>, kOrders> of{};
    double& at(int p, int q) {
        return of[static_cast<std::size_t>(q + kHarmonics)][static_cast<std::size_t>(p + kHarmonics)];
    }
};
// PatternShape::unequal, of a square lattice.
double unequal(RealParts real) {
    double differences = 0, squares = 0;
    for (int q = -kHarmonics; q <= kHarmonics; ++q) {
        for (int p = -kHarmonics; p <= kHarmonics; ++p) {
            const double here = real.at(p, q), turned = real.at(-q, p);
            differences += (here - turned) * (here - turned);
            squares += here * here + turned * turned;
        }
    }
    return squares > 0 ? differences / (2 * squares) : 0;
}

}  // namespace

PatternShape shape_of(const WhiteImage& image, const GridCalibration& calibration) {
    const LensletGrid& grid = calibration.fit.grid;
    const MeanLenslet of = mean_lenslet(image, calibration);
    const auto &sums = of.sums, &hits = of.hits;
    const double pixels = std::accumulate(hits.begin(), hits.end(), 0.0);
    if (pixels == 0) return {.even_share = 1};
    const double mean = std::accumulate(sums.begin(), sums.end(), 0.0) / pixels;
    const bool square = grid.kind == algo::LatticeKind::square;
    RealParts real;
    double all = 0, waves = 0, first = 0, even = 0;
    for (int q = -kHarmonics; q <= kHarmonics; ++q) {
        for (int p = -kHarmonics; p <= kHarmonics; ++p) {
            if (p == 0 && q == 0) continue;
            // Each cell counts by its pixels, where these lie: at small or whole pitches some cells have none.
            std::complex<double> sum;
            for (std::size_t cell = 0; cell < sums.size(); ++cell) {
                if (hits[cell] == 0) continue;
                const double turns = (p * of.us[cell] + q * of.vs[cell]) / hits[cell];
                sum += (sums[cell] - mean * hits[cell]) * std::polar(1.0, -2 * std::numbers::pi * turns);
            }
            const double power = std::norm(sum);
            real.at(p, q) = sum.real();
            all += power;
            // Of a hexagonal lattice, steps 60 degrees apart have a third fundamental at (1, 1) or (1, -1).
            const bool third = !square && std::abs(p) == 1 && std::abs(q) == 1 &&
                p * q * (grid.steps_px({0, 0}).area_px2() > 0 ? 1 : -1) > 0;
            if (std::abs(p) + std::abs(q) == 1 || third) waves += power;
            if (std::abs(p) <= 1 && std::abs(q) <= 1) first += power;
            if ((p + q) % (square ? 2 : 3) == 0) even += power;
        }
    }
    if (!(all > 0)) return {.even_share = 1};
    const LightAlong light = light_along(of, grid.kind);
    return {.wave_share = waves / all,
            .first_share = square ? first / all : 0,
            .even_share = even / all,
            .between = light.share(light.between, light.farthest),
            .dark_share = dark_share(of),
            .second = light.share(light.farthest, light.between),
            .unequal = square ? unequal(real) : 0};
}

}  // namespace hord::calib
