#include "calib/calibrate/cut_lenslets.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <vector>

#include <Eigen/Dense>

#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr int kSide = 6;                 // regions of the frame along its width and height
constexpr std::size_t kFewest = 4;       // lenslets of a region
constexpr std::size_t kLenslets = 1000;  // that are measured
constexpr Eigen::Index kParameters = 7;

Eigen::Matrix2d matrix_of(const algo::LensletGrid::Steps& s) {
    return (Eigen::Matrix2d() << s.along_u.x_px, s.along_v.x_px, s.along_u.y_px, s.along_v.y_px).finished();
}
// The shape of a round lenslet that is stretched so.
Elongation stretched(const Eigen::Matrix2d& scale) {
    const Eigen::Matrix2d moments = scale * scale.transpose();
    return {(moments(0, 0) - moments(1, 1)) / moments.trace(), 2 * moments(0, 1) / moments.trace()};
}

// Medians of one region.
struct Region {
    std::vector<double> x, y, along_x, aslant, grid_along_x, grid_aslant;
};

// What lenslets do that a stop cuts. With z = x + iy and e = along_x + i aslant, -e = k (z - z0)^2 where they are
// narrower along the way to the place z0 by k times the squared distance. A stop that is far to one side cuts by the
// distance itself: e changes evenly over the frame, by z and by its conjugate. So the law is
//     -e = k z^2 + b z + c conj(z) + const
// with a real k; e and the other constants are complex.
struct Law {
    double k = 0, k_sigma = 0;
    std::complex<double> b, c, constant;
    double linear_sigma = 0;
    // The most that e changes from the frame's middle to half a diagonal, beside the squares.
    [[nodiscard]] double linear() const { return std::abs(b) + std::abs(c); }
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
        a.row(at) << x * x - y * y, x, -y, x, y, 1, 0;
        seen(at++) = -median(region.*along_x);
        a.row(at) << 2 * x * y, y, x, -y, x, 0, 1;
        seen(at++) = -median(region.*aslant);
    }
    const auto solver = a.colPivHouseholderQr();
    if (solver.rank() < kParameters || rows <= kParameters) return {};
    const Eigen::VectorXd f = solver.solve(seen);
    const double variance = (a * f - seen).squaredNorm() / static_cast<double>(rows - kParameters);
    const Eigen::VectorXd variances = variance * (a.transpose() * a).inverse().diagonal();
    return {f(0),         std::sqrt(variances(0)),
            {f(1), f(2)}, {f(3), f(4)},
            {f(5), f(6)}, std::sqrt(variances.segment(1, 4).sum())};
}

}  // namespace

CutLenslets cut_lenslets(const algo::LensletGrid& grid, std::span<const Observation> observations,
                         const std::function<std::optional<Elongation>(const Observation&)>& measure) {
    std::vector<Region> regions(static_cast<std::size_t>(kSide) * kSide);
    const double half = 0.5 * std::hypot(grid.width_px, grid.height_px);
    const Eigen::Matrix2d middle = matrix_of(grid.steps_px({0, 0}));
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
        // As the grid's distortion makes it, if it scales lenslets as it scales their distances.
        const Elongation expected = stretched(matrix_of(grid.steps_px(grid.uv(seen.m, seen.n))) * middle.inverse());
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
    const Law of_grid = fit_law(regions, &Region::grid_along_x, &Region::grid_aslant);
    const Law beyond{.b = law.b - of_grid.b, .c = law.c - of_grid.c, .constant = {}};
    // Pixels and lattices that are not as high as wide may have lenslets of that shape.
    const Elongation own = stretched(middle);
    const double elongated =
        std::min(std::abs(law.constant), std::abs(law.constant + std::complex(own.along_x, own.aslant)));
    return {.narrower = law.k,
            .sigma = law.k_sigma,
            .of_grid = of_grid.k,
            .uneven = std::min(law.linear(), beyond.linear()),
            .uneven_sigma = law.linear_sigma,
            .elongated = elongated};
}

}  // namespace hord::calib
