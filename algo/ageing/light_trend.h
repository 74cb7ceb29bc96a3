// Ageing of light and sensor, estimated from production frames: light output, dark level, and evenness of the field.
// Medians over a window of judged parts, smoothed over windows. How, and the errors: docs/notes/ageing.md.
//
// create() allocates all memory. For monitoring only: no part is judged by it. Not thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/inspection/pipeline.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::algo {

struct LightAge {
    double light = 1;              // relative to the baseline
    bool since_reference = false;  // the baseline is the reference; else the first window
    double dark_dn = 0;            // of the last window
    double dark_drift_dn = 0;      // since the first window
    // Change of the tile that changed most relative to the whole field, signed: -0.1 is a tenth darker.
    double uneven = 0;
    float uneven_m = 0, uneven_n = 0;  // its middle, lenslets
    std::int64_t parts = 0;            // since the start or restart()
};

class LightTrend {
  public:
    static constexpr int kMinWindow = 10, kMaxWindow = 1000;  // parts

    // Fails with invalid_argument for extents that check() refuses, or another window.
    static Result<LightTrend> create(const Extents& extents, int window);

    // Adds one part's macro-pixel frame and inspection. True if it completed a window and latest() is new. Ignores
    // unfit frames.
    bool add(const FrameView& frame, const Inspection& inspection);

    // None until the first window, which is the baseline.
    [[nodiscard]] const std::optional<LightAge>& latest() const { return latest_; }

    // Starts again (after a change of recipe).
    void restart();

  private:
    LightTrend(const Extents& extents, int window);
    [[nodiscard]] double dark_level(const FrameView& frame);
    [[nodiscard]] float typical_light(const Inspection& inspection);
    void add_tiles(const Inspection& inspection, float typical);
    void close_window();
    void find_uneven(LightAge& age);

    Extents extents_;
    int window_;
    int tiles_m_, tiles_n_;
    std::vector<int> dark_columns_, dark_rows_;  // sampled lenslets
    std::vector<int> light_columns_, light_rows_;
    std::vector<float> typical_;
    std::vector<std::uint16_t> dark_samples_;
    std::vector<float> light_, dark_;  // of the window's parts
    std::vector<float> tiles_;         // of the window: room for `window` values a tile,
    std::vector<int> tile_values_;     // of which the first so many are valid
    std::vector<double> tile_sums_;    // of this part
    std::vector<int> tile_counts_;
    std::vector<float> tile_base_, tile_age_;  // 0: unknown
    std::vector<float> ratios_;
    int in_window_ = 0;
    bool with_reference_ = false;
    std::optional<double> base_light_, base_dark_;
    std::int64_t parts_ = 0;
    std::optional<LightAge> latest_;
};

}  // namespace hord::algo
