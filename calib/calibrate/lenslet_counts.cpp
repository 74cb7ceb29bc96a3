#include "calib/calibrate/lenslet_counts.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <optional>

#include "calib/calibrate/blemished_lenslets.h"
#include "calib/calibrate/missing_neighbours.h"
#include "calib/lattice/centre_weights.h"
#include "calib/lattice/lenslet_coverage.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

// Of a pitch: a blemish that can move a centre by less does not matter, as displacements do not (place_displaced).
constexpr double kMinByBlemish = 0.002;
constexpr double kHotPixel = 1.5;  // px: between one and two pixels
constexpr std::size_t kSplitCentres = 1500, kFewestSplit = 250;
constexpr double kSplitPixels = 400'000;  // of all their windows together, to limit the time

}  // namespace

void measure_more(const WhiteImage& image, const LocalFinders& finders, const LensletGrid& grid, double pitch,
                  GridCalibration& out) {
    const CentreFinder& finder = finders.middle();
    const double window_px = std::numbers::pi * finder.window_radius_px() * finder.window_radius_px();
    if (image.any_saturated()) {
        // A lenslet that light fills is saturated in more than one pixel: one alone is hot.
        const double least = finder.weights().plateau ? kHotPixel / window_px : 0;
        out.saturated = static_cast<int>(
            std::count_if(out.observations.begin(), out.observations.end(),
                          [&](const Observation& seen) { return finder.saturated_share(seen.centre_px) > least; }));
    }
    const std::size_t split =
        std::clamp(static_cast<std::size_t>(kSplitPixels / window_px), kFewestSplit, kSplitCentres);
    const std::size_t every = std::max<std::size_t>(1, out.observations.size() / split);
    for (std::size_t k = 0; k < out.observations.size(); k += every)
        out.observations[k].split_px = finder_for(finders, grid, pitch, out.observations[k].m, out.observations[k].n)
                                           .split(out.observations[k].centre_px);
}

std::vector<double> light_noise(const LocalFinders& finders, double pitch, const GridCalibration& of) {
    std::vector<double> out;
    for (const Observation& seen : of.observations) {
        if (!seen.used || !seen.split_px) continue;
        const auto noise = finder_for(finders, of.fit.grid, pitch, seen.m, seen.n).light_noise(seen.centre_px);
        if (noise) out.push_back(*noise);
    }
    return out;
}

void count_lenslets(const LocalFinders& finders, double pitch, GridCalibration& out) {
    const LensletGrid& grid = out.fit.grid;
    std::vector<std::uint8_t> measured(grid.index(0, grid.rows)), missing(measured);
    for (const Observation& seen : out.observations) {
        if (grid.contains(seen.m, seen.n)) measured[grid.index(seen.m, seen.n)] = 1;
    }
    for (const GridCalibration::Node& node : out.nodes()) {
        ++out.inside;
        if (!finder_for(finders, grid, pitch, node.m, node.n).complete(node.centre_px)) continue;
        ++out.complete;
        if (measured[grid.index(node.m, node.n)] != 0) continue;
        out.missing_px.push_back(node.centre_px);
        missing[grid.index(node.m, node.n)] = 1;
    }
    out.beside_missing =
        mark_beside_missing(grid, out.observations, [&](int m, int n) { return missing[grid.index(m, n)] != 0; });
    out.found = static_cast<int>(out.observations.size());
    out.missing = static_cast<int>(out.missing_px.size());
    out.displaced = out.fit.displaced;
    out.rejected = out.fit.rejected;
}

void place_and_count(const LocalFinders& finders, double pitch, GridCalibration& out) {
    const CentreFinder& finder = finders.middle();
    const LensletGrid& grid = out.fit.grid;
    for (Observation& seen : out.observations) {
        if (!seen.used && !seen.split_px)
            seen.split_px = finder_for(finders, grid, pitch, seen.m, seen.n).split(seen.centre_px);
    }
    const std::vector<std::uint8_t> whole = lenslet_coverage(
        grid, out.observations,
        [&](int m, int n) { return finder_for(finders, grid, pitch, m, n).complete(grid.centre_px(m, n)); },
        [&](PixelPoint at) { return finder.amplitude_dn(at); }, finder.typical_amplitude_dn());
    const double shift_px = kMinByBlemish * pitch, least_unlike = shift_px * shift_px * finder.unlike_by_shift_px2();
    // At the edge of the light, lenslets differ in shape without dust on them.
    mark_blemished(
        out.observations,
        [&](const Observation& seen) -> std::optional<Unlike> {
            if (whole[grid.index(seen.m, seen.n)] == 0) return std::nullopt;
            return finder_for(finders, grid, pitch, seen.m, seen.n).unlike(seen.centre_px);
        },
        least_unlike, out.fit);
    out.blemished = static_cast<int>(std::ranges::count_if(out.observations, &Observation::blemished));
    place_displaced(out.observations, whole, out.fit);
    out.whole = static_cast<int>(std::count(whole.begin(), whole.end(), 1));
    for (const Observation& seen : out.observations) {
        if (!grid.contains(seen.m, seen.n) || whole[grid.index(seen.m, seen.n)] == 0) continue;
        ++out.whole_found;
        if (seen.used || seen.displaced) ++out.whole_placed;
    }
}

}  // namespace hord::calib
