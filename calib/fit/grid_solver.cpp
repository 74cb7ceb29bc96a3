#include "calib/fit/grid_solver.h"

#include <algorithm>
#include <cmath>

#include <ceres/ceres.h>

namespace hord::calib {
namespace {

using algo::GridModelKind;

constexpr double kSingular = 1e-9;  // of the eigenvalues of the normalised normal equations, against 1

// Linear in the parameters: the derivatives are constant.
bool linear(GridModelKind model) {
    return model == GridModelKind::similarity || model == GridModelKind::affine || model == GridModelKind::cubic ||
        model == GridModelKind::quintic;
}

// All residuals of a grid in one block, with their analytic derivatives.
class GridCost final : public ceres::CostFunction {
  public:
    GridCost(const algo::LensletGrid& frame, const std::vector<Point>& points) : grid_(frame), points_(points) {
        set_num_residuals(static_cast<int>(2 * points.size()));
        mutable_parameter_block_sizes()->push_back(parameter_count(frame.model));
    }
    bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override {
        algo::LensletGrid grid = grid_;
        const auto count = static_cast<std::size_t>(parameter_count(grid.model));
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

// Residuals, and derivatives unless they are known.
void evaluate(Solved& solved, const std::vector<Point>& points, bool derivatives_known = false) {
    const auto count = static_cast<Eigen::Index>(parameter_count(solved.grid.model));
    solved.residuals.resize(static_cast<Eigen::Index>(2 * points.size()));
    solved.jacobian.resize(solved.residuals.size(), count);
    const GridCost cost(solved.grid, points);
    const double* parameters = solved.grid.parameters.data();
    double* jacobian = solved.jacobian.data();
    cost.Evaluate(&parameters, solved.residuals.data(), derivatives_known ? nullptr : &jacobian);
    for (Eigen::Index k = 0; k < count; ++k) {
        if (solved.fixed[static_cast<std::size_t>(k)]) solved.jacobian.col(k).setZero();
    }
}

// Fixes the parameters that the centres do not determine, one a null direction; true if it fixed any.
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
            solved.unobservable.push_back(
                {parameter_name(solved.grid.model, static_cast<int>(k)), "no centre depends on it"});
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
            // The parameter with the largest share in the null direction; of equal ones the last.
            const Eigen::VectorXd null = eigen.eigenvectors().col(0).cwiseAbs();
            Eigen::Index worst = n - 1;
            for (Eigen::Index k = n - 1; k >= 0; --k) {
                if (null(k) > 1.05 * null(worst)) worst = k;
            }
            const Eigen::Index k = free[static_cast<std::size_t>(worst)];
            solved.fixed[static_cast<std::size_t>(k)] = any = again = true;
            solved.jacobian.col(k).setZero();
            solved.unobservable.push_back(
                {parameter_name(solved.grid.model, static_cast<int>(k)), "the others can stand in for it"});
        }
        if (!again) return any;
    }
}

// Runs Ceres on the free parameters, with its own (Jacobi) scaling.
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
    if (!held.empty())
        problem.SetManifold(parameters.data(), new ceres::SubsetManifold(static_cast<int>(parameters.size()), held));
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = 30;
    options.initial_trust_region_radius = 1e8;  // the start is near: the first step is a Newton step
    options.function_tolerance = 1e-12;
    options.gradient_tolerance = 1e-14;
    options.parameter_tolerance = 1e-12;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return summary.IsSolutionUsable() &&
        std::all_of(parameters.begin(), parameters.end(), [](double p) { return std::isfinite(p); });
}

}  // namespace

Eigen::MatrixXd normal_of(const Solved& solved) {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(solved.jacobian.cols(), solved.jacobian.cols());
    normal.selfadjointView<Eigen::Lower>().rankUpdate(solved.jacobian.transpose());
    normal.triangularView<Eigen::StrictlyUpper>() = normal.transpose();
    return normal;
}

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
        for (Eigen::Index c = 0; c < n; ++c)
            part(r, c) =
                normal(free[static_cast<std::size_t>(r)], free[static_cast<std::size_t>(c)]) * scale(r) * scale(c);
    }
    const Eigen::LDLT<Eigen::MatrixXd> factor(part);
    if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 1e-12)) return {};
    const Eigen::MatrixXd inverse = factor.solve(Eigen::MatrixXd::Identity(n, n));
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(normal.rows(), normal.cols());
    for (Eigen::Index r = 0; r < n; ++r) {
        for (Eigen::Index c = 0; c < n; ++c) {
            out(free[static_cast<std::size_t>(r)], free[static_cast<std::size_t>(c)]) =
                inverse(r, c) * scale(r) * scale(c);
        }
    }
    return out;
}

double variance_of(const Solved& solved) {
    const auto free = std::count(solved.fixed.begin(), solved.fixed.end(), false);
    const auto degrees = static_cast<double>(solved.residuals.size() - free);
    return degrees > 0 ? solved.residuals.squaredNorm() / degrees : 0;
}

std::optional<Solved> solve(algo::LensletGrid start, const std::vector<Point>& points) {
    Solved solved;
    solved.grid = std::move(start);
    solved.fixed.assign(solved.grid.parameters.size(), false);
    const bool full = algo::radial_terms(solved.grid.model).second;
    const bool know_centre = full && (solved.grid.parameters[10] != 0 || solved.grid.parameters[11] != 0);
    if (full && !know_centre) solved.fixed[10] = solved.fixed[11] = true;
    evaluate(solved, points);
    if (!solved.residuals.allFinite() || !solved.jacobian.allFinite()) return std::nullopt;
    fix_null_directions(solved);
    if (!run(solved, points)) return std::nullopt;
    evaluate(solved, points, linear(solved.grid.model));
    if (linear(solved.grid.model)) return solved;
    if (full && !know_centre) {
        const Eigen::MatrixXd inverse = inverse_normal(normal_of(solved), solved.fixed);
        // Of a rational model, k1 and k2 with opposite signs do what k1 alone does.
        const bool rational = solved.grid.model == GridModelKind::rational2 && !solved.fixed[9];
        const double k1 = std::abs(solved.grid.parameters[8] - (rational ? solved.grid.parameters[9] : 0));
        const double variance = inverse.size() == 0 ? 0
            : rational                              ? inverse(8, 8) + inverse(9, 9) - 2 * inverse(8, 9)
                                                    : inverse(8, 8);
        if (inverse.size() > 0 && k1 > 3 * std::sqrt(std::max(0.0, variance) * variance_of(solved))) {
            solved.fixed[10] = solved.fixed[11] = false;
            if (!run(solved, points)) return std::nullopt;
            evaluate(solved, points);
        } else {
            for (const char* name : {"cx", "cy"})
                solved.unobservable.push_back({name, "k1 is not significant; held at the middle of the frame"});
        }
    }
    if (fix_null_directions(solved)) {
        if (!run(solved, points)) return std::nullopt;
        evaluate(solved, points);
    }
    return solved;
}

}  // namespace hord::calib
