// Choosing between rungs: what a fit would say about blocks of lenslets that it has not seen.
// Used by calib/fit/grid_fit.cpp only.
#pragma once

#include <limits>
#include <vector>

#include "calib/fit/grid_solver.h"

namespace hord::calib {

// Blocks of neighbouring lenslets: block b is points first[b] .. first[b + 1] - 1.
struct Blocks {
    std::vector<std::size_t> first{0};
    [[nodiscard]] int count() const { return static_cast<int>(first.size()) - 1; }
};

// Sorts the points by block. Up to 8 x 8 blocks of about 12 points or more; of fewer than about 108, every one is its
// own.
Blocks sort_into_blocks(std::vector<Point>& points);

struct Validation {
    std::vector<double> squared;  // error a block, px^2
    Eigen::VectorXd off;          // model less seen of every point, x, y, x, y ..., its block not having been fitted
    double x_rms = std::numeric_limits<double>::infinity(), y_rms = std::numeric_limits<double>::infinity();
};

// What each block's error would be had the block not been fitted: one Newton step from the full fit with the block's
// own part of the normal equations taken away (exact for models linear in their parameters). The points of `solved` are
// sorted by block.
Validation leave_blocks_out(const Solved& solved, const Blocks& blocks);

// The improvement of `next` over `held`, in standard errors of its sum over the blocks.
double gain_of(const Validation& held, const Validation& next);

// How much more the fit may be wrong than independent residuals would make it: the spread of the blocks' pulls on the
// parameters against what it would be. Below 1.5 it is chance: 1.
double inflation_of(const Solved& solved, const Blocks& blocks, const Eigen::MatrixXd& inverse, double variance);

}  // namespace hord::calib
