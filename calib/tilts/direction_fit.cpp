// Fits the direction map to captures at known tilts.
#include <algorithm>
#include <array>
#include <cmath>

#include <Eigen/Dense>
#include <fmt/format.h>

#include "calib/fit/model_selection.h"
#include "calib/tilts/tilts.h"

namespace hord::calib {
namespace {

using algo::GridModelKind;

constexpr std::array kModels{GridModelKind::similarity, GridModelKind::affine, GridModelKind::homography,
                             GridModelKind::radial1, GridModelKind::cubic};
constexpr std::size_t kMinTilts = 3;  // besides the empty field
constexpr std::size_t kMinForCubic = 10;
constexpr double kCaptureError = 0.02;  // px, of a capture
constexpr double kEdgeError =
    0.1;  // px: largest error of the map at the lenslet's edge; drift is detected from there on
constexpr double kMinTilt = 1e-9;  // rad

struct Plane {
    Eigen::Matrix2d map;  // px a rad
    Eigen::Vector2d zero;
};

Plane plane_through(const std::vector<Point>& points) {
    Eigen::MatrixX3d basis(static_cast<Eigen::Index>(points.size()), 3);
    Eigen::MatrixX2d seen(basis.rows(), 2);
    for (Eigen::Index k = 0; k < basis.rows(); ++k) {
        const Point& p = points[static_cast<std::size_t>(k)];
        basis.row(k) << 1, p.uv.u, p.uv.v;
        seen.row(k) << p.seen.x_px, p.seen.y_px;
    }
    const Eigen::Matrix<double, 3, 2> solution = basis.colPivHouseholderQr().solve(seen);
    return {solution.bottomRows(2).transpose(), solution.row(0).transpose()};
}

// The spread of the tilts across the line nearest to them, root of the sum of squares, px: it limits the accuracy of
// the map in that direction.
double thin_spread_px(const std::vector<Point>& points) {
    Eigen::MatrixX2d of(static_cast<Eigen::Index>(points.size()), 2);
    Eigen::MatrixX2d seen(of.rows(), 2);
    for (Eigen::Index k = 0; k < of.rows(); ++k) {
        const Point& p = points[static_cast<std::size_t>(k)];
        of.row(k) << p.uv.u, p.uv.v;
        seen.row(k) << p.seen.x_px, p.seen.y_px;
    }
    of.rowwise() -= of.colwise().mean().eval();
    seen.rowwise() -= seen.colwise().mean().eval();
    const Eigen::JacobiSVD<Eigen::MatrixXd> tilts(of);
    const Eigen::JacobiSVD<Eigen::MatrixXd> places(seen);
    const double scale = tilts.singularValues()(0) > 0 ? places.singularValues()(0) / tilts.singularValues()(0) : 0;
    return tilts.singularValues()(1) * scale;
}

}  // namespace

Result<DirectionFit> fit_directions(const SpotPlace& empty, std::span<const Tilt> tilts, double pitch_px) {
    const auto refuse = [](std::string what, std::string cure) {
        return fail(ErrorCode::refused, std::move(what), std::move(cure));
    };
    if (tilts.size() < kMinTilts) {
        return refuse(
            fmt::format("{} tilts: fewer than {} do not determine a direction map", tilts.size(), kMinTilts),
            "capture at least three directions that do not lie on one line; ten, all over the lenslet, for its "
            "distortion");
    }
    std::vector<Point> points{{{0, 0}, empty.offset_px}};
    double span = kMinTilt;
    for (const Tilt& tilt : tilts) {
        points.push_back({{tilt.direction.x_rad, tilt.direction.y_rad}, tilt.spot.offset_px});
        span = std::max({span, std::abs(tilt.direction.x_rad), std::abs(tilt.direction.y_rad)});
    }
    const double needed = 0.5 * pitch_px * kCaptureError / kEdgeError;
    const double thin = thin_spread_px(points);
    if (!(thin > needed)) {
        return refuse(fmt::format("the {} tilts lie nearly on one line: across it their spots spread over {:.2f} px "
                                  "(root of the sum of squares), {:.2f} px are needed",
                                  tilts.size(), thin, needed),
                      "capture directions on both sides of that line");
    }

    // Directions along the sensor's axes make the linear part symmetric; polar decomposition gives the stage's
    // rotation.
    const Plane plane = plane_through(points);
    const Eigen::JacobiSVD<Eigen::Matrix2d> svd(plane.map, Eigen::ComputeFullU | Eigen::ComputeFullV);
    if (!(svd.singularValues()(1) > 0))
        return refuse("the spots do not move with the tilts", "check the angles in tilts.toml");
    const Eigen::Matrix2d turn = svd.matrixU() * svd.matrixV().transpose();
    DirectionFit fit;
    fit.mirrored = turn.determinant() < 0;
    fit.stage_rotation_rad = std::atan2(turn(1, 0), turn(0, 0));
    for (Point& p : points) {
        const Eigen::Vector2d turned = turn * Eigen::Vector2d(p.uv.u, p.uv.v) / span;
        p.uv = {turned(0), turned(1)};
    }

    algo::LensletGrid frame;
    frame.middle_x_px = empty.offset_px.x_px;  // distortion is about undeflected light
    frame.middle_y_px = empty.offset_px.y_px;
    frame.radius_px = 0.5 * pitch_px;
    const auto models = std::span(kModels).first(tilts.size() >= kMinForCubic ? kModels.size() : kModels.size() - 1);
    ModelSelection selection = select_model(frame, points, models);
    if (!selection.choice) return refuse("no direction map fits the tilts", "check the angles in tilts.toml");
    fit.candidates = std::move(selection.candidates);
    const ModelReport& winner = fit.candidates[selection.choice->index];
    const auto solved = solve(selection.choice->grid, points);
    if (!solved) return refuse("the direction map does not settle", "check the angles in tilts.toml");
    fit.left_out_x_px = winner.cv_x_rms_px;
    fit.left_out_y_px = winner.cv_y_rms_px;
    if (!(std::max(fit.left_out_x_px, fit.left_out_y_px) < kEdgeError)) {
        return refuse(fmt::format("the spots follow no map: a capture left out is predicted to {:.3f} / {:.3f} px (x / "
                                  "y), {:.1f} is the most",
                                  fit.left_out_x_px, fit.left_out_y_px, kEdgeError),
                      "check the angles in tilts.toml, and that each frame belongs to its angle");
    }
    fit.captures = static_cast<int>(points.size());
    fit.unobservable = solved->unobservable;
    fit.map = {solved->grid.model, solved->grid.parameters, span, frame.radius_px, empty.offset_px};
    fit.reason = fmt::format("{}: {}; a capture left out is predicted to {:.4f} px in x, {:.4f} px in y",
                             name_of(winner.model), winner.verdict, fit.left_out_x_px, fit.left_out_y_px);

    const double variance = variance_of(*solved);
    fit.noise_px = std::sqrt(variance);
    const Eigen::MatrixXd inverse = inverse_normal(normal_of(*solved), solved->fixed);
    fit.sigma.assign(solved->grid.parameters.size(), 0.0);
    for (Eigen::Index k = 0; k < inverse.rows(); ++k)
        fit.sigma[static_cast<std::size_t>(k)] = std::sqrt(std::max(0.0, inverse(k, k) * variance));
    fit.scale_px_a_rad = fit.map.px_a_rad({}).mean_px();
    // Scale and rotation are the symmetric and antisymmetric parts of four equally well known numbers.
    double moment = 0;
    for (const Point& p : points) moment += (p.uv.u * p.uv.u + p.uv.v * p.uv.v) * span * span;
    fit.scale_sigma = fit.noise_px / std::sqrt(moment);
    fit.stage_rotation_sigma = fit.scale_sigma / fit.scale_px_a_rad;
    return fit;
}

}  // namespace hord::calib
