#include "calib/calibrate/straight_edges.h"

#include <cmath>
#include <complex>
#include <numbers>

#include <Eigen/Dense>

#include "calib/lattice/centre_weights.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

constexpr int kForShape = 100;  // lenslets

}  // namespace

double corners_of(const CentreFinder& finder, const Lattice& lattice, std::span<const PixelPoint> places) {
    const bool square = lattice.kind == algo::LatticeKind::square;
    const int count = square ? 4 : 6;
    // Spots have no straight edges, and soft ones need no smoothing (it hides the inside of lenslets from fall_off()).
    const bool sharp = finder.weights().plateau && finder.edge_variance_px2() < kSmooth * kSmooth;
    const PixelPoint to_neighbour = lattice.stagger == algo::Stagger::columns ? lattice.step_v : lattice.step_u;
    std::complex<double> sum, four;
    int measured = 0;
    for (const PixelPoint& place : places) {
        const auto spot = finder.measure(place, 0.3 * lattice.pitch_px());
        const auto lobes = spot ? finder.lobes(spot->centre_px, count) : std::nullopt;
        if (!lobes) continue;
        sum += *lobes;
        if (!square && sharp) four += finder.lobes(spot->centre_px, 4).value_or(0.0);
        if (++measured == kForShape) break;
    }
    if (measured == 0) return 0;
    const double between = -(sum * std::polar(1.0, -count * std::atan2(to_neighbour.y_px, to_neighbour.x_px))).real();
    return (square ? between : std::max(between, std::abs(four))) / measured;
}

void remove_pixel_phase(const LensletGrid& grid, std::vector<Observation>& observations) {
    for (double PixelPoint::*axis : {&PixelPoint::x_px, &PixelPoint::y_px}) {
        const auto waves = [&](const PixelPoint& at) {
            const double turn = 2 * std::numbers::pi * at.*axis;
            return Eigen::Vector2d(std::sin(turn), std::sin(2 * turn));
        };
        Eigen::Matrix2d normal = 1e-3 * static_cast<double>(observations.size()) * Eigen::Matrix2d::Identity();
        Eigen::Vector2d right = Eigen::Vector2d::Zero();
        for (const Observation& seen : observations) {
            if (!seen.used) continue;
            const PixelPoint of_model = grid.at(grid.uv(seen.m, seen.n));
            const Eigen::Vector2d here = waves(of_model);
            normal += here * here.transpose();
            right += (seen.centre_px.*axis - of_model.*axis) * here;
        }
        const Eigen::Vector2d height = normal.ldlt().solve(right);
        for (Observation& seen : observations)
            seen.centre_px.*axis -= height.dot(waves(grid.centre_px(seen.m, seen.n)));
    }
}

}  // namespace hord::calib
