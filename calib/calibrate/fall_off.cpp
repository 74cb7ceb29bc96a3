#include "calib/calibrate/fall_off.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr int kTerms = 6, kRounds = 3;
constexpr double kOutlier = 4;  // median deviations: dust and lenslets lit in part are no fall-off

constexpr double kMaxMoved = 2;      // of fall-off and noise together
constexpr std::size_t kMoved = 100;  // lenslets

// The variance of the grid's places, both axes together: that of one centre, less by the lenslets a parameter of the
// model. Lenslets with places of their own keep their noise.
double grid_variance(const GridFit& fit) {
    const auto power = [](double x, double y) { return x * x + y * y; };
    if (fit.shifts.share > 0) return power(fit.shifts.left_x_px, fit.shifts.left_y_px);
    return power(fit.cv_x_rms_px, fit.cv_y_rms_px) * fit.correlation_inflation *
        static_cast<double>(fit.grid.parameters.size()) / (2.0 * fit.used);
}

// RMS distance between two grids of a frame, at some of the lenslets that both have measured.
double moved_px(const GridCalibration& a, const GridCalibration& b) {
    double sum = 0;
    int count = 0;
    const auto at = [](const GridCalibration& of, const Observation& seen) {
        return of.fit.grid.at(of.fit.grid.uv(seen.m, seen.n));
    };
    for (std::size_t k = 0; k < a.observations.size(); k += 1 + a.observations.size() / kMoved) {
        const algo::PixelPoint here = at(a, a.observations[k]);
        double nearest = a.lattice.pitch_px() / 2;
        for (const Observation& seen : b.observations) {
            const algo::PixelPoint there = at(b, seen);
            nearest = std::min(nearest, std::hypot(there.x_px - here.x_px, there.y_px - here.y_px));
        }
        if (nearest == a.lattice.pitch_px() / 2) continue;
        sum += nearest * nearest;
        ++count;
    }
    return std::sqrt(sum / std::max(1, count));
}

}  // namespace

FallOff fall_off(std::span<const Observation> observations) {
    FallOff out;
    if (observations.size() < 2 * kTerms) return out;
    // Places over a scale of about half the frame, so that the normal equations are well conditioned.
    double scale = 1, typical = 0;
    for (const Observation& seen : observations) {
        scale = std::max({scale, seen.centre_px.x_px, seen.centre_px.y_px});
        typical += seen.light_dn / static_cast<double>(observations.size());
    }
    using Terms = Eigen::Matrix<double, kTerms, 1>;
    const auto u_of = [&](const Observation& seen) { return 2 * seen.centre_px.x_px / scale - 1; };
    const auto v_of = [&](const Observation& seen) { return 2 * seen.centre_px.y_px / scale - 1; };
    const auto terms = [&](const Observation& seen) {
        const double u = u_of(seen), v = v_of(seen);
        return Terms(1, u, v, u * u, u * v, v * v);
    };
    Terms law = Terms::Zero();
    std::vector<std::uint8_t> kept(observations.size(), 1);
    std::vector<double> off(observations.size());
    for (int round = 0; round < kRounds; ++round) {
        Eigen::Matrix<double, kTerms, kTerms> normal = Eigen::Matrix<double, kTerms, kTerms>::Identity() * 1e-9;
        Terms right = Terms::Zero();
        for (std::size_t k = 0; k < observations.size(); ++k) {
            if (kept[k] == 0) continue;
            const Terms here = terms(observations[k]);
            normal += here * here.transpose();
            right += here * observations[k].light_dn;
        }
        law = normal.ldlt().solve(right);
        for (std::size_t k = 0; k < observations.size(); ++k)
            off[k] = std::abs(observations[k].light_dn - law.dot(terms(observations[k])));
        std::vector<double> sorted = off;
        const double most = kOutlier * common::upper_median(std::span(sorted));
        for (std::size_t k = 0; k < observations.size(); ++k) kept[k] = off[k] <= most ? 1 : 0;
    }
    double sum = 0;
    int count = 0;
    for (std::size_t k = 0; k < observations.size(); ++k) {
        const double u = u_of(observations[k]), v = v_of(observations[k]), light = law.dot(terms(observations[k]));
        if (kept[k] == 0 || light < 0.1 * typical) continue;
        const double slope =
            std::hypot(law(1) + 2 * law(3) * u + law(4) * v, law(2) + law(4) * u + 2 * law(5) * v) * 2 / scale / light;
        sum += slope * slope;
        out.max_per_px = std::max(out.max_per_px, slope);
        ++count;
    }
    if (count > 0) out.rms_per_px = std::sqrt(sum / count);
    return out;
}

bool replaces(const GridCalibration& first, const GridCalibration& again, double by_fall_off_px) {
    const double by_noise = grid_variance(again.fit), power = by_fall_off_px * by_fall_off_px;
    return again.fit.rejected <= first.fit.rejected && by_noise - grid_variance(first.fit) <= power &&
        std::pow(moved_px(first, again), 2) <= kMaxMoved * kMaxMoved * (power + by_noise);
}

}  // namespace hord::calib
