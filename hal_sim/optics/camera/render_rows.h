// Shared by the cameras that are rendered row by row.
#pragma once

#include <algorithm>
#include <atomic>
#include <thread>
#include <utility>
#include <vector>

#include "hal_sim/optics/camera/render.h"

namespace hord::sim {

// Fails with invalid_argument, naming every problem, when the scene cannot be rendered.
Result<void> check_scene(const Scene& scene);

// Renders rows on several threads. Rows are independent, so the result does not depend on the threads. The calling
// thread reports progress.
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

// Light for the samples of other rows is added after all rows are done, in their order, so that sums do not depend on
// the threads.
class Strays {
  public:
    explicit Strays(int rows) : rows_(static_cast<std::size_t>(rows)) {}
    void add(int row, std::size_t sample, float light) {
        rows_[static_cast<std::size_t>(row)].push_back({sample, light});
    }
    void pour(std::vector<float>& into) const {
        for (const auto& row : rows_) {
            for (const auto& [sample, light] : row) into[sample] += light;
        }
    }

  private:
    std::vector<std::vector<std::pair<std::size_t, float>>> rows_;
};

inline std::size_t sample_index(int width, int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
}

}  // namespace hord::sim
