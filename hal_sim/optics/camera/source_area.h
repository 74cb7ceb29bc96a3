// The exact area of the source's disc inside each bin, where the part maps slopes linearly to the source,
// s = s0 + B (u - u0). How: docs/notes/optics.md.
#pragma once

#include "algo/frame/extents.h"

namespace hord::sim {

// A box of slopes, in bin pitches from the centre of the bins.
struct SlopeBox {
    double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
    [[nodiscard]] bool is_empty() const { return !(u1 > u0 && v1 > v0); }
    [[nodiscard]] double area() const { return (u1 - u0) * (v1 - v0); }
};

// A linear map from slopes as seen by the camera to slopes at the source, all in bin pitches.
struct SlopeMap {
    double at_u = 0, at_v = 0;                  // here ...
    double s = 0, t = 0;                        // ... it has this value
    double s_u = 1, s_v = 0, t_u = 0, t_v = 1;  // and these derivatives
    [[nodiscard]] double determinant() const { return s_u * t_v - s_v * t_u; }
};

// The grid of slopes of one lenslet: cell (k,l) reaches from left + k step to left + (k + 1) step, and likewise down.
struct SlopeGrid {
    static constexpr int kMaxCells = 400;  // a side
    double left = 0, top = 0, step = 1;    // bin pitches
    int i = 0, j = 0;
    [[nodiscard]] int cells() const { return i * j; }
    [[nodiscard]] SlopeBox box() const { return {left, left + i * step, top, top + j * step}; }
    [[nodiscard]] int column(double u) const;  // the cell that holds this slope, or the nearest
    [[nodiscard]] int row(double v) const;

    // The bins, and `around` times as many on every side.
    static SlopeGrid of(const algo::Extents& e, int around = 0) {
        const int k = 1 + 2 * around;
        return {-0.5 * k * e.i, -0.5 * k * e.j, 1, k * e.i, k * e.j};
    }
};

// Signed area of the unit disc inside the triangle (0, P, Q).
double disc_in_triangle(double px, double py, double qx, double qy);

// Adds `weight` times the area (in slope space, 1 = a full bin) of the disc of radius r at the source inside `box` to
// the cells it falls into: cells[l * grid.i + k]. The box lies within the grid.
void add_source(const SlopeGrid& grid, const SlopeMap& map, double r, const SlopeBox& box, double weight,
                double* cells);

}  // namespace hord::sim
