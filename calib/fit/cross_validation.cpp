#include "calib/fit/cross_validation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace hord::calib {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr int kCornerSide = 4;  // blocks a side: with fewer, a corner is too large a part of the frame

// The rows of block b: two a point.
struct Rows {
    Eigen::Index first, count;
};
Rows rows_of(const Blocks& blocks, std::size_t b) {
    return {static_cast<Eigen::Index>(2 * blocks.first[b]),
            static_cast<Eigen::Index>(2 * (blocks.first[b + 1] - blocks.first[b]))};
}

}  // namespace

Blocks sort_into_blocks(std::vector<Point>& points) {
    Blocks blocks;
    const int side = std::clamp(static_cast<int>(std::sqrt(static_cast<double>(points.size()) / 12.0)), 1, 8);
    if (side < 3) {  // too few for blocks: one a lenslet
        for (std::size_t k = 0; k < points.size(); ++k) blocks.first.push_back(k + 1);
        return blocks;
    }
    double low_x = kInfinite, high_x = -kInfinite, low_y = kInfinite, high_y = -kInfinite;
    for (const Point& p : points) {
        low_x = std::min(low_x, p.seen.x_px);
        high_x = std::max(high_x, p.seen.x_px);
        low_y = std::min(low_y, p.seen.y_px);
        high_y = std::max(high_y, p.seen.y_px);
    }
    const auto cell_of = [&](const Point& p) {
        const auto place = [side](double x, double low, double high) {
            return std::min(side - 1, static_cast<int>(side * (x - low) / std::max(high - low, 1e-12)));
        };
        return static_cast<std::size_t>(place(p.seen.y_px, low_y, high_y) * side + place(p.seen.x_px, low_x, high_x));
    };
    std::vector<std::size_t> next(static_cast<std::size_t>(side * side) + 1);
    for (const Point& p : points) ++next[cell_of(p) + 1];
    if (side >= kCornerSide) blocks.corners.resize(4);
    for (std::size_t cell = 1; cell < next.size(); ++cell) {
        if (next[cell] == 0) continue;  // no block of an empty cell
        const int column = static_cast<int>(cell - 1) % side, row = static_cast<int>(cell - 1) / side;
        const auto outer = [side](int k) { return k < side / 4 || k >= side - side / 4; };
        if (!blocks.corners.empty() && outer(column) && outer(row))
            blocks.corners[(row < side / 2 ? 0U : 2U) + (column < side / 2 ? 0U : 1U)].push_back(blocks.first.size() -
                                                                                                 1);
        blocks.first.push_back(blocks.first.back() + next[cell]);
    }
    std::partial_sum(next.begin(), next.end(), next.begin());
    std::vector<Point> sorted(points.size());
    for (const Point& p : points) sorted[next[cell_of(p)]++] = p;
    points = std::move(sorted);
    return blocks;
}

Validation leave_blocks_out(const Solved& solved, const Blocks& blocks) {
    const Eigen::Index size = solved.jacobian.cols();
    const auto count = static_cast<std::size_t>(blocks.count());
    std::vector<Eigen::MatrixXd> normal(count, Eigen::MatrixXd::Zero(size, size));
    std::vector<Eigen::VectorXd> gradient(count);
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd pull = Eigen::VectorXd::Zero(size);
    for (std::size_t b = 0; b < count; ++b) {
        const Rows rows = rows_of(blocks, b);
        const auto part = solved.jacobian.middleRows(rows.first, rows.count);
        normal[b].selfadjointView<Eigen::Lower>().rankUpdate(part.transpose());
        normal[b].triangularView<Eigen::StrictlyUpper>() = normal[b].transpose();
        gradient[b] = part.transpose() * solved.residuals.segment(rows.first, rows.count);
        all += normal[b];
        pull += gradient[b];
    }
    Validation validation;
    validation.squared.resize(count);
    validation.off.resize(solved.residuals.size());
    double x = 0;
    double y = 0;
    for (std::size_t b = 0; b < count; ++b) {
        const Eigen::MatrixXd inverse = inverse_normal(all - normal[b], solved.fixed);
        if (inverse.size() == 0) return {};
        const Rows rows = rows_of(blocks, b);
        const Eigen::VectorXd change = -inverse * (pull - gradient[b]);
        const Eigen::VectorXd off = solved.residuals.segment(rows.first, rows.count) +
            solved.jacobian.middleRows(rows.first, rows.count) * change;
        for (Eigen::Index k = 0; k < rows.count; k += 2) {
            x += off(k) * off(k);
            y += off(k + 1) * off(k + 1);
        }
        validation.squared[b] = off.squaredNorm();
        validation.off.segment(rows.first, rows.count) = off;
    }
    for (const std::vector<std::size_t>& corner : blocks.corners) {
        Eigen::MatrixXd rest = all;
        Eigen::VectorXd rest_pull = pull;
        for (const std::size_t b : corner) {
            rest -= normal[b];
            rest_pull -= gradient[b];
        }
        const Eigen::MatrixXd inverse = inverse_normal(rest, solved.fixed);
        const Eigen::VectorXd change = inverse.size() == 0 ? Eigen::VectorXd() : Eigen::VectorXd(-inverse * rest_pull);
        double squared = inverse.size() == 0 ? kInfinite : 0;
        std::size_t points = 0;
        for (const std::size_t b : corner) {
            const Rows rows = rows_of(blocks, b);
            points += blocks.first[b + 1] - blocks.first[b];
            if (inverse.size() == 0) continue;
            squared += (solved.residuals.segment(rows.first, rows.count) +
                        solved.jacobian.middleRows(rows.first, rows.count) * change)
                           .squaredNorm();
        }
        validation.corners_rms.push_back(points > 0 ? std::sqrt(squared / static_cast<double>(points)) : 0);
    }
    validation.x_rms = std::sqrt(x / static_cast<double>(blocks.first.back()));
    validation.y_rms = std::sqrt(y / static_cast<double>(blocks.first.back()));
    return validation;
}

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

double inflation_of(const Solved& solved, const Blocks& blocks, const Eigen::MatrixXd& inverse, double variance) {
    if (blocks.count() < 9 || inverse.size() == 0 || !(variance > 0)) return 1;
    Eigen::MatrixXd pull(solved.jacobian.cols(), blocks.count());
    for (std::size_t b = 0; b + 1 < blocks.first.size(); ++b) {
        const Rows rows = rows_of(blocks, b);
        pull.col(static_cast<Eigen::Index>(b)) = solved.jacobian.middleRows(rows.first, rows.count).transpose() *
            solved.residuals.segment(rows.first, rows.count);
    }
    const auto free = static_cast<double>(std::count(solved.fixed.begin(), solved.fixed.end(), false));
    const double spread = (pull.transpose() * inverse * pull).trace() / (variance * free);
    return spread > 1.5 ? spread : 1;
}

}  // namespace hord::calib
