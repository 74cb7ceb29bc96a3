// Derivatives of the grid models, and the robust linear start.
#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "calib/fit/grid_fit.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

// u^p v^q for p + q <= order, in the order of algo/frame/lenslet_grid.cpp.
int monomials(int order, double u, double v, double* out) {
    int at = 0;
    for (int degree = 0; degree <= order; ++degree) {
        for (int q = 0; q <= degree; ++q) {
            double term = 1;
            for (int k = 0; k < degree - q; ++k) term *= u;
            for (int k = 0; k < q; ++k) term *= v;
            out[at++] = term;
        }
    }
    return at;
}

// algo::radial_stretch, and its derivatives.
struct Stretch {
    double value = 0, by_r2 = 0, by_k1 = 0, by_k2 = 0;
};
Stretch stretch_of(algo::GridModelKind model, double k1, double k2, double r2) {
    Stretch out{.value = algo::radial_stretch(model, k1, k2, r2)};
    if (model == algo::GridModelKind::division1) {
        const double root = std::sqrt(std::max(0.0, 1 - 4 * k1 * r2));
        const double slope = root > 0 ? 4 / (root * (1 + root) * (1 + root)) : 0;  // by k1 r^2
        out.by_r2 = k1 * slope;
        out.by_k1 = r2 * slope;
    } else if (model == algo::GridModelKind::rational2) {
        const double low = 1 / (1 + k2 * r2);
        out.by_r2 = (k1 - k2) * low * low;
        out.by_k1 = r2 * low;
        out.by_k2 = -r2 * (1 + k1 * r2) * low * low;
    } else {
        out.by_r2 = k1 + 2 * k2 * r2;
        out.by_k1 = r2;
        out.by_k2 = r2 * r2;
    }
    return out;
}

}  // namespace

void derivatives(const algo::LensletGrid& grid, algo::LensletGrid::Uv where, double* of_x, double* of_y) {
    using algo::GridModelKind;
    const auto [u, v] = where;
    const double* p = grid.parameters.data();
    const int count = parameter_count(grid.model);
    std::fill(of_x, of_x + count, 0.0);
    std::fill(of_y, of_y + count, 0.0);
    if (grid.model == GridModelKind::cubic || grid.model == GridModelKind::quintic) {
        const int half = monomials(grid.model == GridModelKind::cubic ? 3 : 5, u, v, of_x);
        std::copy(of_x, of_x + half, of_y + half);
        return;
    }
    of_x[0] = 1;
    of_y[1] = 1;
    const algo::RadialTerms radial = algo::radial_terms(grid.model);
    const bool similar = grid.model == GridModelKind::similarity || grid.model == GridModelKind::similarity_radial1;
    double px, py;  // from the shift to the place before the distortion
    if (similar) {
        of_x[2] = of_y[3] = u;
        of_x[3] = -v;
        of_y[2] = v;
        px = p[2] * u - p[3] * v;
        py = p[3] * u + p[2] * v;
    } else {
        const bool perspective = grid.model != GridModelKind::affine;
        const double w = perspective ? 1.0 + p[6] * u + p[7] * v : 1.0;
        of_x[2] = of_y[4] = u / w;
        of_x[3] = of_y[5] = v / w;
        px = (p[2] * u + p[3] * v) / w;
        py = (p[4] * u + p[5] * v) / w;
        if (perspective) {
            of_x[6] = -u * px / w;
            of_x[7] = -v * px / w;
            of_y[6] = -u * py / w;
            of_y[7] = -v * py / w;
        }
    }
    if (radial.first < 0) return;
    const double radius = grid.radius_px;
    const double* k = p + radial.first;
    const double dx = (p[0] + px - grid.middle_x_px) / radius - (radial.second ? k[2] : 0.0);
    const double dy = (p[1] + py - grid.middle_y_px) / radius - (radial.second ? k[3] : 0.0);
    const double r2 = dx * dx + dy * dy;
    const Stretch of = stretch_of(grid.model, k[0], radial.second ? k[1] : 0.0, r2);
    const double slope = 2 * of.by_r2;  // its derivative by dx, over dx
    const double xx = 1 + of.value + dx * dx * slope;
    const double xy = dx * dy * slope;
    const double yy = 1 + of.value + dy * dy * slope;
    for (int column = 0; column < radial.first; ++column) {
        const double by_x = of_x[column];
        const double by_y = of_y[column];
        of_x[column] = xx * by_x + xy * by_y;
        of_y[column] = xy * by_x + yy * by_y;
    }
    double* const rest_x = of_x + radial.first;
    double* const rest_y = of_y + radial.first;
    rest_x[0] = dx * of.by_k1 * radius;
    rest_y[0] = dy * of.by_k1 * radius;
    if (!radial.second) return;
    rest_x[1] = dx * of.by_k2 * radius;
    rest_y[1] = dy * of.by_k2 * radius;
    rest_x[2] = -(of.value + dx * dx * slope) * radius;
    rest_x[3] = rest_y[2] = -xy * radius;
    rest_y[3] = -(of.value + dy * dy * slope) * radius;
}

std::optional<algo::LensletGrid> robust_polynomial(const algo::LensletGrid& frame, std::span<Observation> observations,
                                                   int order) {
    constexpr int kRounds = 12;
    constexpr std::size_t kMaxCentres = 4000;
    const int terms = (order + 1) * (order + 2) / 2;
    // A regular part of very many centres determines the surface as well; all of them are then judged by it.
    const std::size_t every = (observations.size() + kMaxCentres - 1) / kMaxCentres;
    const auto count =
        every == 0 ? Eigen::Index{0} : static_cast<Eigen::Index>((observations.size() + every - 1) / every);
    if (count < terms + 1) return std::nullopt;
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> basis(count, terms);
    Eigen::MatrixX2d target(count, 2);
    for (Eigen::Index k = 0; k < count; ++k) {
        const Observation& seen = observations[static_cast<std::size_t>(k) * every];
        const auto [u, v] = frame.uv(seen.m, seen.n);
        monomials(order, u, v, basis.row(k).data());
        target(k, 0) = seen.centre_px.x_px;
        target(k, 1) = seen.centre_px.y_px;
    }
    // Columns of equal size: the normal equations of a cubic are then well conditioned.
    const Eigen::RowVectorXd size = basis.colwise().norm().cwiseMax(1e-12);
    basis.array().rowwise() /= size.array();
    Eigen::VectorXd weight = Eigen::VectorXd::Ones(count);
    Eigen::MatrixXd solution;
    std::vector<double> distance(static_cast<std::size_t>(count));
    double sigma = 0;
    for (int round = 0; round < kRounds; ++round) {
        const Eigen::MatrixXd weighted = basis.array().colwise() * weight.array();
        Eigen::MatrixXd normal = basis.transpose() * weighted;
        // A small ridge term keeps directions that the centres do not determine at zero.
        normal.diagonal().array() += 1e-9;
        solution = normal.ldlt().solve(weighted.transpose() * target);
        if (!solution.allFinite()) return std::nullopt;
        const Eigen::MatrixX2d off = target - basis * solution;
        for (Eigen::Index k = 0; k < count; ++k) distance[static_cast<std::size_t>(k)] = off.row(k).norm();
        // The median of a Rayleigh-distributed distance is 1.1774 sigma.
        std::vector<double> reordered = distance;
        const double next = std::max(common::upper_median(std::span(reordered)) / 1.1774, 1e-6);
        // First Huber weights, then Tukey's biweight, which is 0 for outliers.
        const bool settled = round > 3 && std::abs(next - sigma) < 1e-3 * sigma;
        sigma = next;
        for (Eigen::Index k = 0; k < count; ++k) {
            const double far = distance[static_cast<std::size_t>(k)] / sigma;
            const double near = 1 - far * far / 36.0;
            weight(k) = round < 3 ? std::min(1.0, 1.5 / std::max(far, 1e-9)) : (near > 0 ? near * near : 0.0);
        }
        if (settled) break;
    }
    algo::LensletGrid grid = frame;
    grid.model = order == 1 ? algo::GridModelKind::affine : algo::GridModelKind::cubic;
    grid.parameters.assign(static_cast<std::size_t>(parameter_count(grid.model)), 0.0);
    const auto value = [&](int term, int axis) { return solution(term, axis) / size(term); };
    if (order == 1) {
        grid.parameters = {value(0, 0), value(0, 1), value(1, 0), value(2, 0), value(1, 1), value(2, 1)};
    } else {
        for (int axis = 0; axis < 2; ++axis) {
            for (int term = 0; term < terms; ++term)
                grid.parameters[static_cast<std::size_t>(axis * 10 + term)] = value(term, axis);
        }
    }
    for (Observation& seen : observations) {
        const algo::PixelPoint at = grid.centre_px(seen.m, seen.n);
        const double dx = at.x_px - seen.centre_px.x_px;
        const double dy = at.y_px - seen.centre_px.y_px;
        seen.used = std::sqrt(dx * dx + dy * dy) < 5 * sigma + 1e-3;
    }
    return grid;
}

}  // namespace hord::calib
