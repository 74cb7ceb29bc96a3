#include "lab/optics/views.h"

#include <cmath>

#include "hal_sim/optics/camera/lenslet_light.h"
#include "hal_sim/optics/camera/render_rows.h"

namespace hord::lab {

using namespace sim;

Result<CameraPicture> render_raw(const Scene& scene, const RenderOptions& options) {
    if (auto good = check_scene(scene); !good) return tl::unexpected(good.error());
    const algo::Extents& e = scene.camera.extents;
    const CameraGeometry camera(scene);
    const ArrayGeometry& array = camera.array();
    CameraPicture picture{array.width_px(), array.height_px(), {}};
    picture.light.resize(static_cast<std::size_t>(picture.width_px) * static_cast<std::size_t>(picture.height_px));
    const SlopeBox range = SlopeGrid::of(e, scene.effects.crosstalk ? 1 : 0).box();
    // The pixel range of a lenslet, and the same pixels as cells of slope.
    const auto under = [&](int m, int n, int& x0, int& y0) -> SlopeGrid {
        const ArrayGeometry::Point centre = array.centre_px(m, n);
        const double bin = array.bin_px(m, n);
        x0 = static_cast<int>(std::floor(centre.x + range.u0 * bin + 0.5)),
        y0 = static_cast<int>(std::floor(centre.y + range.v0 * bin + 0.5));
        const int x1 = static_cast<int>(std::ceil(centre.x + range.u1 * bin + 0.5)),
                  y1 = static_cast<int>(std::ceil(centre.y + range.v1 * bin + 0.5));
        return {(x0 - 0.5 - centre.x) / bin, (y0 - 0.5 - centre.y) / bin, 1 / bin, x1 - x0, y1 - y0};
    };
    int x0 = 0, y0 = 0;
    SlopeGrid largest = under(e.m / 2, e.n / 2, x0, y0);
    for (const int m : {0, e.m - 1}) {
        for (const int n : {0, e.n - 1}) {
            const SlopeGrid corner = under(m, n, x0, y0);
            largest.i = std::max(largest.i, corner.i + 2), largest.j = std::max(largest.j, corner.j + 2);
        }
    }
    const LensletLight light(scene, largest);
    Strays strays(e.n);

    share_out_rows(e.n, options, [&](int n) {
        std::vector<double> cells;
        for (int m = 0; m < e.m; ++m) {
            if (array.is_dead(m, n)) continue;
            int left = 0, top = 0;
            const SlopeGrid grid = under(m, n, left, top);
            cells.resize(static_cast<std::size_t>(grid.cells()));
            light.collect(camera.place_of(m, n), grid, range, cells.data());
            const double full = 1 / (grid.step * grid.step);
            for (int l = 0; l < grid.j; ++l) {
                for (int k = 0; k < grid.i; ++k) {
                    const double value = cells[static_cast<std::size_t>(l * grid.i + k)];
                    const int x = left + k, y = top + l;
                    if (value > 0 && x >= 0 && x < picture.width_px && y >= 0 && y < picture.height_px) {
                        strays.add(n, sample_index(picture.width_px, x, y), static_cast<float>(value * full));
                    }
                }
            }
        }
    });
    strays.pour(picture.light);
    return picture;
}

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

}  // namespace hord::lab
