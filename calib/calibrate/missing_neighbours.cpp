#include "calib/calibrate/missing_neighbours.h"

#include <cmath>
#include <vector>

#include "common/statistics.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

// Of a step: neighbours are one away; those across a square lattice's cells 1.41, of a hexagonal lattice 1.73.
constexpr double kNear = 1.25;
constexpr double kMinWay = 0.5;  // of the summed ways: missing neighbours that lie opposite to each other move nothing

// The sum of the ways to the missing ones among a lenslet's neighbours, each of length 1.
PixelPoint way_to_missing(const LensletGrid& grid, const Observation& seen,
                          const std::function<bool(int m, int n)>& missing) {
    const LensletGrid::Uv uv = grid.uv(seen.m, seen.n);
    const PixelPoint here = grid.at(uv);
    const double near_px = kNear * grid.steps_px(uv).mean_px();
    PixelPoint sum;
    for (int n = seen.n - 1; n <= seen.n + 1; ++n) {
        for (int m = seen.m - 1; m <= seen.m + 1; ++m) {
            if ((m == seen.m && n == seen.n) || !grid.contains(m, n) || !missing(m, n)) continue;
            const PixelPoint there = grid.at(grid.uv(m, n));
            const double x = there.x_px - here.x_px, y = there.y_px - here.y_px, far = std::hypot(x, y);
            if (far > near_px) continue;
            sum.x_px += x / far;
            sum.y_px += y / far;
        }
    }
    return sum;
}

// How far a lenslet is off the grid, px for each missing neighbour: towards it, and across.
struct Moved {
    Observation* seen = nullptr;
    double along_px = 0, across_px = 0;
};

}  // namespace

int mark_beside_missing(const LensletGrid& grid, std::span<Observation> observations,
                        const std::function<bool(int m, int n)>& missing) {
    std::vector<Moved> beside;
    std::vector<double> along;
    for (Observation& seen : observations) {
        if (!grid.contains(seen.m, seen.n)) continue;
        const PixelPoint way = way_to_missing(grid, seen, missing);
        const double square = way.x_px * way.x_px + way.y_px * way.y_px;
        if (!(square > kMinWay * kMinWay)) continue;
        const PixelPoint model = grid.at(grid.uv(seen.m, seen.n));
        const double x = seen.centre_px.x_px - model.x_px, y = seen.centre_px.y_px - model.y_px;
        beside.push_back({&seen, (x * way.x_px + y * way.y_px) / square, (x * way.y_px - y * way.x_px) / square});
        along.push_back(beside.back().along_px);
    }
    if (along.empty()) return 0;
    const double typical = common::upper_median(std::span(along));
    int count = 0;
    for (const Moved& of : beside) {
        if (of.seen->used || of.seen->displaced) continue;
        of.seen->beside_missing =
            std::abs(of.along_px - typical) <= std::abs(typical) && std::abs(of.across_px) <= std::abs(of.along_px);
        count += of.seen->beside_missing ? 1 : 0;
    }
    return count;
}

}  // namespace hord::calib
