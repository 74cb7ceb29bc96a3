#include "hal_sim/optics/camera/render.h"

#include "hal_sim/optics/camera/lenslet_light.h"
#include "hal_sim/optics/camera/render_rows.h"

namespace hord::sim {

Result<void> check_scene(const Scene& scene) {
    const auto wrong = problems(scene);
    if (wrong.empty()) return {};
    std::string all;
    for (const SceneProblem& problem : wrong) all += (all.empty() ? "" : "; ") + problem.message();
    return fail(ErrorCode::invalid_argument, "scene \"" + scene.name + "\": " + all, "correct the scene");
}

Result<LightField> render(const Scene& scene, const RenderOptions& options) {
    if (auto good = check_scene(scene); !good) return tl::unexpected(good.error());
    const algo::Extents& e = scene.camera.extents;
    LightField field{e, std::vector<float>(e.lenslets() * static_cast<std::size_t>(e.bins()))};
    const CameraGeometry camera(scene);
    // Only in an aligned square array do a lenslet's bins continue in those of its neighbours.
    const int around = scene.effects.crosstalk && camera.array().is_plain() && e.i == e.j ? 1 : 0;
    const SlopeGrid grid = SlopeGrid::of(e, around);
    const LensletLight light(scene, grid);
    Strays strays(e.n);

    share_out_rows(e.n, options, [&](int n) {
        std::vector<double> cells(static_cast<std::size_t>(grid.cells()));
        for (int m = 0; m < e.m; ++m) {
            if (camera.array().is_dead(m, n)) continue;
            light.collect(camera.place_of(m, n), grid, grid.box(), cells.data());
            for (int l = 0; l < grid.j; ++l) {
                for (int k = 0; k < grid.i; ++k) {
                    const auto value = static_cast<float>(cells[static_cast<std::size_t>(l * grid.i + k)]);
                    const int to_m = m + k / e.i - around, to_n = n + l / e.j - around;
                    if (to_m < 0 || to_m >= e.m || to_n < 0 || to_n >= e.n) continue;
                    const std::size_t sample = sample_index(e.width_px(), to_m * e.i + k % e.i, to_n * e.j + l % e.j);
                    if (to_m == m && to_n == n) field.bins[sample] = value;
                    else if (value > 0) strays.add(n, sample, value);
                }
            }
        }
    });
    strays.pour(field.bins);
    return field;
}

}  // namespace hord::sim
