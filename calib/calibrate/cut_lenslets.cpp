#include "calib/calibrate/cut_lenslets.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr int kSide = 6;                 // regions of the frame along its width and height
constexpr std::size_t kFewest = 4;       // lenslets of a region
constexpr std::size_t kLenslets = 1000;  // that are measured
constexpr Eigen::Index kParameters = 5;

// The shape that the grid's distortion gives to a round lenslet, if it scales lenslets as it scales their distances.
Elongation of_steps(const algo::LensletGrid::Steps& here, const algo::LensletGrid::Steps& middle) {
    const auto matrix = [](const algo::LensletGrid::Steps& s) {
        return (Eigen::Matrix2d() << s.along_u.x_px, s.along_v.x_px, s.along_u.y_px, s.along_v.y_px).finished();
    };
    const Eigen::Matrix2d scale = matrix(here) * matrix(middle).inverse(), moments = scale * scale.transpose();
    return {(moments(0, 0) - moments(1, 1)) / moments.trace(), 2 * moments(0, 1) / moments.trace()};
}

// Medians of one region.
struct Region {
    std::vector<double> x, y, along_x, aslant, grid_along_x, grid_aslant;
};

// What lenslets do that are narrower along the way to one place, by `k` times the squared distance r2:
//     -along_x = k ((x - x0)^2 - (y - y0)^2) + const    -aslant = 2 k (x - x0) (y - y0) + const
// linear in k, k x0, k y0 and two constants.
struct Law {
    double k = 0, sigma = 0;
};
Law fit_law(std::span<const Region> regions, std::vector<double> Region::*along_x,
            std::vector<double> Region::*aslant) {
    const auto rows = static_cast<Eigen::Index>(2 * regions.size());
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(rows, kParameters);
    Eigen::VectorXd seen(rows);
    Eigen::Index at = 0;
    const auto median = [](std::vector<double> of) { return common::upper_median(std::span(of)); };
    for (const Region& region : regions) {
        const double x = median(region.x), y = median(region.y);
        a.row(at) << x * x - y * y, -2 * x, 2 * y, 1, 0;
        seen(at++) = -median(region.*along_x);
        a.row(at) << 2 * x * y, -2 * y, -2 * x, 0, 1;
        seen(at++) = -median(region.*aslant);
    }
    const auto solver = a.colPivHouseholderQr();
    if (solver.rank() < kParameters) return {};
    const Eigen::VectorXd fitted = solver.solve(seen);
    const double variance = (a * fitted - seen).squaredNorm() / static_cast<double>(rows - kParameters);
    return {fitted(0), std::sqrt(variance * (a.transpose() * a).inverse()(0, 0))};
}

}  // namespace

CutLenslets cut_lenslets(const algo::LensletGrid& grid, std::span<const Observation> observations,
                         const std::function<std::optional<Elongation>(const Observation&)>& measure) {
    std::vector<Region> regions(static_cast<std::size_t>(kSide) * kSide);
    const double half = 0.5 * std::hypot(grid.width_px, grid.height_px);
    const algo::LensletGrid::Steps middle = grid.steps_px({0, 0});
    const std::size_t every = std::max<std::size_t>(1, observations.size() / kLenslets);
    for (std::size_t k = 0; k < observations.size(); k += every) {
        const Observation& seen = observations[k];
        if (!seen.used) continue;
        const auto shape = measure(seen);
        if (!shape) continue;
        const auto part = [](double place, int size) {
            return static_cast<std::size_t>(std::clamp(static_cast<int>(kSide * place / size), 0, kSide - 1));
        };
        const algo::PixelPoint at = seen.centre_px;
        Region& region = regions[part(at.y_px, grid.height_px) * kSide + part(at.x_px, grid.width_px)];
        const Elongation expected = of_steps(grid.steps_px(grid.uv(seen.m, seen.n)), middle);
        region.x.push_back((at.x_px - grid.middle_x_px) / half);
        region.y.push_back((at.y_px - grid.middle_y_px) / half);
        region.along_x.push_back(shape->along_x);
        region.aslant.push_back(shape->aslant);
        region.grid_along_x.push_back(expected.along_x);
        region.grid_aslant.push_back(expected.aslant);
    }
    std::erase_if(regions, [](const Region& region) { return region.x.size() < kFewest; });
    if (regions.size() < 4) return {};
    const Law law = fit_law(regions, &Region::along_x, &Region::aslant);
    return {law.k, law.sigma, fit_law(regions, &Region::grid_along_x, &Region::grid_aslant).k};
}

}  // namespace hord::calib
