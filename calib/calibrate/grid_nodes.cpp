// A file of its own, so that readers of calibration files do not link Ceres.
#include "calib/calibrate/calibrate_grid.h"

namespace hord::calib {

using algo::LensletGrid;
using algo::PixelPoint;

std::vector<GridCalibration::Node> GridCalibration::nodes() const {
    const LensletGrid& grid = fit.grid;
    std::vector<bool> measured(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
    for (const Observation& seen : observations) {
        if (grid.contains(seen.m, seen.n)) measured[grid.index(seen.m, seen.n)] = seen.used || seen.displaced;
    }
    std::vector<Node> out;
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const PixelPoint p = grid.centre_px(m, n);
            if (grid.in_frame(p)) out.push_back({m, n, p, measured[grid.index(m, n)]});
        }
    }
    return out;
}

}  // namespace hord::calib
