#include "calib/fit/grid_fit.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "calib/fit/cross_validation.h"
#include "calib/fit/grid_solver.h"
#include "calib/fit/lenslet_model.h"
#include "calib/fit/model_selection.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr std::size_t kSelectionCentres = 4000;  // for the selection of the model
constexpr std::size_t kFitCentres = 12000;       // for the fit of the selected model: more add no useful accuracy
constexpr double kFarthest = 1e6;                // px
constexpr int kMaxRounds = 3;                    // of the selection
constexpr double kMoreCentres = 1.01;            // centres for another round, over those of the last

std::vector<Point> points_of(const algo::LensletGrid& frame, std::span<const Observation> observations) {
    std::vector<Point> points;
    points.reserve(observations.size());
    for (const Observation& seen : observations) {
        if (seen.used) points.push_back({frame.uv(seen.m, seen.n), seen.centre_px});
    }
    return points;
}

// At most `most` of the points, spread evenly over them.
std::vector<Point> part_of(const std::vector<Point>& points, std::size_t most) {
    std::vector<Point> part;
    const std::size_t every = (points.size() + most - 1) / most;
    for (std::size_t k = 0; k < points.size(); k += every) part.push_back(points[k]);
    return part;
}

// Keeps the centres within five robust standard deviations of `grid`.
void reject_by(const algo::LensletGrid& grid, std::span<Observation> observations) {
    std::vector<double> distance;
    distance.reserve(observations.size());
    for (const Observation& seen : observations) {
        const algo::PixelPoint at = grid.centre_px(seen.m, seen.n);
        const double dx = at.x_px - seen.centre_px.x_px, dy = at.y_px - seen.centre_px.y_px;
        distance.push_back(std::sqrt(dx * dx + dy * dy));
    }
    std::vector<double> sorted;
    for (std::size_t k = 0; k < distance.size(); ++k) {
        if (observations[k].used) sorted.push_back(distance[k]);
    }
    if (sorted.empty() || !std::all_of(sorted.begin(), sorted.end(), [](double d) { return std::isfinite(d); })) return;
    // The median of a Rayleigh-distributed distance is 1.1774 sigma.
    const double most = 5 * common::upper_median(std::span(sorted)) / 1.1774 + 1e-3;
    for (std::size_t k = 0; k < distance.size(); ++k) observations[k].used = distance[k] < most;
}

// Fits the selected model to up to kFitCentres centres: parameters, their standard errors, unobservable ones.
Result<void> finish(const algo::LensletGrid& start, std::vector<Point> points, GridFit& fit) {
    const Blocks blocks = sort_into_blocks(points);
    auto solved = solve(start, points);
    if (!solved)
        return fail(ErrorCode::refused, "the chosen grid model does not settle on all centres",
                    "record the white frame again");
    fit.grid = solved->grid;
    fit.unobservable = solved->unobservable;
    const double variance = variance_of(*solved);
    const Eigen::MatrixXd inverse = inverse_normal(normal_of(*solved), solved->fixed);
    fit.noise_px = std::sqrt(variance);
    fit.correlation_inflation = inflation_of(*solved, blocks, inverse, variance);
    const auto count = static_cast<Eigen::Index>(fit.grid.parameters.size());
    fit.sigma.assign(static_cast<std::size_t>(count), 0.0);
    if (inverse.size() == 0) return {};
    for (Eigen::Index r = 0; r < count; ++r)
        fit.sigma[static_cast<std::size_t>(r)] =
            std::sqrt(std::max(0.0, inverse(r, r) * variance * fit.correlation_inflation));
    return {};
}

// Statistics of the residuals of all used centres.
void count_residuals(const std::vector<Point>& points, GridFit& fit) {
    double x = 0, y = 0, farthest = 0;
    for (const Point& point : points) {
        const algo::PixelPoint at = fit.grid.at(point.uv);
        const double dx = at.x_px - point.seen.x_px;
        const double dy = at.y_px - point.seen.y_px;
        x += dx * dx;
        y += dy * dy;
        if (dx * dx + dy * dy <= farthest) continue;
        farthest = dx * dx + dy * dy;
        fit.max_px = std::hypot(dx, dy);
    }
    fit.used = static_cast<int>(points.size());
    fit.rms_x_px = std::sqrt(x / static_cast<double>(points.size()));
    fit.rms_y_px = std::sqrt(y / static_cast<double>(points.size()));
}

}  // namespace

Result<GridFit> fit_grid(const algo::LensletGrid& frame, std::span<Observation> observations,
                         std::span<const algo::GridModelKind> models) {
    for (const Observation& seen : observations) {
        if (!(std::abs(seen.centre_px.x_px) < kFarthest) || !(std::abs(seen.centre_px.y_px) < kFarthest)) {
            return fail(ErrorCode::invalid_argument,
                        fmt::format("the centre of lenslet {},{} is no place on a sensor", seen.m, seen.n),
                        "give centres in pixels");
        }
    }
    if (observations.size() < 4) {
        return fail(ErrorCode::invalid_argument, fmt::format("{} lenslet centres", observations.size()),
                    "give at least 4 of them");
    }
    // Outliers are found with a smooth surface, independently of the selected model.
    const int order = observations.size() >= 60 ? 3 : observations.size() >= 20 ? 2 : 1;
    if (!robust_polynomial(frame, observations, order)) robust_polynomial(frame, observations, 1);
    std::vector<Point> points = points_of(frame, observations);
    if (points.size() < 4)
        return fail(ErrorCode::refused, "fewer than 4 lenslet centres agree with one another",
                    "record the white frame again");

    GridFit fit;
    std::optional<ChosenModel> choice;
    for (int round = 0; round < kMaxRounds; ++round) {
        ModelSelection selection = select_model(frame, part_of(points, kSelectionCentres), models);
        fit.candidates = std::move(selection.candidates);
        fit.blocks = selection.blocks;
        choice = std::move(selection.choice);
        if (!choice)
            return fail(ErrorCode::refused, "no grid model fits the lenslet centres", "record the white frame again");
        // The smooth surface is not exact: outliers are found again with the selected model. If that brings many back,
        // such as whole corners under strong distortion, they have their say in the selection.
        const std::size_t before = points.size();
        reject_by(choice->grid, observations);
        points = points_of(frame, observations);
        if (static_cast<double>(points.size()) < kMoreCentres * static_cast<double>(before)) break;
    }
    if (points.size() < 4)
        return fail(ErrorCode::refused, "fewer than 4 lenslet centres agree with the model",
                    "record the white frame again");
    if (auto done = finish(choice->grid, part_of(points, kFitCentres), fit); !done) return tl::unexpected(done.error());
    count_residuals(points, fit);
    fit.rejected = static_cast<int>(observations.size() - points.size());
    const ModelReport winner = fit.candidates[choice->index];
    fit.cv_x_rms_px = winner.cv_x_rms_px;
    fit.cv_y_rms_px = winner.cv_y_rms_px;
    fit.corner_px = winner.corner_px;
    fit.reason = fmt::format("{}: {}; cross-validated over {} blocks {:.4f} px in x, {:.4f} px in y",
                             name_of(winner.model), winner.verdict, fit.blocks, fit.cv_x_rms_px, fit.cv_y_rms_px);
    select_lenslet_shifts(observations, fit);
    return fit;
}

std::string_view name_of(const ModelReport& report) {
    return report.single_lenslets ? "single lenslets" : name_of(report.model);
}

}  // namespace hord::calib
