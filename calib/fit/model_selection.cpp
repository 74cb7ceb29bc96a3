#include "calib/fit/model_selection.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace hord::calib {
namespace {

using algo::GridModelKind;

constexpr double kNeededGain = 2.0;     // standard errors
constexpr double kMaxCornerLoss = 2.0;  // of the error of the worst corner: extrapolation has more noise
constexpr double kInfinite = std::numeric_limits<double>::infinity();

bool similar(GridModelKind model) {
    return model == GridModelKind::similarity || model == GridModelKind::similarity_radial1;
}

// A start for `model` from the fit of a simpler one.
algo::LensletGrid lift(const algo::LensletGrid& from, GridModelKind model) {
    algo::LensletGrid grid = from;
    const std::vector<double>& p = from.parameters;
    grid.model = model;
    if (similar(model)) {
        grid.parameters.resize(static_cast<std::size_t>(parameter_count(model)), 0.0);
        return grid;
    }
    std::vector<double> six(p.begin(), p.begin() + std::min<std::ptrdiff_t>(6, static_cast<std::ptrdiff_t>(p.size())));
    if (similar(from.model)) six = {p[0], p[1], p[2], -p[3], p[3], p[2]};
    if (model != GridModelKind::cubic && model != GridModelKind::quintic) {
        if (similar(from.model) || model == GridModelKind::affine) grid.parameters = six;
        grid.parameters.resize(static_cast<std::size_t>(parameter_count(model)), 0.0);
        if (model == GridModelKind::rational2 && from.model == GridModelKind::radial2) {
            // The rational model with the same terms of second and fourth order, unless its pole would be in the frame.
            const double k2 = p[8] != 0 ? -p[9] / p[8] : 0;
            const bool near = std::abs(k2) < 0.3;
            grid.parameters[8] = p[8] + (near ? k2 : 0);
            grid.parameters[9] = near ? k2 : 0;
        }
        return grid;
    }
    // Polynomials are linear in their parameters: the affine part is a sufficient start.
    const int half = parameter_count(model) / 2;
    grid.parameters.assign(static_cast<std::size_t>(2 * half), 0.0);
    for (int axis = 0; axis < 2; ++axis) {
        const auto first = static_cast<std::size_t>(axis * half);
        grid.parameters[first] = six[static_cast<std::size_t>(axis)];
        grid.parameters[first + 1] = six[static_cast<std::size_t>(axis == 0 ? 2 : 4)];
        grid.parameters[first + 2] = six[static_cast<std::size_t>(axis == 0 ? 3 : 5)];
    }
    return grid;
}

// The similarity nearest to the points: linear least squares in closed form.
algo::LensletGrid first_similarity(const algo::LensletGrid& frame, const std::vector<Point>& points) {
    double u = 0, v = 0, x = 0, y = 0;
    for (const Point& p : points) {
        u += p.uv.u;
        v += p.uv.v;
        x += p.seen.x_px;
        y += p.seen.y_px;
    }
    const auto n = static_cast<double>(points.size());
    u /= n, v /= n, x /= n, y /= n;
    double uu = 0, a = 0, b = 0;
    for (const Point& p : points) {
        const double du = p.uv.u - u, dv = p.uv.v - v, dx = p.seen.x_px - x, dy = p.seen.y_px - y;
        uu += du * du + dv * dv;
        a += du * dx + dv * dy;
        b += du * dy - dv * dx;
    }
    a /= std::max(uu, 1e-12), b /= std::max(uu, 1e-12);
    algo::LensletGrid grid = frame;
    grid.model = GridModelKind::similarity;
    grid.parameters = {x - a * u + b * v, y - b * u - a * v, a, b};
    return grid;
}

}  // namespace

ModelSelection select_model(const algo::LensletGrid& frame, std::vector<Point> sample,
                            std::span<const GridModelKind> models) {
    ModelSelection out;
    const Blocks blocks = sort_into_blocks(sample);
    out.blocks = blocks.count();
    algo::LensletGrid previous = first_similarity(frame, sample);
    std::optional<Validation> best;
    for (const GridModelKind model : models) {
        ModelReport& report = out.candidates.emplace_back();
        report.model = model;
        report.parameters = parameter_count(model);
        report.cv_x_rms_px = report.cv_y_rms_px = kInfinite;
        if (2 * sample.size() < static_cast<std::size_t>(report.parameters) + 2) {
            report.verdict = "not tried: too few lenslets";
            continue;
        }
        auto solved = solve(lift(previous, model), sample);
        if (!solved) {
            report.verdict = "not taken: the fit did not settle";
            continue;
        }
        if (model < GridModelKind::cubic) previous = solved->grid;
        const Validation validation = leave_blocks_out(*solved, blocks);
        report.rms_px = std::sqrt(solved->residuals.squaredNorm() / static_cast<double>(solved->residuals.size()));
        report.cv_x_rms_px = validation.x_rms;
        report.cv_y_rms_px = validation.y_rms;
        const bool first = !best;
        report.gain_t = first ? 0 : gain_of(*best, validation);
        for (const double corner : validation.corners_rms) report.corner_px = std::max(report.corner_px, corner);
        const bool better = first || report.gain_t > kNeededGain;
        const double worst_held = first ? kInfinite : out.candidates[out.choice->index].corner_px;
        const bool take = better && (report.corner_px == 0 || report.corner_px <= kMaxCornerLoss * worst_held);
        if (first) report.verdict = "the simplest";
        else if (take)
            report.verdict =
                fmt::format("needed: predicts unseen blocks better by {:.1f} standard errors", report.gain_t);
        else if (better)
            report.verdict = fmt::format(
                "not taken: predicts blocks better by {:.1f} standard errors, but the worst corner, left out "
                "whole, to {:.4f} px only instead of {:.4f}",
                report.gain_t, report.corner_px, worst_held);
        else
            report.verdict =
                fmt::format("not needed: predicts unseen blocks better by {:.1f} standard errors, less than {:.0f}",
                            report.gain_t, kNeededGain);
        if (take) {
            out.choice = ChosenModel{solved->grid, out.candidates.size() - 1};
            best = validation;
        }
    }
    if (out.choice) out.candidates[out.choice->index].chosen = true;
    return out;
}

}  // namespace hord::calib
