#include "calib/lattice/round_lenslet.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Dense>

#include "calib/lattice/centre_weights.h"

namespace hord::calib {
namespace {

using algo::PixelPoint;

constexpr int kAngles = 16, kRings = 24;  // of half a turn: a lattice is the same after it
constexpr double kMaxMisfit = 0.01;       // RMS, of the profile's height
constexpr double kMinEdgePx = 0.2;        // sharper ones differ within a pixel only
constexpr int kRounds = 12;
constexpr std::size_t kMinSpots = 8;

// Light of a lenslet and its neighbours.
double light_at(const RoundLenslet& lenslet, const Neighbours& neighbours, double x, double y) {
    double sum = lenslet.light(std::hypot(x, y));
    const double reach = lenslet.radius_px + 5 * lenslet.edge_px;
    for (int k = 0; k < neighbours.count; ++k) {
        const PixelPoint& at = neighbours.to[static_cast<std::size_t>(k)];
        const double r = std::hypot(x - at.x_px, y - at.y_px);
        if (r < reach) sum += lenslet.light(r);
    }
    return sum;
}

// Rings that cover a window, and their part of it.
struct Ring {
    double r, area;
};
std::vector<Ring> rings_of(const Weights& weights) {
    std::vector<Ring> out;
    for (int k = 0; k < kRings; ++k) {
        const double r = (k + 0.5) / kRings * weights.radius;
        out.push_back({r, r * lookup(weights.window, r)});
    }
    return out;
}

// How the profile differs from that of `lenslet`, ring by ring, after the best height and level; RMS in `misfit`.
Eigen::VectorXd misfit_of(const RoundLenslet& lenslet, const Profile& profile, const Neighbours& neighbours,
                          const std::vector<Ring>& rings) {
    const auto rows = static_cast<Eigen::Index>(rings.size());
    Eigen::MatrixXd model(rows, 2);
    Eigen::VectorXd seen(rows);
    double all = 0;
    for (const Ring& ring : rings) all += ring.area;
    for (Eigen::Index k = 0; k < rows; ++k) {
        const Ring& ring = rings[static_cast<std::size_t>(k)];
        double mean = 0;
        for (int angle = 0; angle < kAngles; ++angle) {
            const double turn = std::numbers::pi * (angle + 0.5) / kAngles;
            mean += light_at(lenslet, neighbours, ring.r * std::cos(turn), ring.r * std::sin(turn)) / kAngles;
        }
        const double weight = std::sqrt(ring.area / all);
        model.row(k) << weight * mean, weight;
        seen(k) = weight * lookup(profile.value, ring.r);
    }
    return seen - model * model.colPivHouseholderQr().solve(seen);
}

template <class LightAt>
Elongation elongation_in_window(const Weights& weights, LightAt light) {
    // As CentreFinder::elongation(): moments of the light less the background that the profile leaves.
    double area = 0, t = 0, tt = 0, l = 0, lt = 0, xx_yy = 0, along_x = 0, aslant = 0, rr = 0;
    for (const Ring& ring : rings_of(weights)) {
        const double profile = lookup(weights.profile, ring.r), r2 = ring.r * ring.r;
        for (int angle = 0; angle < kAngles; ++angle) {
            const double turn = std::numbers::pi * (angle + 0.5) / kAngles;
            const double here = ring.area * light(ring.r * std::cos(turn), ring.r * std::sin(turn));
            l += here;
            lt += here * profile;
            xx_yy += here * r2;
            along_x += here * r2 * std::cos(2 * turn);
            aslant += here * r2 * std::sin(2 * turn);
        }
        area += kAngles * ring.area;
        t += kAngles * ring.area * profile;
        tt += kAngles * ring.area * profile * profile;
        rr += kAngles * ring.area * r2;
    }
    const double spread = area * tt - t * t;
    if (!(spread > 0)) return {};
    const double amplitude = (area * lt - t * l) / spread, background = (l - amplitude * t) / area;
    const double all = xx_yy - background * rr;
    return all > 0 ? Elongation{along_x / all, aslant / all} : Elongation{};
}

}  // namespace

double RoundLenslet::light(double r_px) const {
    return 0.5 * std::erfc((r_px - radius_px) / (std::numbers::sqrt2 * edge_px));
}

Neighbours neighbours_of(const algo::LensletGrid::Steps& steps, algo::Stagger stagger) {
    const auto at = [&](double u, double v) {
        return PixelPoint{u * steps.along_u.x_px + v * steps.along_v.x_px,
                          u * steps.along_u.y_px + v * steps.along_v.y_px};
    };
    constexpr double kHigh = algo::kHalfSqrt3;
    Neighbours out;
    const auto add = [&](double u, double v) {
        out.to[static_cast<std::size_t>(out.count++)] = at(u, v);
        out.to[static_cast<std::size_t>(out.count++)] = at(-u, -v);
    };
    if (stagger == algo::Stagger::rows) add(1, 0), add(0.5, kHigh), add(-0.5, kHigh);
    else if (stagger == algo::Stagger::columns) add(0, 1), add(kHigh, 0.5), add(kHigh, -0.5);
    else add(1, 0), add(0, 1), add(1, 1), add(1, -1);
    return out;
}

// Gauss-Newton from the half height, by differences.
std::optional<RoundLenslet> round_lenslet(const WhiteImage& image, std::span<const Spot> spots,
                                          const CentreFinder& finder, const Neighbours& neighbours) {
    if (spots.size() < kMinSpots) return std::nullopt;
    const Profile profile = measure_profile(image, spots, finder.weights().radius);
    const std::vector<Ring> rings = rings_of(finder.weights());
    const auto misfit = [&](const RoundLenslet& of) { return misfit_of(of, profile, neighbours, rings); };
    RoundLenslet best{finder.half_height_radius_px(), std::sqrt(finder.edge_variance_px2())};
    Eigen::VectorXd left = misfit(best);
    for (int round = 0; round < kRounds; ++round) {
        constexpr double kStep = 0.01;  // px
        Eigen::MatrixXd slopes(left.size(), 2);
        slopes.col(0) = (misfit({best.radius_px + kStep, best.edge_px}) - left) / kStep;
        slopes.col(1) = (misfit({best.radius_px, best.edge_px + kStep}) - left) / kStep;
        const Eigen::Vector2d change = -slopes.colPivHouseholderQr().solve(left);
        bool better = false;
        for (double part = 1; part > 0.1 && !better; part /= 2) {
            const RoundLenslet next{std::max(1.0, best.radius_px + part * change(0)),
                                    std::max(kMinEdgePx, best.edge_px + part * change(1))};
            const Eigen::VectorXd then = misfit(next);
            better = then.squaredNorm() < left.squaredNorm();
            if (better) best = next, left = then;
        }
        if (!better || change.norm() < 0.1 * kStep) break;
    }
    if (!(left.norm() <= kMaxMisfit)) return std::nullopt;
    return best;
}

Elongation elongation_of_one_size(const CentreFinder& finder, const RoundLenslet& lenslet,
                                  const Neighbours& neighbours) {
    return elongation_in_window(finder.weights(),
                                [&](double x, double y) { return light_at(lenslet, neighbours, x, y); });
}

Elongation elongation_of_scaled(const CentreFinder& finder, const RoundLenslet& lenslet,
                                const algo::LensletGrid::Steps& steps, const algo::LensletGrid::Steps& middle,
                                algo::Stagger stagger) {
    const auto matrix = [](const algo::LensletGrid::Steps& s) {
        return (Eigen::Matrix2d() << s.along_u.x_px, s.along_v.x_px, s.along_u.y_px, s.along_v.y_px).finished();
    };
    const Eigen::Matrix2d back = matrix(middle) * matrix(steps).inverse();
    const Neighbours neighbours = neighbours_of(middle, stagger);
    return elongation_in_window(finder.weights(), [&](double x, double y) {
        const Eigen::Vector2d at = back * Eigen::Vector2d(x, y);
        return light_at(lenslet, neighbours, at.x(), at.y());
    });
}

}  // namespace hord::calib
