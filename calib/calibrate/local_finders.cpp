#include "calib/calibrate/local_finders.h"

#include <algorithm>
#include <cmath>

namespace hord::calib {

using algo::LensletGrid;

const LocalFinders::Local& LocalFinders::nearest(double scale) const {
    return *std::min_element(finders_.begin(), finders_.end(), [&](const Local& a, const Local& b) {
        return std::abs(a.scale - scale) < std::abs(b.scale - scale);
    });
}

const CentreFinder& finder_for(const LocalFinders& finders, const LensletGrid& grid, double pitch, int m, int n) {
    if (finders.count() == 1) return finders.middle();
    return finders.at(grid.steps_px(grid.uv(m, n)).mean_px() / pitch);
}

}  // namespace hord::calib
