#include "calib/grid_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <Eigen/Dense>
#include <ceres/ceres.h>
#include <fmt/format.h>

namespace hord::calib {
namespace {

using algo::GridRung;
using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::size_t kLadderCentres = 6000;  // enough to choose by
constexpr std::size_t kFitCentres = 24000;    // that the chosen rung is fitted to: more add time and no accuracy that counts
constexpr double kSingular = 1e-9;            // of the eigenvalues of the normalised normal equations, against 1
constexpr double kNeededGain = 2.0;           // standard errors
constexpr double kFarthest = 1e6;             // px
constexpr double kInfinite = std::numeric_limits<double>::infinity();

struct Point {
    algo::LensletGrid::Uv uv;
    algo::PixelPoint seen;
};

// All residuals of a grid in one block, with their analytic derivatives.
class GridCost final : public ceres::CostFunction {
  public:
    GridCost(const algo::LensletGrid& frame, const std::vector<Point>& points) : grid_(frame), points_(points) {
        set_num_residuals(static_cast<int>(2 * points.size()));
        mutable_parameter_block_sizes()->push_back(parameter_count(frame.rung));
    }
    bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override {
        algo::LensletGrid grid = grid_;
        const auto count = static_cast<std::size_t>(parameter_count(grid.rung));
        grid.parameters.assign(parameters[0], parameters[0] + count);
        double* jacobian = jacobians != nullptr ? jacobians[0] : nullptr;
        for (std::size_t k = 0; k < points_.size(); ++k) {
            const algo::PixelPoint at = grid.at(points_[k].uv);
            residuals[2 * k] = at.x_px - points_[k].seen.x_px;
            residuals[2 * k + 1] = at.y_px - points_[k].seen.y_px;
            if (!std::isfinite(residuals[2 * k]) || !std::isfinite(residuals[2 * k + 1])) return false;
            if (jacobian != nullptr) {
                derivatives(grid, points_[k].uv, jacobian + 2 * k * count, jacobian + (2 * k + 1) * count);
            }
        }
        return true;
    }

  private:
    const algo::LensletGrid& grid_;
    const std::vector<Point>& points_;
};

struct Solved {
    algo::LensletGrid grid;
    std::vector<bool> fixed;
    std::vector<Unobservable> unobservable;
    Eigen::VectorXd residuals;  // x, y, x, y ...
    RowMatrix jacobian;
};

void evaluate(Solved& solved, const std::vector<Point>& points) {
    const auto count = static_cast<Eigen::Index>(parameter_count(solved.grid.rung));
    solved.residuals.resize(static_cast<Eigen::Index>(2 * points.size()));
    solved.jacobian.resize(solved.residuals.size(), count);
    const GridCost cost(solved.grid, points);
    const double* parameters = solved.grid.parameters.data();
    double* jacobian = solved.jacobian.data();
    cost.Evaluate(&parameters, solved.residuals.data(), &jacobian);
    for (Eigen::Index k = 0; k < count; ++k) {
        if (solved.fixed[static_cast<std::size_t>(k)]) solved.jacobian.col(k).setZero();
    }
}

Eigen::MatrixXd normal_of(const Solved& solved) {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(solved.jacobian.cols(), solved.jacobian.cols());
    normal.selfadjointView<Eigen::Lower>().rankUpdate(solved.jacobian.transpose());
    normal.triangularView<Eigen::StrictlyUpper>() = normal.transpose();
    return normal;
}

// Fixes the parameters that the centres do not determine, one a null direction; true where it fixed any.
bool fix_null_directions(Solved& solved) {
    bool any = false;
    const Eigen::MatrixXd normal = normal_of(solved);
    for (;;) {
        const Eigen::Index count = solved.jacobian.cols();
        std::vector<Eigen::Index> free;
        bool again = false;
        const Eigen::VectorXd size = normal.diagonal().cwiseMax(0.0).cwiseSqrt();
        const double largest = size.maxCoeff();
        for (Eigen::Index k = 0; k < count; ++k) {
            if (solved.fixed[static_cast<std::size_t>(k)]) continue;
            if (size(k) > 1e-9 * largest) {
                free.push_back(k);
                continue;
            }
            solved.fixed[static_cast<std::size_t>(k)] = any = true;
            solved.unobservable.push_back({parameter_name(solved.grid.rung, static_cast<int>(k)), "no centre depends on it"});
        }
        const auto n = static_cast<Eigen::Index>(free.size());
        if (n == 0) return any;
        Eigen::MatrixXd scaled(n, n);
        for (Eigen::Index r = 0; r < n; ++r) {
            for (Eigen::Index c = 0; c < n; ++c) {
                const Eigen::Index from_r = free[static_cast<std::size_t>(r)];
                const Eigen::Index from_c = free[static_cast<std::size_t>(c)];
                scaled(r, c) = normal(from_r, from_c) / (size(from_r) * size(from_c));
            }
        }
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
        if (eigen.eigenvalues()(0) < kSingular) {
            // The parameter with the largest share in the null direction; the later, more special one on a tie.
            const Eigen::VectorXd null = eigen.eigenvectors().col(0).cwiseAbs();
            Eigen::Index worst = n - 1;
            for (Eigen::Index k = n - 1; k >= 0; --k) {
                if (null(k) > 1.05 * null(worst)) worst = k;
            }
            const Eigen::Index k = free[static_cast<std::size_t>(worst)];
            solved.fixed[static_cast<std::size_t>(k)] = any = again = true;
            solved.jacobian.col(k).setZero();
            solved.unobservable.push_back({parameter_name(solved.grid.rung, static_cast<int>(k)), "the others can stand in for it"});
        }
        if (!again) return any;
    }
}

// One run of Ceres with the free parameters. The scale of every step is Ceres' own (Jacobi).
bool run(Solved& solved, const std::vector<Point>& points) {
    std::vector<double>& parameters = solved.grid.parameters;
    ceres::Problem::Options ownership;
    ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(ownership);
    const algo::LensletGrid frame = solved.grid;
    GridCost cost(frame, points);
    problem.AddResidualBlock(&cost, nullptr, parameters.data());
    std::vector<int> held;
    for (std::size_t k = 0; k < solved.fixed.size(); ++k) {
        if (solved.fixed[k]) held.push_back(static_cast<int>(k));
    }
    if (held.size() == solved.fixed.size()) return true;
    if (!held.empty()) problem.SetManifold(parameters.data(), new ceres::SubsetManifold(static_cast<int>(parameters.size()), held));
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = 30;
    options.function_tolerance = 1e-12;
    options.gradient_tolerance = 1e-14;
    options.parameter_tolerance = 1e-12;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return summary.IsSolutionUsable() && std::all_of(parameters.begin(), parameters.end(), [](double p) { return std::isfinite(p); });
}

// (J^T J)^-1 of the free parameters, 0 elsewhere; empty where it cannot be inverted.
Eigen::MatrixXd inverse_normal(const Eigen::MatrixXd& normal, const std::vector<bool>& fixed) {
    std::vector<Eigen::Index> free;
    for (std::size_t k = 0; k < fixed.size(); ++k) {
        if (!fixed[k]) free.push_back(static_cast<Eigen::Index>(k));
    }
    const auto n = static_cast<Eigen::Index>(free.size());
    Eigen::MatrixXd part(n, n);
    Eigen::VectorXd scale(n);
    for (Eigen::Index r = 0; r < n; ++r) {
        const double diagonal = normal(free[static_cast<std::size_t>(r)], free[static_cast<std::size_t>(r)]);
        if (!(diagonal > 0)) return {};
        scale(r) = 1 / std::sqrt(diagonal);
    }
    for (Eigen::Index r = 0; r < n; ++r) {
        for (Eigen::Index c = 0; c < n; ++c) part(r, c) = normal(free[static_cast<std::size_t>(r)], free[static_cast<std::size_t>(c)]) * scale(r) * scale(c);
    }
    const Eigen::LDLT<Eigen::MatrixXd> factor(part);
    if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 1e-12)) return {};
    const Eigen::MatrixXd inverse = factor.solve(Eigen::MatrixXd::Identity(n, n));
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(normal.rows(), normal.cols());
    for (Eigen::Index r = 0; r < n; ++r) {
        for (Eigen::Index c = 0; c < n; ++c) {
            out(free[static_cast<std::size_t>(r)], free[static_cast<std::size_t>(c)]) = inverse(r, c) * scale(r) * scale(c);
        }
    }
    return out;
}

double variance_of(const Solved& solved) {
    const auto free = std::count(solved.fixed.begin(), solved.fixed.end(), false);
    const auto degrees = static_cast<double>(solved.residuals.size() - free);
    return degrees > 0 ? solved.residuals.squaredNorm() / degrees : 0;
}

// Fits one rung. The centre of distortion is held while k1 is not known to three of its standard errors.
std::optional<Solved> solve(algo::LensletGrid start, const std::vector<Point>& points) {
    Solved solved;
    solved.grid = std::move(start);
    solved.fixed.assign(solved.grid.parameters.size(), false);
    const bool full = solved.grid.rung == GridRung::radial2;
    const bool know_centre = full && (solved.grid.parameters[10] != 0 || solved.grid.parameters[11] != 0);
    if (full && !know_centre) solved.fixed[10] = solved.fixed[11] = true;
    evaluate(solved, points);
    if (!solved.residuals.allFinite() || !solved.jacobian.allFinite()) return std::nullopt;
    fix_null_directions(solved);
    if (!run(solved, points)) return std::nullopt;
    evaluate(solved, points);
    if (full && !know_centre) {
        const Eigen::MatrixXd inverse = inverse_normal(normal_of(solved), solved.fixed);
        const double k1 = std::abs(solved.grid.parameters[8]);
        if (inverse.size() > 0 && k1 > 3 * std::sqrt(inverse(8, 8) * variance_of(solved))) {
            solved.fixed[10] = solved.fixed[11] = false;
            if (!run(solved, points)) return std::nullopt;
            evaluate(solved, points);
        } else {
            for (const char* name : {"cx", "cy"}) solved.unobservable.push_back({name, "k1 is not significant; held at the middle of the frame"});
        }
    }
    if (fix_null_directions(solved)) {
        if (!run(solved, points)) return std::nullopt;
        evaluate(solved, points);
    }
    return solved;
}

// Blocks of neighbouring lenslets, numbered from 0.
struct Blocks {
    std::vector<int> of;  // one a point
    int count = 0;
};

Blocks blocks_of(const std::vector<Point>& points) {
    double low_u = kInfinite, high_u = -kInfinite, low_v = kInfinite, high_v = -kInfinite;
    for (const Point& p : points) {
        low_u = std::min(low_u, p.uv.u);
        high_u = std::max(high_u, p.uv.u);
        low_v = std::min(low_v, p.uv.v);
        high_v = std::max(high_v, p.uv.v);
    }
    Blocks blocks;
    blocks.of.resize(points.size());
    const int side = std::clamp(static_cast<int>(std::sqrt(static_cast<double>(points.size()) / 12.0)), 1, 8);
    if (side < 3) {  // too few for blocks: every lenslet is its own
        for (std::size_t k = 0; k < points.size(); ++k) blocks.of[k] = static_cast<int>(k);
        blocks.count = static_cast<int>(points.size());
        return blocks;
    }
    std::map<int, int> numbers;
    for (std::size_t k = 0; k < points.size(); ++k) {
        const auto place = [side](double x, double low, double high) {
            return std::min(side - 1, static_cast<int>(side * (x - low) / std::max(high - low, 1e-12)));
        };
        const int cell = place(points[k].uv.v, low_v, high_v) * side + place(points[k].uv.u, low_u, high_u);
        blocks.of[k] = numbers.try_emplace(cell, static_cast<int>(numbers.size())).first->second;
    }
    blocks.count = static_cast<int>(numbers.size());
    return blocks;
}

struct Validation {
    std::vector<double> squared;  // error a block
    double x_rms = kInfinite, y_rms = kInfinite;
};

// What each block's error would be had the block not been fitted: one Newton step from the full fit with the block's
// own part of the normal equations taken away (exact for models linear in their parameters).
Validation leave_blocks_out(const Solved& solved, const Blocks& blocks) {
    const Eigen::Index count = solved.jacobian.cols();
    std::vector<Eigen::MatrixXd> normal(static_cast<std::size_t>(blocks.count), Eigen::MatrixXd::Zero(count, count));
    std::vector<Eigen::VectorXd> gradient(static_cast<std::size_t>(blocks.count), Eigen::VectorXd::Zero(count));
    for (std::size_t k = 0; k < blocks.of.size(); ++k) {
        const auto b = static_cast<std::size_t>(blocks.of[k]);
        const auto rows = solved.jacobian.middleRows(static_cast<Eigen::Index>(2 * k), 2);
        normal[b].selfadjointView<Eigen::Lower>().rankUpdate(rows.transpose());
        gradient[b] += rows.transpose() * solved.residuals.segment(static_cast<Eigen::Index>(2 * k), 2);
    }
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(count, count);
    Eigen::VectorXd pull = Eigen::VectorXd::Zero(count);
    for (std::size_t b = 0; b < normal.size(); ++b) {
        normal[b].triangularView<Eigen::StrictlyUpper>() = normal[b].transpose();
        all += normal[b];
        pull += gradient[b];
    }
    std::vector<Eigen::VectorXd> change(normal.size());
    for (std::size_t b = 0; b < normal.size(); ++b) {
        const Eigen::MatrixXd inverse = inverse_normal(all - normal[b], solved.fixed);
        if (inverse.size() == 0) return {};
        change[b] = -inverse * (pull - gradient[b]);
    }
    Validation validation;
    validation.squared.resize(normal.size());
    double x = 0;
    double y = 0;
    for (std::size_t k = 0; k < blocks.of.size(); ++k) {
        const auto b = static_cast<std::size_t>(blocks.of[k]);
        const auto row = static_cast<Eigen::Index>(2 * k);
        const double ex = solved.residuals(row) + solved.jacobian.row(row).dot(change[b]);
        const double ey = solved.residuals(row + 1) + solved.jacobian.row(row + 1).dot(change[b]);
        x += ex * ex;
        y += ey * ey;
        validation.squared[b] += ex * ex + ey * ey;
    }
    validation.x_rms = std::sqrt(x / static_cast<double>(blocks.of.size()));
    validation.y_rms = std::sqrt(y / static_cast<double>(blocks.of.size()));
    return validation;
}

// The improvement of `next` over `held`, in standard errors of its sum over the blocks.
double gain_of(const Validation& held, const Validation& next) {
    const std::size_t count = held.squared.size();
    if (next.squared.size() != count) return -kInfinite;
    double sum = 0;
    for (std::size_t b = 0; b < count; ++b) sum += held.squared[b] - next.squared[b];
    const double mean = sum / static_cast<double>(count);
    double spread = 0;
    for (std::size_t b = 0; b < count; ++b) spread += std::pow(held.squared[b] - next.squared[b] - mean, 2);
    const double error = std::sqrt(spread * static_cast<double>(count) / std::max(1.0, static_cast<double>(count) - 1));
    return error > 0 ? sum / error : (sum > 0 ? kInfinite : 0);
}

// A start for `rung` from the fit of a lower one.
algo::LensletGrid lift(const algo::LensletGrid& from, GridRung rung) {
    algo::LensletGrid grid = from;
    const std::vector<double>& p = from.parameters;
    grid.rung = rung;
    if (rung == GridRung::similarity) return grid;
    std::vector<double> six(p.begin(), p.begin() + std::min<std::ptrdiff_t>(6, static_cast<std::ptrdiff_t>(p.size())));
    if (from.rung == GridRung::similarity) six = {p[0], p[1], p[2], -p[3], p[3], p[2]};
    if (rung != GridRung::cubic && rung != GridRung::quintic) {
        if (from.rung == GridRung::similarity) grid.parameters = six;
        grid.parameters.resize(static_cast<std::size_t>(parameter_count(rung)), 0.0);
        return grid;
    }
    // Polynomials are linear: any start will do, so the affine part is enough.
    const int half = parameter_count(rung) / 2;
    grid.parameters.assign(static_cast<std::size_t>(2 * half), 0.0);
    for (int axis = 0; axis < 2; ++axis) {
        const auto first = static_cast<std::size_t>(axis * half);
        grid.parameters[first] = six[static_cast<std::size_t>(axis)];
        grid.parameters[first + 1] = six[static_cast<std::size_t>(axis == 0 ? 2 : 4)];
        grid.parameters[first + 2] = six[static_cast<std::size_t>(axis == 0 ? 3 : 5)];
    }
    return grid;
}

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
        distance.push_back(std::hypot(at.x_px - seen.centre_px.x_px, at.y_px - seen.centre_px.y_px));
    }
    std::vector<double> sorted;
    for (std::size_t k = 0; k < distance.size(); ++k) {
        if (observations[k].used) sorted.push_back(distance[k]);
    }
    if (sorted.empty() || !std::all_of(sorted.begin(), sorted.end(), [](double d) { return std::isfinite(d); })) return;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    // The median of a Rayleigh-distributed distance is 1.1774 sigma.
    const double most = 5 * *middle / 1.1774 + 1e-3;
    for (std::size_t k = 0; k < distance.size(); ++k) observations[k].used = distance[k] < most;
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
    grid.rung = GridRung::similarity;
    grid.parameters = {x - a * u + b * v, y - b * u - a * v, a, b};
    return grid;
}

// How much more the fit may be wrong than independent residuals would make it: the spread of the blocks' pulls on the
// parameters against what it would be. Below 1.5 it is chance.
double inflation_of(const Solved& solved, const Blocks& blocks, const Eigen::MatrixXd& inverse, double variance) {
    const Eigen::Index count = solved.jacobian.cols();
    if (blocks.count < 9 || inverse.size() == 0 || !(variance > 0)) return 1;
    Eigen::MatrixXd pull = Eigen::MatrixXd::Zero(count, blocks.count);
    for (std::size_t k = 0; k < blocks.of.size(); ++k) {
        const auto row = static_cast<Eigen::Index>(2 * k);
        pull.col(blocks.of[k]) += solved.residuals(row) * solved.jacobian.row(row).transpose();
        pull.col(blocks.of[k]) += solved.residuals(row + 1) * solved.jacobian.row(row + 1).transpose();
    }
    const auto free = static_cast<double>(std::count(solved.fixed.begin(), solved.fixed.end(), false));
    const double spread = (pull.transpose() * inverse * pull).trace() / (variance * free);
    return spread > 1.5 ? spread : 1;
}

}  // namespace

Result<GridFit> fit_grid(const algo::LensletGrid& frame, std::span<Observation> observations, const FitOptions& options) {
    for (const Observation& seen : observations) {
        if (!(std::abs(seen.centre_px.x_px) < kFarthest) || !(std::abs(seen.centre_px.y_px) < kFarthest)) {
            return fail(ErrorCode::invalid_argument, fmt::format("the centre of lenslet {},{} is no place on a sensor", seen.m, seen.n),
                        "give centres in pixels");
        }
    }
    if (observations.size() < 4) {
        return fail(ErrorCode::invalid_argument, fmt::format("{} lenslet centres", observations.size()), "give at least 4 of them");
    }
    // Outliers are judged against a smooth surface, so that the choice of a rung does not decide who is one.
    const int order = observations.size() >= 60 ? 3 : observations.size() >= 20 ? 2 : 1;
    if (order == 3) robust_polynomial(frame, observations, 1);
    robust_polynomial(frame, observations, order);
    std::vector<Point> points = points_of(frame, observations);
    if (points.size() < 4) return fail(ErrorCode::refused, "fewer than 4 lenslet centres agree with one another", "record the white frame again");

    const std::vector<Point> sample = part_of(points, kLadderCentres);
    const Blocks blocks = blocks_of(sample);

    GridFit fit;
    fit.blocks = blocks.count;
    algo::LensletGrid held = first_similarity(frame, sample);
    algo::LensletGrid previous = held;
    std::optional<Validation> best;
    std::size_t chosen = 0;
    for (const GridRung rung : algo::kGridRungs) {
        if (rung > options.highest || (options.only && rung != *options.only && (rung > *options.only || rung >= GridRung::cubic))) continue;
        const int count = parameter_count(rung);
        RungReport report;
        report.rung = rung;
        report.parameters = count;
        if (2 * sample.size() < static_cast<std::size_t>(count) + 4 && !options.only) {
            report.cv_x_rms_px = report.cv_y_rms_px = kInfinite;
            report.verdict = "not tried: too few lenslets";
            fit.ladder.push_back(report);
            continue;
        }
        auto solved = solve(lift(previous, rung), sample);
        if (!solved) {
            report.cv_x_rms_px = report.cv_y_rms_px = kInfinite;
            report.verdict = "not taken: the fit did not settle";
            fit.ladder.push_back(report);
            continue;
        }
        if (rung < GridRung::cubic) previous = solved->grid;
        const Validation validation = leave_blocks_out(*solved, blocks);
        report.rms_px = std::sqrt(solved->residuals.squaredNorm() / static_cast<double>(solved->residuals.size()));
        report.cv_x_rms_px = validation.x_rms;
        report.cv_y_rms_px = validation.y_rms;
        const bool first = !best;
        report.gain_t = first ? 0 : gain_of(*best, validation);
        const bool take = options.only ? rung == *options.only : first || report.gain_t > kNeededGain;
        if (options.only) report.verdict = take ? "asked for" : "a step on the way to the one asked for";
        else if (first) report.verdict = "the simplest";
        else if (take) report.verdict = fmt::format("needed: predicts unseen blocks better by {:.1f} standard errors", report.gain_t);
        else report.verdict = fmt::format("not needed: predicts unseen blocks better by {:.1f} standard errors, less than {:.0f}", report.gain_t, kNeededGain);
        if (take || first) {
            held = solved->grid;
            best = validation;
            chosen = fit.ladder.size();
        }
        fit.ladder.push_back(report);
    }
    if (!best) return fail(ErrorCode::refused, "no grid model fits the lenslet centres", "record the white frame again");
    RungReport& winner = fit.ladder[chosen];
    winner.chosen = true;

    // The chosen model has the last word on outliers: the surface that judged them first is not exact.
    reject_by(held, observations);
    points = points_of(frame, observations);
    if (points.size() < 4) return fail(ErrorCode::refused, "fewer than 4 lenslet centres agree with the model", "record the white frame again");
    const std::vector<Point> fitted = part_of(points, kFitCentres);
    auto final_fit = solve(held, fitted);
    if (!final_fit) return fail(ErrorCode::refused, "the chosen grid model does not settle on all centres", "record the white frame again");
    const Solved& solved = *final_fit;
    fit.grid = solved.grid;
    fit.unobservable = solved.unobservable;
    const double variance = variance_of(solved);
    const Eigen::MatrixXd inverse = inverse_normal(normal_of(solved), solved.fixed);
    fit.noise_px = std::sqrt(variance);
    fit.correlation_inflation = inflation_of(solved, blocks_of(fitted), inverse, variance);
    const auto count = static_cast<Eigen::Index>(fit.grid.parameters.size());
    fit.sigma.assign(static_cast<std::size_t>(count), 0.0);
    fit.covariance.assign(static_cast<std::size_t>(count * count), 0.0);
    if (inverse.size() > 0) {
        for (Eigen::Index r = 0; r < count; ++r) {
            for (Eigen::Index c = 0; c < count; ++c) fit.covariance[static_cast<std::size_t>(r * count + c)] = inverse(r, c) * variance * fit.correlation_inflation;
            fit.sigma[static_cast<std::size_t>(r)] = std::sqrt(std::max(0.0, inverse(r, r) * variance * fit.correlation_inflation));
        }
    }
    double x = 0;
    double y = 0;
    for (const Point& point : points) {
        const algo::PixelPoint at = fit.grid.at(point.uv);
        const double dx = at.x_px - point.seen.x_px;
        const double dy = at.y_px - point.seen.y_px;
        x += dx * dx;
        y += dy * dy;
        fit.max_px = std::max(fit.max_px, std::hypot(dx, dy));
    }
    fit.used = static_cast<int>(points.size());
    fit.rejected = static_cast<int>(observations.size() - points.size());
    fit.rms_x_px = std::sqrt(x / static_cast<double>(points.size()));
    fit.rms_y_px = std::sqrt(y / static_cast<double>(points.size()));
    fit.cv_x_rms_px = winner.cv_x_rms_px;
    fit.cv_y_rms_px = winner.cv_y_rms_px;
    fit.reason = fmt::format("{}: {}; cross-validated over {} blocks {:.4f} px in x, {:.4f} px in y", name_of(winner.rung), winner.verdict,
                             fit.blocks, fit.cv_x_rms_px, fit.cv_y_rms_px);
    return fit;
}

}  // namespace hord::calib
