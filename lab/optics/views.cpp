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

}  // namespace hord::lab
