// A cell of one lenslet's light: a box of positions in the lenslet and slopes; and the nine rays that sample it.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "hal_sim/optics/camera/source_area.h"

namespace hord::sim {

// The corners that are sampled: half of the sixteen, the two-level design 2^(4-1) of resolution IV.
inline constexpr int kAxes = 4;  // x, y, u, v
inline constexpr int kCorners = 8;
inline constexpr int kSigns[kCorners][kAxes] = {{-1, -1, -1, -1}, {1, -1, -1, 1}, {-1, 1, -1, 1}, {1, 1, -1, -1},
                                                {-1, -1, 1, 1},   {1, -1, 1, -1}, {-1, 1, 1, -1}, {1, 1, 1, 1}};

struct LensletCell {
    double x, y, hx, hy;  // centre and half sides, mm
    SlopeBox box;
    double lenslet_area;

    [[nodiscard]] double u() const { return 0.5 * (box.u0 + box.u1); }
    [[nodiscard]] double v() const { return 0.5 * (box.v0 + box.v1); }
    [[nodiscard]] double hu() const { return 0.5 * (box.u1 - box.u0); }
    [[nodiscard]] double hv() const { return 0.5 * (box.v1 - box.v0); }
    [[nodiscard]] double share() const { return 4 * hx * hy / lenslet_area; }
};

// The nine rays: corner k at [k], the centre at [kCorners].
struct CellSamples {
    double s[kCorners + 1], t[kCorners + 1];    // slope at the source, bins
    double du[kCorners + 1], dv[kCorners + 1];  // the same less the slope seen by the camera
    double weight[kCorners + 1];
    std::uint64_t path[kCorners + 1];
    bool one_path = true;

    [[nodiscard]] double mean(const double* of) const {
        double sum = 0;
        for (int k = 0; k < kCorners; ++k) sum += of[k];
        return sum / kCorners;
    }
    // Largest deviation of the map to the source from a linear one, bins; range of the light's weights.
    [[nodiscard]] double nonlinearity() const { return std::max(misfit(s), misfit(t)); }
    [[nodiscard]] double unevenness() const {
        const auto [low, high] = std::minmax_element(weight, weight + kCorners + 1);
        return *high - *low;
    }
    [[nodiscard]] double misfit(const double* of) const {
        const double centre = mean(of);
        double effects[kAxes], worst = std::abs(of[kCorners] - centre);
        for (int a = 0; a < kAxes; ++a) effects[a] = effect(of, a);
        for (int k = 0; k < kCorners; ++k) {
            double fit = centre;
            for (int a = 0; a < kAxes; ++a) fit += kSigns[k][a] * effects[a];
            worst = std::max(worst, std::abs(of[k] - fit));
        }
        return worst;
    }
    // By how many bins the source moves over half the cell.
    [[nodiscard]] double shift() const {
        return std::hypot(effect(s, 0), effect(t, 0)) + std::hypot(effect(s, 1), effect(t, 1));
    }
    // The linear effect of half a side of the cell along an axis.
    [[nodiscard]] double effect(const double* of, int axis) const {
        double sum = 0;
        for (int k = 0; k < kCorners; ++k) sum += kSigns[k][axis] * of[k];
        return sum / kCorners;
    }
};

// The first point of a cell's quasirandom sequence, in [0, 1). It differs from cell to cell, so that the errors of the
// cells are independent.
inline void first_point(const LensletCell& cell, double (&at)[kAxes]) {
    const auto bits = [](double value) { return std::bit_cast<std::uint64_t>(value); };
    std::uint64_t hash = 0;
    for (const double value : {cell.x, cell.y, cell.box.u0, cell.box.v0, cell.box.u1}) {
        hash = (hash ^ bits(value)) * 0x9E3779B97F4A7C15ULL;
        hash ^= hash >> 29;
    }
    for (double& x : at) {
        hash *= 0xBF58476D1CE4E5B9ULL;
        hash ^= hash >> 31;
        x = static_cast<double>(hash >> 11) * 0x1p-53;
    }
}

// Steps of the R4 sequence: evenly spread points in four dimensions, by the root of x^5 = x + 1 (M. Roberts, "The
// unreasonable effectiveness of quasirandom sequences", 2018).
inline constexpr double kQuasirandomStep[4] = {0.85667488385450287, 0.73389185662712604, 0.62870672103780871,
                                               0.53859725722361015};

inline void next_point(double (&at)[kAxes]) {
    for (int a = 0; a < kAxes; ++a) {
        at[a] += kQuasirandomStep[a];
        if (at[a] >= 1) at[a] -= 1;
    }
}

}  // namespace hord::sim
