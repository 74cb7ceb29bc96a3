#include "hal_sim/optics/render.h"

#include <algorithm>
#include <atomic>
#include <thread>

#include "hal_sim/optics/lenslet_light.h"

namespace hord::sim {

Result<LightField> render(const Scene& scene, const RenderOptions& options) {
    if (const auto wrong = problems(scene); !wrong.empty()) {
        std::string all;
        for (const SceneProblem& problem : wrong) all += (all.empty() ? "" : "; ") + problem.message();
        return fail(ErrorCode::invalid_argument, "scene \"" + scene.name + "\": " + all, "correct the scene");
    }
    const algo::Extents& e = scene.camera.extents;
    LightField field{e, std::vector<float>(e.lenslets() * static_cast<std::size_t>(e.bins()))};
    const LensletLight light(scene);

    // Rows are independent of one another: whoever renders them, they come out the same.
    std::atomic<int> next_row = 0, rows_done = 0;
    const auto render_rows = [&](bool reports) {
        double bins[algo::kMaxBins * algo::kMaxBins];
        for (int n = next_row++; n < e.n; n = next_row++) {
            for (int m = 0; m < e.m; ++m) {
                light.collect(m, n, bins);
                for (int j = 0; j < e.j; ++j) {
                    float* out = field.bins.data() + (static_cast<std::size_t>(n * e.j + j) * static_cast<std::size_t>(e.m) + static_cast<std::size_t>(m)) *
                                                         static_cast<std::size_t>(e.i);
                    std::transform(bins + j * e.i, bins + (j + 1) * e.i, out, [](double value) { return static_cast<float>(value); });
                }
            }
            ++rows_done;
            if (reports && options.progress) options.progress(static_cast<double>(rows_done) / e.n);
        }
    };
    const int wanted = options.threads > 0 ? options.threads : static_cast<int>(std::thread::hardware_concurrency());
    {
        std::vector<std::jthread> helpers;
        for (int k = 1; k < std::clamp(wanted, 1, e.n); ++k) helpers.emplace_back(render_rows, false);
        render_rows(true);
    }
    if (options.progress) options.progress(1.0);
    return field;
}

}  // namespace hord::sim
