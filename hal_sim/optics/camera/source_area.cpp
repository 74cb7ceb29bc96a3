#include "hal_sim/optics/camera/source_area.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/optics/scene/exact_math.h"

namespace hord::sim {
namespace {

double half_angle(double px, double py, double qx, double qy) {
    return 0.5 * exact::atan2(px * qy - py * qx, px * qx + py * qy);
}

int cell_of(double at, double left, double step, int count) {
    return std::clamp(static_cast<int>(std::floor((at - left) / step)), 0, count - 1);
}

// The cell edges between low and high, with low and high as first and last; `first`: the cell of the first piece.
int cuts(double low, double high, double left, double step, int count, double* cut, int& first) {
    first = cell_of(low, left, step, count);
    int n = 0;
    cut[n++] = low;
    for (int k = first + 1; k < count && left + k * step < high; ++k) cut[n++] = left + k * step;
    cut[n++] = high;
    return n;
}

}  // namespace

int SlopeGrid::column(double u) const { return cell_of(u, left, step, i); }
int SlopeGrid::row(double v) const { return cell_of(v, top, step, j); }

double disc_in_triangle(double px, double py, double qx, double qy) {
    const double dx = qx - px, dy = qy - py;
    const double a = dx * dx + dy * dy;
    if (a == 0) return 0;
    const double cross = px * qy - py * qx;
    const double p_out = px * px + py * py - 1, q_out = qx * qx + qy * qy - 1;
    if (p_out <= 0 && q_out <= 0) return 0.5 * cross;
    const double b = px * dx + py * dy;
    const double gap = a - cross * cross;  // b^2 - a c, computed without cancellation
    if (gap <= 0) return half_angle(px, py, qx, qy);
    const double root = std::sqrt(gap);
    const double t1 = (-b - root) / a, t2 = (-b + root) / a;
    if (t1 >= 1 || t2 <= 0) return half_angle(px, py, qx, qy);
    double area = 0.5 * (std::min(t2, 1.0) - std::max(t1, 0.0)) * cross;
    if (t1 > 0) area += half_angle(px, py, px + t1 * dx, py + t1 * dy);
    if (t2 < 1) area += half_angle(px + t2 * dx, py + t2 * dy, qx, qy);
    return area;
}

void add_source(const SlopeGrid& grid, const SlopeMap& map, double r, const SlopeBox& box, double weight,
                double* cells) {
    const double det = map.determinant();
    if (det == 0 || weight == 0) return;
    // Where the disc lies in slope space: its centre, and the half sides of its bounding box.
    const double u = map.at_u - (map.t_v * map.s - map.s_v * map.t) / det;
    const double v = map.at_v - (map.s_u * map.t - map.t_u * map.s) / det;
    const double half_u = r * std::sqrt(map.t_v * map.t_v + map.s_v * map.s_v) / std::abs(det);
    const double half_v = r * std::sqrt(map.s_u * map.s_u + map.t_u * map.t_u) / std::abs(det);
    const SlopeBox lit{std::max(box.u0, u - half_u), std::min(box.u1, u + half_u), std::max(box.v0, v - half_v),
                       std::min(box.v1, v + half_v)};
    if (lit.is_empty()) return;

    constexpr int kMax = SlopeGrid::kMaxCells + 2;
    double cut_u[kMax], cut_v[kMax];
    int first_i = 0, first_j = 0;
    const int nu = cuts(lit.u0, lit.u1, grid.left, grid.step, grid.i, cut_u, first_i);
    const int nv = cuts(lit.v0, lit.v1, grid.top, grid.step, grid.j, cut_v, first_j);

    const double scale = weight * r * r / det;  // signed: a mirrored lattice has mirrored cells
    double* const corner = cells + first_j * grid.i + first_i;
    double x[2][kMax], y[2][kMax], along[2][kMax];
    for (int b = 0; b < nv; ++b) {
        double* const xs = x[b & 1];
        double* const ys = y[b & 1];
        double* const row = along[b & 1];
        for (int k = 0; k < nu; ++k) {
            const double du = cut_u[k] - map.at_u, dv = cut_v[b] - map.at_v;
            xs[k] = (map.s + map.s_u * du + map.s_v * dv) / r;
            ys[k] = (map.t + map.t_u * du + map.t_v * dv) / r;
            if (k > 0) row[k] = disc_in_triangle(xs[k - 1], ys[k - 1], xs[k], ys[k]);
        }
        if (b == 0) continue;
        const double* const xp = x[(b - 1) & 1];
        const double* const yp = y[(b - 1) & 1];
        double left = disc_in_triangle(xp[0], yp[0], xs[0], ys[0]);
        for (int k = 1; k < nu; ++k) {
            const double right = disc_in_triangle(xp[k], yp[k], xs[k], ys[k]);
            corner[(b - 1) * grid.i + k - 1] += scale * (along[(b - 1) & 1][k] + right - row[k] - left);
            left = right;
        }
    }
}

}  // namespace hord::sim
