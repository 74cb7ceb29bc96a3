#include "hal_sim/optics/camera/telecentric.h"

#include <cmath>

#include "hal_sim/optics/camera/camera.h"
#include "hal_sim/optics/camera/render_rows.h"
#include "hal_sim/optics/trace/trace.h"

namespace hord::sim {

Result<CameraPicture> render_telecentric(const Scene& scene, const RenderOptions& options) {
    if (auto good = check_scene(scene); !good) return tl::unexpected(good.error());
    const TelecentricCamera& camera = scene.telecentric;
    const CameraGeometry geometry(scene);
    const Body body = body_of(scene, true);
    CameraPicture picture{camera.width_px, camera.height_px, {}};
    picture.light.resize(static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px));
    const double pixel = camera.field_mm / camera.width_px;
    const int side = camera.rays_per_side;
    const std::size_t rays_a_pixel = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
    share_out_rows(camera.height_px, options, [&](int row) {
        std::vector<CameraRay> rays(rays_a_pixel);
        std::vector<Arrival> arrivals(rays_a_pixel);
        for (int column = 0; column < camera.width_px; ++column) {
            for (int k = 0; k < side * side; ++k) {
                const double x = (column + (k % side + 0.5) / side - 0.5 * camera.width_px) * pixel;
                const double y = (row + (k / side + 0.5) / side - 0.5 * camera.height_px) * pixel;
                rays[static_cast<std::size_t>(k)] = geometry.to_part(x, y, 0, 0);
            }
            trace_many(body, rays, arrivals.data());
            double light = 0;
            for (const Arrival& from : arrivals) {
                if (!(from.weight > 0)) continue;
                // The panel stands in the camera's frame; its centre is on the axis.
                double at_x = 0, at_y = 0;
                geometry.position_to_camera(from.x - from.u * camera.panel_distance_mm,
                                            from.y - from.v * camera.panel_distance_mm, at_x, at_y);
                if (std::abs(at_x) <= camera.panel_half_mm && std::abs(at_y) <= camera.panel_half_mm)
                    light += from.weight;
            }
            picture.light[sample_index(camera.width_px, column, row)] = static_cast<float>(light / (side * side));
        }
    });
    return picture;
}

}  // namespace hord::sim
