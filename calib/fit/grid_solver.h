// One rung of the ladder, fitted to centres with Ceres: the parameters, what the centres do not determine, and what is
// left over. Used by calib/fit/grid_fit.cpp and calib/fit/cross_validation.cpp only.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Dense>

#include "algo/frame/lenslet_grid.h"
#include "calib/fit/grid_fit.h"

namespace hord::calib {

// One centre: where it lies in the lattice, and in the frame.
struct Point {
    algo::LensletGrid::Uv uv;
    algo::PixelPoint seen;
    algo::PixelPoint split = {};  // Observation::split_px, where it is needed
};

struct Solved {
    algo::LensletGrid grid;
    std::vector<bool> fixed;  // one a parameter
    std::vector<Unobservable> unobservable;
    Eigen::VectorXd residuals;  // x, y, x, y ... px
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>
        jacobian;  // of them; columns of fixed parameters are 0
};

// Fits the parameters of `start`, fixing those that the points do not determine. The centre of distortion is held while
// k1 is not known to three of its standard errors. None where Ceres finds no usable answer.
std::optional<Solved> solve(algo::LensletGrid start, const std::vector<Point>& points);

// J^T J, and its inverse over the free parameters, 0 elsewhere; empty where it cannot be inverted.
Eigen::MatrixXd normal_of(const Solved& solved);
Eigen::MatrixXd inverse_normal(const Eigen::MatrixXd& normal, const std::vector<bool>& fixed);

// Of one residual, from all of them, px^2.
double variance_of(const Solved& solved);

}  // namespace hord::calib
