#include "hal_sim/optics/camera/camera.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/optics/scene/exact_math.h"

namespace hord::sim {

CameraGeometry::CameraGeometry(const Scene& scene)
    : extents_(scene.camera.extents), array_(scene), pitch_mm_(scene.camera.field_mm / scene.camera.extents.m),
      bin_rad_(scene.camera.bin_pitch_rad), shift_x_(scene.pose.x_mm), shift_y_(scene.pose.y_mm) {
    exact::sin_cos(scene.pose.rotation_rad, sine_, cosine_);
    const MainLens& lens = scene.camera.main_lens;
    if (lens.focal_mm > 0) offset_a_mm_ = 1 / (lens.distance_mm - lens.focal_mm) / bin_rad_;
}

ArrayGeometry::Point CameraGeometry::reach_mm() const {
    if (array_.is_plain()) return {0.5 * extents_.m * pitch_mm_, 0.5 * extents_.n * pitch_mm_};
    ArrayGeometry::Point reach;
    for (const int m : {0, extents_.m - 1}) {
        for (const int n : {0, extents_.n - 1}) {
            const ArrayGeometry::Point at = array_.place_mm(m, n);
            reach.x = std::max(reach.x, std::abs(at.x)), reach.y = std::max(reach.y, std::abs(at.y));
        }
    }
    return {reach.x + pitch_mm_, reach.y + pitch_mm_};
}

}  // namespace hord::sim
