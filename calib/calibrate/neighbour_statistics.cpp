#include "calib/calibrate/neighbour_statistics.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>
#include <vector>

#include "common/statistics.h"

namespace hord::calib {

using algo::LensletGrid;
using algo::PixelPoint;

namespace {

constexpr int kFewestFollowing = 100;  // residuals, for their dependence on the light

// The light of each lenslet of the grid, row by row; 0 where none is measured.
std::vector<double> light_of(const LensletGrid& grid, std::span<const Observation> observations) {
    std::vector<double> light(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
    for (const Observation& seen : observations) {
        if (grid.contains(seen.m, seen.n)) light[grid.index(seen.m, seen.n)] = seen.light_dn;
    }
    return light;
}

}  // namespace

double light_roughness(const LensletGrid& grid, std::span<const Observation> observations) {
    const std::vector<double> light = light_of(grid, observations);
    std::vector<double> differences;
    for (const Observation& seen : observations) {
        double sum = 0;
        int count = 0;
        for (const auto& [dm, dn] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
            if (!grid.contains(seen.m + dm, seen.n + dn) || light[grid.index(seen.m + dm, seen.n + dn)] <= 0) continue;
            sum += light[grid.index(seen.m + dm, seen.n + dn)];
            ++count;
        }
        if (count == 4) differences.push_back(std::abs(light[grid.index(seen.m, seen.n)] / (sum / 4) - 1));
    }
    // The median, over that of a normal distribution: dust and dead lenslets are few.
    return differences.empty() ? 0 : common::upper_median(std::span(differences)) / 0.6745;
}

LightFollowing light_following(const LensletGrid& grid, std::span<const Observation> observations) {
    const std::vector<double> light = light_of(grid, observations);
    double gg = 0, gr = 0, rr = 0;
    int count = 0;
    for (const Observation& seen : observations) {
        const auto at = [&](int dm, int dn) {
            const int m = seen.m + dm, n = seen.n + dn;
            return grid.contains(m, n) ? light[grid.index(m, n)] : 0.0;
        };
        const double left = at(-1, 0), right = at(1, 0), above = at(0, -1), below = at(0, 1);
        if (!(left > 0 && right > 0 && above > 0 && below > 0) || !(seen.used || seen.displaced)) continue;
        const LensletGrid::Uv uv = grid.uv(seen.m, seen.n);
        const LensletGrid::Steps steps = grid.steps_px(uv);
        const PixelPoint model = grid.at(uv);
        // Along the lattice's steps; rows that are staggered to and fro average out.
        for (const auto& [low, high, step] : {std::tuple{left, right, steps.along_u}, {above, below, steps.along_v}}) {
            const double length = std::hypot(step.x_px, step.y_px);
            const double off =
                ((seen.centre_px.x_px - model.x_px) * step.x_px + (seen.centre_px.y_px - model.y_px) * step.y_px) /
                length;
            const double gradient = (high - low) / (high + low);
            gg += gradient * gradient;
            gr += gradient * off;
            rr += off * off;
            ++count;
        }
    }
    if (count < kFewestFollowing || !(gg > 0) || !(rr > 0)) return {};
    return {gr * gr / (gg * rr), std::abs(gr) / std::sqrt(gg * count)};
}

SmoothResiduals smooth_residuals(const LensletGrid& grid, std::span<const Observation> observations) {
    struct Residual {
        double x = 0, y = 0;
        bool known = false;
    };
    std::vector<Residual> residuals(grid.index(0, grid.rows));
    for (const Observation& seen : observations) {
        if (!grid.contains(seen.m, seen.n) || !(seen.used || seen.displaced)) continue;
        const PixelPoint model = grid.at(grid.uv(seen.m, seen.n));  // without shifts of single lenslets
        residuals[grid.index(seen.m, seen.n)] = {seen.centre_px.x_px - model.x_px, seen.centre_px.y_px - model.y_px,
                                                 true};
    }
    double products = 0, squares = 0;
    int pairs = 0;
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const Residual& a = residuals[grid.index(m, n)];
            for (const auto& [dm, dn] : {std::pair{1, 0}, {0, 1}}) {
                if (!a.known || !grid.contains(m + dm, n + dn)) continue;
                const Residual& b = residuals[grid.index(m + dm, n + dn)];
                if (!b.known) continue;
                products += a.x * b.x + a.y * b.y;
                squares += (a.x * a.x + a.y * a.y + b.x * b.x + b.y * b.y) / 2;
                ++pairs;
            }
        }
    }
    if (pairs < kFewestFollowing || !(squares > 0)) return {};
    return {products / squares, std::sqrt(std::max(0.0, products) / pairs), pairs};
}

}  // namespace hord::calib
