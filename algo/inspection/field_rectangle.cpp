#include "algo/inspection/field_rectangle.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

namespace hord::algo {
namespace {

constexpr double kRightAngle = 1.5707963267948966;
constexpr int kCoarse = 45, kFiner = 4;  // first steps in a right angle (odd); how many finer ones in a step
constexpr double kOnSide = 1;            // lenslets from a side of the rectangle: what a hull of lenslets is exact to
constexpr double kOfAngle = 0.25;        // lenslets that the last step of the angle moves an end of a side by, at most
constexpr double kOutlineShare = 5.0 / 6, kSideShare = 0.5;  // explains(): what must lie on all sides, or on each
constexpr double kRounding = 1e-6;                           // lenslets

// Narrows [first, last] to where `rate` * x + `offset` lies in [least, most].
void narrow(double rate, double offset, double least, double most, double& first, double& last) {
    if (std::abs(rate) < 1e-9) {
        if (offset < least || offset > most) last = first - 1;
        return;
    }
    const auto [from, to] = std::minmax({(least - offset) / rate, (most - offset) / rate});
    first = std::max(first, from);
    last = std::min(last, to);
}

}  // namespace

FieldRectangle::FieldRectangle(const RowHull& hull, const Extents& extents, double angle)
    : extents_(extents), cos_(std::cos(angle)), sin_(std::sin(angle)) {
    constexpr double kFar = std::numeric_limits<double>::max();
    first_u_ = first_v_ = kFar, last_u_ = last_v_ = -kFar;
    for (int n = 0; n < extents.n; ++n) {
        const auto row = static_cast<std::size_t>(n);
        if (!hull.has(row)) continue;
        for (const int m : {hull.left(row), extents.m - 1 - hull.right(row)}) {
            const double u = m * cos_ + n * sin_, v = n * cos_ - m * sin_;
            first_u_ = std::min(first_u_, u), last_u_ = std::max(last_u_, u);
            first_v_ = std::min(first_v_, v), last_v_ = std::max(last_v_, v);
        }
    }
}

// The angle at which most of the outline lies on the rectangle's sides. Steps get finer until they move no end of a
// side by more than half a lenslet; what a step moves it by is allowed for.
FieldRectangle FieldRectangle::about(const RowHull& hull, const Extents& extents) {
    const double size = std::hypot(extents.m, extents.n);
    double best = 0, step = kRightAngle / kCoarse;
    int steps = kCoarse / 2;
    for (;;) {
        const double middle = best;
        double most = -1;
        // Of equals the one next to the middle.
        for (int k = 0; k <= 2 * steps; ++k) {
            const double angle = middle + step * (k % 2 == 0 ? k / 2 : -(k + 1) / 2),
                         on_sides =
                             FieldRectangle(hull, extents, angle).outline_of(hull, kOnSide + step * size / 2).on_sides;
            if (on_sides > most) most = on_sides, best = angle;
        }
        if (step * size < 2 * kOfAngle) return {hull, extents, best};
        step /= kFiner;
        steps = kFiner;
    }
}

bool FieldRectangle::explains(const RowHull& hull) const {
    const Outline outline = outline_of(hull, kOnSide + kOfAngle);
    const double u = last_u_ - first_u_, v = last_v_ - first_v_;
    const auto& [first_u, last_u, first_v, last_v] = outline.on_side;
    return outline.on_sides >= kOutlineShare * outline.all ||
        (std::min(first_u, last_u) >= kSideShare * v && std::min(first_v, last_v) >= kSideShare * u);
}

// Of the hull's outline, what lies on a side of the rectangle to `near` lenslets.
FieldRectangle::Outline FieldRectangle::outline_of(const RowHull& hull, double near) const {
    Outline length;
    const int last_m = extents_.m - 1, last_n = extents_.n - 1;
    const auto add = [&](int m0, int n0, int m1, int n1) {
        if ((m0 == m1 && (m0 == 0 || m0 == last_m)) || (n0 == n1 && (n0 == 0 || n0 == last_n))) return;
        const double u0 = m0 * cos_ + n0 * sin_, v0 = n0 * cos_ - m0 * sin_, u1 = m1 * cos_ + n1 * sin_,
                     v1 = n1 * cos_ - m1 * sin_;
        const auto lies_on = [near](double a, double b, double side) {
            return std::abs(a - side) <= near && std::abs(b - side) <= near;
        };
        const double of_step = std::sqrt(static_cast<double>((m1 - m0) * (m1 - m0) + (n1 - n0) * (n1 - n0)));
        const std::array<bool, 4> lies{lies_on(u0, u1, first_u_), lies_on(u0, u1, last_u_), lies_on(v0, v1, first_v_),
                                       lies_on(v0, v1, last_v_)};
        length.all += of_step;
        for (std::size_t side = 0; side < lies.size(); ++side) length.on_side[side] += lies[side] ? of_step : 0;
        length.on_sides += std::ranges::any_of(lies, std::identity{}) ? of_step : 0;
    };
    const auto right = [&](std::size_t row) { return last_m - hull.right(row); };
    for (int n = 0; n <= last_n; ++n) {
        const auto row = static_cast<std::size_t>(n);
        if (!hull.has(row)) continue;
        const bool is_first = n == 0 || !hull.has(row - 1), is_last = n == last_n || !hull.has(row + 1);
        if (is_first || is_last) add(hull.left(row), n, right(row), n);
        if (is_last) continue;
        add(hull.left(row), n, hull.left(row + 1), n + 1);
        add(right(row), n, right(row + 1), n + 1);
    }
    return length;
}

bool FieldRectangle::contains(int m, int n) const {
    const double u = m * cos_ + n * sin_, v = n * cos_ - m * sin_;
    return u >= first_u_ - kRounding && u <= last_u_ + kRounding && v >= first_v_ - kRounding &&
        v <= last_v_ + kRounding;
}

// The leg of a cut: the least sum of the distances of a lenslet of the hull from the two sides that meet there.
double FieldRectangle::uneven_corners(const RowHull& hull) const {
    constexpr double kFar = std::numeric_limits<double>::max();
    std::array<double, 4> legs{kFar, kFar, kFar, kFar};
    for (int n = 0; n < extents_.n; ++n) {
        const auto row = static_cast<std::size_t>(n);
        if (!hull.has(row)) continue;
        for (const int m : {hull.left(row), extents_.m - 1 - hull.right(row)}) {
            const double u = m * cos_ + n * sin_, v = n * cos_ - m * sin_;
            for (unsigned corner = 0; corner < legs.size(); ++corner) {
                const double from_u = (corner & 1U) != 0 ? last_u_ - u : u - first_u_,
                             from_v = (corner & 2U) != 0 ? last_v_ - v : v - first_v_;
                legs[corner] = std::min(legs[corner], from_u + from_v);
            }
        }
    }
    double longest = 0, shortest = kFar;
    for (unsigned corner = 0; corner < legs.size(); ++corner) {
        const double u = (corner & 1U) != 0 ? last_u_ : first_u_, v = (corner & 2U) != 0 ? last_v_ : first_v_,
                     m = u * cos_ - v * sin_, n = u * sin_ + v * cos_;
        const double last_m = extents_.m - 1, last_n = extents_.n - 1;
        if (m < 0 || n < 0 || m > last_m || n > last_n) continue;
        longest = std::max(longest, legs[corner]), shortest = std::min(shortest, legs[corner]);
    }
    return std::max(longest - shortest, 0.0);
}

double FieldRectangle::farthest_from_long_sides(const RowHull& hull) const {
    const bool along = last_u_ - first_u_ > last_v_ - first_v_;
    double farthest = 0;
    for (int n = 0; n < extents_.n; ++n) {
        const auto row = static_cast<std::size_t>(n);
        for (int m = 0; m < extents_.m; ++m) {
            if (hull.contains(row, m)) {
                m = extents_.m - 1 - hull.right(row);
                continue;
            }
            if (!contains(m, n)) continue;
            const double at = along ? n * cos_ - m * sin_ : m * cos_ + n * sin_, first = along ? first_v_ : first_u_,
                         last = along ? last_v_ : last_u_;
            farthest = std::max(farthest, std::min(at - first, last - at));
        }
    }
    return farthest;
}

// Of the side at u = `at` (or at v = `at`: `along`), the length inside the field; its outermost lenslets do not count.
double FieldRectangle::seen_of(bool along, double at) const {
    double first = along ? first_u_ : first_v_, last = along ? last_u_ : last_v_;
    const double m_rate = along ? cos_ : -sin_, n_rate = along ? sin_ : cos_;
    narrow(m_rate, along ? -at * sin_ : at * cos_, 1, extents_.m - 2, first, last);
    narrow(n_rate, along ? at * cos_ : at * sin_, 1, extents_.n - 2, first, last);
    return std::max(0.0, last - first);
}

bool FieldRectangle::is_strip(double share) const {
    const auto is_long = [&](bool along, double width) {
        return seen_of(along, along ? first_v_ : first_u_) > share * width &&
            seen_of(along, along ? last_v_ : last_u_) > share * width;
    };
    const auto is_beyond = [&](bool along) {
        constexpr double kTouch = 1;  // a corner of the field
        return seen_of(along, along ? first_v_ : first_u_) <= kTouch &&
            seen_of(along, along ? last_v_ : last_u_) <= kTouch;
    };
    return (is_long(true, last_v_ - first_v_) && is_beyond(false)) ||
        (is_long(false, last_u_ - first_u_) && is_beyond(true));
}

}  // namespace hord::algo
