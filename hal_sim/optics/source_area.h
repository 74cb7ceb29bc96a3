// How much of a bin the source fills, exactly: the area of the source's disc inside every bin's cell.
//
// Within a small cell of positions and slopes the part maps slopes linearly to the source, s = s0 + B (u - u0). The bins'
// edges become a lattice of parallelograms over the disc |s| <= r, and every parallelogram's share of the disc is the
// signed sum over its four edges of the disc's part in the triangle between the edge and the disc's centre (Green).
#pragma once

#include "algo/light_field.h"

namespace hord::sim {

// A box of slopes, in bin pitches from the centre of the bins.
struct SlopeBox {
    double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
    [[nodiscard]] bool is_empty() const { return !(u1 > u0 && v1 > v0); }
    [[nodiscard]] double area() const { return (u1 - u0) * (v1 - v0); }
};

// A linear map from slopes as seen by the camera to slopes at the source, all in bin pitches.
struct SlopeMap {
    double at_u = 0, at_v = 0;                            // here ...
    double s = 0, t = 0;                                  // ... it has this value
    double s_u = 1, s_v = 0, t_u = 0, t_v = 1;            // and these derivatives
    [[nodiscard]] double determinant() const { return s_u * t_v - s_v * t_u; }
};

// Signed area of the unit disc inside the triangle (0, P, Q).
double disc_in_triangle(double px, double py, double qx, double qy);

// Adds `weight` times the area (in slope space, 1 = a full bin) of the disc of radius r at the source inside `box` to the
// bins it falls into: bins[j * extents.i + i]. The box lies within the bins.
void add_source(const algo::Extents& extents, const SlopeMap& map, double r, const SlopeBox& box, double weight, double* bins);

}  // namespace hord::sim
