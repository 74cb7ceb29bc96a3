#include "algo/inspection/field_circle.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kSteps = 8;                              // of the fit
constexpr std::size_t kOnCircleOf = 3, kOnCircle = 2;  // 2/3 of the outline
constexpr double kNear = 1;                            // lenslets from the circle: what a hull of lenslets is exact to
constexpr std::size_t kMinPlaces = 12;

}  // namespace

FieldCircle::FieldCircle(const Extents& extents) : extents_(extents) {
    const auto most = 2 * static_cast<std::size_t>(extents.m + extents.n);
    m_.reserve(most), n_.reserve(most), distances_.reserve(most), sorted_.reserve(most);
}

double FieldCircle::distance(std::size_t k) const {
    return std::abs(std::hypot(m_[k] - middle_m_, n_[k] - middle_n_) - radius_);
}

// The lenslets of the hull with a neighbour in the field that does not belong to it. Those of a row lie at its two
// ends.
void FieldCircle::collect(const RowHull& hull) {
    m_.clear(), n_.clear();
    const auto left = [&](int n) { return hull.left(static_cast<std::size_t>(n)); };  // extents_.m: none
    const auto last = [&](int n) { return extents_.m - 1 - hull.right(static_cast<std::size_t>(n)); };
    for (int n = 1; n + 1 < extents_.n; ++n) {
        const int first_inner = std::max({left(n) + 1, left(n - 1), left(n + 1)}),
                  last_inner = std::min({last(n) - 1, last(n - 1), last(n + 1)}),
                  end = std::min(last(n), extents_.m - 2);
        for (int m = std::max(left(n), 1); m <= end; ++m) {
            if (m == first_inner && last_inner > m) m = last_inner + 1;
            if (m > end) break;
            m_.push_back(m), n_.push_back(n);
        }
    }
}

// Least squares of x^2 + y^2 + d x + e y + f, over the places within `farthest` of the circle.
bool FieldCircle::solve(double farthest) {
    double count = 0, x1 = 0, y1 = 0, xx = 0, xy = 0, yy = 0, zx = 0, zy = 0, z1 = 0;
    const double m0 = 0.5 * extents_.m, n0 = 0.5 * extents_.n;
    for (std::size_t k = 0; k < m_.size(); ++k) {
        if (distances_[k] > farthest) continue;
        const double x = m_[k] - m0, y = n_[k] - n0, z = x * x + y * y;
        ++count, x1 += x, y1 += y, xx += x * x, xy += x * y, yy += y * y, zx += z * x, zy += z * y, z1 += z;
    }
    if (count < 3) return false;
    x1 /= count, y1 /= count, z1 /= count;
    const double vxx = xx - count * x1 * x1, vxy = xy - count * x1 * y1, vyy = yy - count * y1 * y1,
                 vzx = zx - count * z1 * x1, vzy = zy - count * z1 * y1, determinant = vxx * vyy - vxy * vxy;
    if (determinant < 1e-6 * vxx * vyy) return false;
    const double x = 0.5 * (vzx * vyy - vzy * vxy) / determinant, y = 0.5 * (vzy * vxx - vzx * vxy) / determinant;
    middle_m_ = x + m0, middle_n_ = y + n0;
    radius_ = std::sqrt(std::max(z1 - 2 * (x * x1 + y * y1) + x * x + y * y, 0.0));
    return true;
}

// Each step takes the two thirds of the places that lie nearest to the last circle (least trimmed squares).
bool FieldCircle::fit(const RowHull& hull) {
    collect(hull);
    if (m_.size() < kMinPlaces) return false;
    distances_.assign(m_.size(), 0);
    double farthest = std::numeric_limits<double>::max();
    for (int step = 0; step < kSteps; ++step) {
        if (!solve(farthest)) return false;
        for (std::size_t k = 0; k < m_.size(); ++k) distances_[k] = distance(k);

        sorted_.assign(distances_.begin(), distances_.end());
        farthest = common::nth_smallest(std::span(sorted_), kOnCircle * sorted_.size() / kOnCircleOf);
    }
    return farthest <= kNear;
}

}  // namespace hord::algo
