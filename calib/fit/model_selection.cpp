#include "calib/fit/model_selection.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace hord::calib {
namespace {

using algo::GridModelKind;

constexpr double kNeededGain = 2.0;  // standard errors
constexpr double kInfinite = std::numeric_limits<double>::infinity();

// A start for `model` from the fit of a simpler one.
algo::LensletGrid lift(const algo::LensletGrid& from, GridModelKind model) {
    algo::LensletGrid grid = from;
    const std::vector<double>& p = from.parameters;
    grid.model = model;
    if (model == GridModelKind::similarity) return grid;
    std::vector<double> six(p.begin(), p.begin() + std::min<std::ptrdiff_t>(6, static_cast<std::ptrdiff_t>(p.size())));
    if (from.model == GridModelKind::similarity) six = {p[0], p[1], p[2], -p[3], p[3], p[2]};
    if (model != GridModelKind::cubic && model != GridModelKind::quintic) {
        if (from.model == GridModelKind::similarity) grid.parameters = six;
        grid.parameters.resize(static_cast<std::size_t>(parameter_count(model)), 0.0);
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
        const bool take = first || report.gain_t > kNeededGain;
        if (first) report.verdict = "the simplest";
        else if (take)
            report.verdict =
                fmt::format("needed: predicts unseen blocks better by {:.1f} standard errors", report.gain_t);
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
