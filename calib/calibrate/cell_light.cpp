#include "calib/calibrate/cell_light.h"

#include <cmath>

namespace hord::calib {

std::optional<CellLight> light_about(const WhiteImage& image, algo::PixelPoint centre,
                                     const algo::LensletGrid::Steps& steps) {
    CellLight out;
    for (Eigen::Index row = 0; row < kCells; ++row) {
        for (Eigen::Index column = 0; column < kCells; ++column) {
            const double u = place_of(column), v = place_of(row);
            const double x = centre.x_px + u * steps.along_u.x_px + v * steps.along_v.x_px;
            const double y = centre.y_px + u * steps.along_u.y_px + v * steps.along_v.y_px;
            const int left = static_cast<int>(std::floor(x)), top = static_cast<int>(std::floor(y));
            if (left < 0 || top < 0 || left + 1 >= image.width_px() || top + 1 >= image.height_px()) return {};
            const double right = x - left, below = y - top;
            out(row, column) = (image.at(left, top) * (1 - right) + image.at(left + 1, top) * right) * (1 - below) +
                (image.at(left, top + 1) * (1 - right) + image.at(left + 1, top + 1) * right) * below;
        }
    }
    return out;
}

}  // namespace hord::calib
