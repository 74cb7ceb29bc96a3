#include "calib/calibrate/blemished_lenslets.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr int kNear = 2;            // columns and rows
constexpr std::size_t kFewest = 5;  // neighbours to compare with
constexpr double kDeviations = 5;   // as for outliers of the fit
constexpr double kNormal = 0.6745;  // median deviation of a normal distribution, over its standard deviation

bool stands_out(double own, std::vector<double>& near, double matters) {
    if (near.size() < kFewest) return false;
    std::ranges::nth_element(near, near.end() - 2, std::less<>());
    if (!(own > near[near.size() - 2] + matters)) return false;
    // Shares are squares of differences, whose tails are long: the differences themselves are nearly normal.
    own = std::sqrt(own);
    for (double& one : near) one = std::sqrt(one);
    const double median = common::upper_median(std::span(near));
    for (double& one : near) one = std::abs(one - median);
    return own > median + kDeviations / kNormal * common::upper_median(std::span(near));
}

}  // namespace

void mark_blemished(std::span<Observation> observations,
                    const std::function<std::optional<Unlike>(const Observation&)>& unlike, double matters,
                    GridFit& fit) {
    algo::LensletGrid& grid = fit.grid;
    struct Known {
        const Observation* seen = nullptr;
        bool measured = false;
        std::optional<Unlike> unlike = {};
    };
    std::vector<Known> lenslets(grid.index(0, grid.rows));
    for (const Observation& seen : observations) {
        if (grid.contains(seen.m, seen.n)) lenslets[grid.index(seen.m, seen.n)].seen = &seen;
    }
    const auto unlike_of = [&](int m, int n) {
        Known& of = lenslets[grid.index(m, n)];
        if (of.seen != nullptr && !of.measured) of.unlike = unlike(*of.seen);
        of.measured = true;
        return of.unlike;
    };
    const bool all = !grid.shifts_px.empty();
    for (Observation& seen : observations) {
        if ((seen.used && !all) || !grid.contains(seen.m, seen.n)) continue;
        const auto own = unlike_of(seen.m, seen.n);
        std::vector<double> profile, turned, light;
        for (int n = std::max(0, seen.n - kNear); n <= std::min(grid.rows - 1, seen.n + kNear); ++n) {
            for (int m = std::max(0, seen.m - kNear); m <= std::min(grid.columns - 1, seen.m + kNear); ++m) {
                if (m == seen.m && n == seen.n) continue;
                const auto of = unlike_of(m, n);
                if (!of) continue;
                profile.push_back(of->profile);
                turned.push_back(of->turned);
                light.push_back(lenslets[grid.index(m, n)].seen->light_dn);
            }
        }
        if (!own || light.empty()) continue;
        // Noise has a larger share of the power of a dim lenslet: that of reading by the square of its light.
        const double dim = std::min(1.0, seen.light_dn / common::upper_median(std::span(light)));
        if (!stands_out(dim * dim * own->profile, profile, matters) &&
            !stands_out(dim * dim * own->turned, turned, matters))
            continue;
        seen.blemished = true;
        if (!seen.used) continue;
        seen.used = false;
        --fit.used;
        ++fit.rejected;
        grid.shifts_px[grid.index(seen.m, seen.n)] = {};
    }
}

}  // namespace hord::calib
