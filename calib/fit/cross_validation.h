// Cross-validation of a fit by leaving out blocks of lenslets.
#pragma once

#include <limits>
#include <vector>

#include "calib/fit/grid_solver.h"

namespace hord::calib {

// Blocks of neighbouring lenslets: block b is points first[b] .. first[b + 1] - 1.
struct Blocks {
    std::vector<std::size_t> first{0};
    // The blocks of each corner of the measured area, a quarter of its width and height; empty without enough blocks.
    std::vector<std::vector<std::size_t>> corners;
    [[nodiscard]] int count() const { return static_cast<int>(first.size()) - 1; }
};

// Sorts the points by block, by their places in the frame. Up to 8 x 8 blocks of about 12 points or more; below about
// 108 points, each is a block.
Blocks sort_into_blocks(std::vector<Point>& points);

struct Validation {
    std::vector<double> squared;  // sum of squared errors of each block, px^2
    Eigen::VectorXd off;          // model minus measurement of every point, its block left out; x, y, x, y ...
    double x_rms = std::numeric_limits<double>::infinity(), y_rms = std::numeric_limits<double>::infinity();
    std::vector<double> corners_rms;  // px, both axes, of each corner of Blocks, left out whole
};

// The errors of each block when it is left out of the fit, by one Newton step from the full fit without the block's
// part of the normal equations (exact for models linear in their parameters). The points of `solved` are sorted by
// block.
Validation leave_blocks_out(const Solved& solved, const Blocks& blocks);

// The improvement of `next` over `held`: sum over the blocks, in its standard errors.
double gain_of(const Validation& held, const Validation& next);

// Factor for the covariance because neighbouring residuals are correlated: the spread of the blocks' gradients over
// that of independent residuals. Values below 1.5 are chance and become 1.
double inflation_of(const Solved& solved, const Blocks& blocks, const Eigen::MatrixXd& inverse, double variance);

}  // namespace hord::calib
