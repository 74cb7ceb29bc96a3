#include "hal_sim/optics/camera/camera.h"

#include "hal_sim/optics/scene/exact_math.h"

namespace hord::sim {

CameraGeometry::CameraGeometry(const Scene& scene)
    : extents_(scene.camera.extents), array_(scene), pitch_mm_(scene.camera.field_mm / scene.camera.extents.m),
      bin_rad_(scene.camera.bin_pitch_rad), shift_x_(scene.pose.x_mm), shift_y_(scene.pose.y_mm) {
    exact::sin_cos(scene.pose.rotation_rad, sine_, cosine_);
    const MainLens& lens = scene.camera.main_lens;
    if (lens.focal_mm > 0) offset_a_mm_ = 1 / (lens.distance_mm - lens.focal_mm) / bin_rad_;
}

}  // namespace hord::sim
