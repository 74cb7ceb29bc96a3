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
    const LensletLight light(scene);

    share_out_rows(e.n, options, [&](int n) {
        double bins[algo::kMaxBins * algo::kMaxBins];
        for (int m = 0; m < e.m; ++m) {
            light.collect(m, n, bins);
            for (int j = 0; j < e.j; ++j) {
                const auto row = static_cast<std::size_t>(n * e.j + j) * static_cast<std::size_t>(e.m) + static_cast<std::size_t>(m);
                std::transform(bins + j * e.i, bins + (j + 1) * e.i, field.bins.data() + row * static_cast<std::size_t>(e.i),
                               [](double value) { return static_cast<float>(value); });
            }
        }
    });
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
