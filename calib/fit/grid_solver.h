// Fits one grid model to centres with Ceres: parameters, those that the centres do not determine, residuals.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Dense>

#include "algo/frame/lenslet_grid.h"
#include "calib/fit/grid_fit.h"

namespace hord::calib {

// One centre: its lattice coordinates and its measured position.
struct Point {
    algo::LensletGrid::Uv uv;
    algo::PixelPoint seen;
    algo::PixelPoint split = {};  // Observation::split_px, if needed
};

struct Solved {
    algo::LensletGrid grid;
    std::vector<bool> fixed;  // one a parameter
    std::vector<Unobservable> unobservable;
    Eigen::VectorXd residuals;  // x, y, x, y ... px
    // Of the residuals; columns of fixed parameters are 0.
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian;
};

// Fits the parameters of `start`; fixes those that the points do not determine. The centre of distortion is fixed
// unless k1 exceeds three of its standard errors. None if Ceres finds no usable solution.
std::optional<Solved> solve(algo::LensletGrid start, const std::vector<Point>& points);

// J^T J, and its inverse over the free parameters, 0 elsewhere; empty if singular.
Eigen::MatrixXd normal_of(const Solved& solved);
Eigen::MatrixXd inverse_normal(const Eigen::MatrixXd& normal, const std::vector<bool>& fixed);

// Variance of one residual, px^2.
double variance_of(const Solved& solved);

}  // namespace hord::calib
