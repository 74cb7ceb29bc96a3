#include "hal_sim/optics/render.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "hal_sim/optics/lenslet_light.h"

namespace hord::sim {

namespace {

Result<void> check(const Scene& scene) {
    const auto wrong = problems(scene);
    if (wrong.empty()) return {};
    std::string all;
    for (const SceneProblem& problem : wrong) all += (all.empty() ? "" : "; ") + problem.message();
    return fail(ErrorCode::invalid_argument, "scene \"" + scene.name + "\": " + all, "correct the scene");
}

// Rows are independent of one another: whoever does them, they come out the same. Progress from the calling thread.
template <class DoRow>
void share_out_rows(int rows, const RenderOptions& options, const DoRow& do_row) {
    std::atomic<int> next_row = 0, rows_done = 0;
    const auto work = [&](bool reports) {
        for (int n = next_row++; n < rows; n = next_row++) {
            do_row(n);
            ++rows_done;
            if (reports && options.progress) options.progress(static_cast<double>(rows_done) / rows);
        }
    };
    const int wanted = options.threads > 0 ? options.threads : static_cast<int>(std::thread::hardware_concurrency());
    {
        std::vector<std::jthread> helpers;
        for (int k = 1; k < std::clamp(wanted, 1, rows); ++k) helpers.emplace_back(work, false);
        work(true);
    }
    if (options.progress) options.progress(1.0);
}

}  // namespace

Result<LightField> render(const Scene& scene, const RenderOptions& options) {
    if (auto good = check(scene); !good) return tl::unexpected(good.error());
    const algo::Extents& e = scene.camera.extents;
    LightField field{e, std::vector<float>(e.lenslets() * static_cast<std::size_t>(e.bins()))};
    const int around = scene.effects.crosstalk ? 1 : 0;
    const SlopeGrid grid = SlopeGrid::of(e, around);
    const LensletLight light(scene, grid);
    const CameraGeometry camera(scene);
    const auto sample = [&](int m, int n, int i, int j) -> float& {
        return field.bins[static_cast<std::size_t>(n * e.j + j) * static_cast<std::size_t>(e.width_px()) + static_cast<std::size_t>(m * e.i + i)];
    };
    // Light for other lenslets waits until all rows are done, and is added in their order: sums do not depend on threads.
    struct Stray {
        int m, n, i, j;
        float light;
    };
    std::vector<std::vector<Stray>> strays(around > 0 ? static_cast<std::size_t>(e.n) : 0);

    share_out_rows(e.n, options, [&](int n) {
        std::vector<double> cells(static_cast<std::size_t>(grid.cells()));
        for (int m = 0; m < e.m; ++m) {
            light.collect(camera.place_of(m, n), grid, cells.data());
            for (int l = 0; l < grid.j; ++l) {
                for (int k = 0; k < grid.i; ++k) {
                    const auto value = static_cast<float>(cells[static_cast<std::size_t>(l * grid.i + k)]);
                    // A lenslet's range is as wide as a lenslet: beyond it lie the neighbours'.
                    const int to_m = m + k / e.i - around, to_n = n + l / e.j - around;
                    if (to_m == m && to_n == n) sample(m, n, k % e.i, l % e.j) = value;
                    else if (value > 0 && to_m >= 0 && to_m < e.m && to_n >= 0 && to_n < e.n) strays[static_cast<std::size_t>(n)].push_back({to_m, to_n, k % e.i, l % e.j, value});
                }
            }
        }
    });
    for (const auto& row : strays) {
        for (const Stray& stray : row) sample(stray.m, stray.n, stray.i, stray.j) += stray.light;
    }
    return field;
}

Result<Picture> render_telecentric(const Scene& scene, const RenderOptions& options) {
    if (auto good = check(scene); !good) return tl::unexpected(good.error());
    const TelecentricCamera& camera = scene.telecentric;
    const CameraGeometry geometry(scene);
    const Body body = body_of(scene, true);
    Picture picture{camera.width_px, camera.height_px, {}};
    picture.light.resize(static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px));
    const double pixel = camera.field_mm / camera.width_px;
    const int side = camera.rays_per_side;
    share_out_rows(camera.height_px, options, [&](int row) {
        for (int column = 0; column < camera.width_px; ++column) {
            double light = 0;
            for (int k = 0; k < side * side; ++k) {
                const double x = (column + (k % side + 0.5) / side - 0.5 * camera.width_px) * pixel;
                const double y = (row + (k / side + 0.5) / side - 0.5 * camera.height_px) * pixel;
                const Arrival from = trace(body, geometry.to_part(x, y, 0, 0));
                if (!(from.weight > 0)) continue;
                // The panel stands in the camera's frame; its centre is on the axis.
                double at_x = 0, at_y = 0;
                geometry.position_to_camera(from.x - from.u * camera.panel_distance_mm, from.y - from.v * camera.panel_distance_mm, at_x, at_y);
                if (std::abs(at_x) <= camera.panel_half_mm && std::abs(at_y) <= camera.panel_half_mm) light += from.weight;
            }
            picture.light[static_cast<std::size_t>(row) * static_cast<std::size_t>(camera.width_px) + static_cast<std::size_t>(column)] =
                static_cast<float>(light / (side * side));
        }
    });
    return picture;
}

}  // namespace hord::sim
