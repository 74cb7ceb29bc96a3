#include "hal_sim/optics/camera.h"

#include "hal_sim/optics/exact_math.h"

namespace hord::sim {

CameraGeometry::CameraGeometry(const Scene& scene)
    : extents_(scene.camera.extents),
      pitch_mm_(scene.camera.field_mm / scene.camera.extents.m),
      bin_rad_(scene.camera.bin_pitch_rad),
      shift_x_(scene.pose.x_mm),
      shift_y_(scene.pose.y_mm) {
    exact::sin_cos(scene.pose.rotation_rad, sine_, cosine_);
}

}  // namespace hord::sim
