#include "calib/calibrate/frame_regions.h"

#include <cmath>

namespace hord::calib {

using algo::LensletGrid;
using algo::PixelPoint;

namespace {

// Of a pitch: a lenslet that is off by less says nothing against the grid, as place_displaced() has it. In the corners
// of strong distortion, lenslets are squeezed, and their centres are off by some thousandths of a pitch.
constexpr double kMinOff = 0.002;

}  // namespace

std::vector<RegionCount> count_regions(const GridCalibration& calibration) {
    const Regions regions(calibration);
    const LensletGrid& grid = calibration.fit.grid;
    std::vector<RegionCount> counts(regions.count());
    for (std::size_t k = 0; k < counts.size(); ++k) counts[k].region = k;
    for (const Observation& seen : calibration.observations) {
        RegionCount& count = counts[regions.at(seen.centre_px.x_px, seen.centre_px.y_px)];
        ++count.measured;
        if (seen.used || seen.displaced || seen.beside_missing) continue;
        const PixelPoint at = grid.at(grid.uv(seen.m, seen.n));
        const double off = std::hypot(seen.centre_px.x_px - at.x_px, seen.centre_px.y_px - at.y_px);
        if (off > kMinOff * calibration.pitch_px) ++count.rejected;
    }
    for (const PixelPoint& at : calibration.missing_px) ++counts[regions.at(at.x_px, at.y_px)].missing;
    return counts;
}

}  // namespace hord::calib
