#include "calib/calibrate/cut_lenslets.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <vector>

#include <Eigen/Dense>

#include "calib/lattice/round_lenslet.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr int kSide = 6;                 // regions of the frame along its width and height
constexpr std::size_t kFewest = 4;       // lenslets of a region
constexpr std::size_t kLenslets = 1000;  // that are measured
constexpr Eigen::Index kParameters = 7;
// Lenslets that a round one is fitted to, from the first of so many; of a pitch: those of one size.
constexpr std::size_t kOfMiddle = 100, kSearched = 4000;
constexpr double kSameSize = 0.005;
// Of what a relay lens that distorts makes of the lenslets' shape: to first order in the distortion, by which drawn
// frames of k1 -0.06 to 0.08 differ by up to 0.16; and of round lenslets, in their window among their neighbours. Of
// what the neighbours' light makes of it: it changes by the half if a rim is off by 1 % of the radius, and drawn frames
// of 9 px differ by up to 1.2, of 10 px and more by up to 0.6.
constexpr double kRelay = 0.2, kModelled = 0.05, kNeighbours = 1;

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
    std::vector<double> x, y, along_x, aslant;
    std::vector<const Observation*> seen;
};
// The lenslet nearest to a region's middle.
const Observation& typical(const Region& region) {
    std::vector<double> xs = region.x, ys = region.y;
    const double x = common::upper_median(std::span(xs)), y = common::upper_median(std::span(ys));
    const auto off = [&](std::size_t k) { return std::hypot(region.x[k] - x, region.y[k] - y); };
    std::size_t nearest = 0;
    for (std::size_t k = 1; k < region.seen.size(); ++k) nearest = off(k) < off(nearest) ? k : nearest;
    return *region.seen[nearest];
}

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
Law fit_law(std::span<const Region> regions) {
    const auto rows = static_cast<Eigen::Index>(2 * regions.size());
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(rows, kParameters);
    Eigen::VectorXd seen(rows);
    Eigen::Index at = 0;
    const auto median = [](std::vector<double> of) { return common::upper_median(std::span(of)); };
    for (const Region& region : regions) {
        const double x = median(region.x), y = median(region.y);
        a.row(at) << x * x - y * y, x, -y, x, y, 1, 0;
        seen(at++) = -median(region.along_x);
        a.row(at) << 2 * x * y, y, x, -y, x, 0, 1;
        seen(at++) = -median(region.aslant);
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

// The law of shapes that are known region by region.
Law law_of(std::span<const Region> regions, std::span<const Elongation> shapes) {
    std::vector<Region> known(regions.size());
    for (std::size_t k = 0; k < regions.size(); ++k) {
        known[k].x = regions[k].x, known[k].y = regions[k].y;
        known[k].along_x = {shapes[k].along_x}, known[k].aslant = {shapes[k].aslant};
    }
    return fit_law(known);
}

// How much narrower the lenslets are than whole ones would be, whose shape in a region is `whole`.
CutLenslets::Beyond beyond(std::span<const Region> regions, std::span<const Elongation> whole, double spread) {
    std::vector<Region> left(regions.begin(), regions.end());
    for (std::size_t k = 0; k < left.size(); ++k) {
        for (double& value : left[k].along_x) value -= whole[k].along_x;
        for (double& value : left[k].aslant) value -= whole[k].aslant;
    }
    const Law law = fit_law(left), of_whole = law_of(regions, whole);
    return {.narrower = law.k,
            .sigma = law.k_sigma,
            .spread = spread * std::abs(of_whole.k),
            .uneven = std::max(0.0, law.linear() - spread * of_whole.linear()),
            .uneven_sigma = law.linear_sigma};
}

// Lenslets of the size of those in the frame's middle: their lattice's steps are as long.
std::vector<Spot> spots_of_middle(const algo::LensletGrid& grid, std::span<const Observation> observations) {
    const double middle = grid.steps_px({0, 0}).mean_px();
    std::vector<Spot> out;
    const std::size_t every = std::max<std::size_t>(1, observations.size() / kSearched);
    for (std::size_t k = 0; k < observations.size() && out.size() < kOfMiddle; k += every) {
        const Observation& seen = observations[k];
        if (!seen.used || std::abs(grid.steps_px(grid.uv(seen.m, seen.n)).mean_px() / middle - 1) > kSameSize) continue;
        out.push_back({.centre_px = seen.centre_px, .amplitude_dn = seen.light_dn});
    }
    return out;
}

// Whole lenslets, region by region: of one size everywhere, and scaled as a relay lens scales them.
struct Whole {
    std::vector<Elongation> one_size, scaled;
    double spread_one_size = 0, spread_scaled = 0;  // of what they are: how far that may be off
};
Whole whole_lenslets(const algo::LensletGrid& grid, std::span<const Region> regions,
                     const std::optional<RoundLenslet>& lenslet, const CentreFinder& middle,
                     const std::function<const CentreFinder&(const Observation&)>& finder_at) {
    Whole out;
    const auto steps = grid.steps_px({0, 0});
    if (lenslet) out.spread_one_size = kNeighbours, out.spread_scaled = kModelled;
    else out.spread_scaled = kRelay;
    const double shown = middle.stretch_shown();
    for (const Region& region : regions) {
        const Observation& seen = typical(region);
        const auto here = grid.steps_px(grid.uv(seen.m, seen.n));
        if (lenslet) {
            out.one_size.push_back(
                elongation_of_one_size(finder_at(seen), *lenslet, neighbours_of(here, grid.stagger)));
            out.scaled.push_back(elongation_of_scaled(finder_at(seen), *lenslet, here, steps, grid.stagger));
        } else {
            const Elongation of_grid = stretched(matrix_of(here) * matrix_of(steps).inverse());
            out.one_size.emplace_back();
            out.scaled.push_back({shown * of_grid.along_x, shown * of_grid.aslant});
        }
    }
    return out;
}

}  // namespace

CutLenslets cut_lenslets(const WhiteImage& image, const algo::LensletGrid& grid,
                         std::span<const Observation> observations, const CentreFinder& middle,
                         const std::function<const CentreFinder&(const Observation&)>& finder_at) {
    std::vector<Region> regions(static_cast<std::size_t>(kSide) * kSide);
    const double half = 0.5 * std::hypot(grid.width_px, grid.height_px);
    const std::size_t every = std::max<std::size_t>(1, observations.size() / kLenslets);
    for (std::size_t k = 0; k < observations.size(); k += every) {
        const Observation& seen = observations[k];
        if (!seen.used) continue;
        const auto shape = finder_at(seen).elongation(seen.centre_px);
        if (!shape) continue;
        const auto part = [](double place, int size) {
            return static_cast<std::size_t>(std::clamp(static_cast<int>(kSide * place / size), 0, kSide - 1));
        };
        const algo::PixelPoint at = seen.centre_px;
        Region& region = regions[part(at.y_px, grid.height_px) * kSide + part(at.x_px, grid.width_px)];
        region.x.push_back((at.x_px - grid.middle_x_px) / half);
        region.y.push_back((at.y_px - grid.middle_y_px) / half);
        region.along_x.push_back(shape->along_x);
        region.aslant.push_back(shape->aslant);
        region.seen.push_back(&seen);
    }
    std::erase_if(regions, [](const Region& region) { return region.x.size() < kFewest; });
    if (regions.size() < 4) return {};
    const Law law = fit_law(regions);
    // Pixels and lattices that are not as high as wide may have lenslets of that shape.
    const Elongation own = stretched(matrix_of(grid.steps_px({0, 0})));
    const double elongated =
        std::min(std::abs(law.constant), std::abs(law.constant + std::complex(own.along_x, own.aslant)));
    // Small squares look round in a smoothed frame, but a relay lens does not scale what smoothing blurs.
    const auto lenslet = image.smoothed_px() > 0 ? std::nullopt
                                                 : round_lenslet(image, spots_of_middle(grid, observations), middle,
                                                                 neighbours_of(grid.steps_px({0, 0}), grid.stagger));
    const Whole whole = whole_lenslets(grid, regions, lenslet, middle, finder_at);
    return {.one_size = beyond(regions, whole.one_size, whole.spread_one_size),
            .scaled = beyond(regions, whole.scaled, whole.spread_scaled),
            .elongated = elongated};
}

}  // namespace hord::calib
