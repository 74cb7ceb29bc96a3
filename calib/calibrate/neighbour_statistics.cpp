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

// By the median, over that of a normal distribution: dust and dead lenslets are few.
double robust_rms(std::vector<double>& of) {
    if (of.empty()) return 0;
    for (double& value : of) value = std::abs(value);
    return common::upper_median(std::span(of)) / 0.6745;
}

}  // namespace

double light_roughness(const LensletGrid& grid, std::span<const Observation> observations,
                       std::vector<double> light_noise) {
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
        if (count == 4) differences.push_back(light[grid.index(seen.m, seen.n)] / (sum / 4) - 1);
    }
    // The halves of squares differ alike: one of them has the corners.
    const double alike = light_noise.empty() ? 0 : common::upper_median(std::span(light_noise));
    for (double& value : light_noise) value -= alike;
    const double all = robust_rms(differences), noise = robust_rms(light_noise);
    // The noise of a lenslet and that of the mean of four.
    return std::sqrt(std::max(0.0, all * all - 1.25 * noise * noise));
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
    return {gr * gr / (gg * rr), std::abs(gr) / std::sqrt(gg * count), gr / gg};
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
