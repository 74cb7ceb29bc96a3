// How light and sensor age, estimated from production frames: the light output, the dark level, and how evenly the
// field is lit.
//
// Of every part that could be judged three things are kept, and their medians over a window of parts, so that defects
// and single odd parts do not count:
//   light   the part's typical light, the median of 32 x 32 judged lenslets at most that have some, over that of the
//   first window; with a reference, over the reference's
//           (Registered::light), so that what faded before the start is seen, too
//   dark    the mean of the darkest quarter of the samples of 16 x 16 lenslets at most, DN: of bins that no light
//   reaches where it
//           reaches less than three quarters of them, as a spot among 5 x 5 bins or more does
//   flat    in tiles (8 x 8 over the field, of 3 x 3 lenslets at least) the mean of the judged lenslets that have
//   light, over the part's typical light;
//           each tile over its own of the first window, and that over the median of all tiles' ratios
// The medians of light and of every tile are smoothed over windows with weight 1/4: after a step of size s, s (1 -
// 0.75^k) is shown after k windows. What is dark is shown as it is.
//
// Error of one window's median: 1.25 s / sqrt(parts), where a part's own value varies by s: 0.6 % for parts whose light
// varies by 5 %, over 100. The dark level of a frame is the mean of at least some hundred samples; of whole numbers it
// cannot be told more finely than their noise allows (changes to 0.2 DN at a noise of 0.8 DN), and near 0, where the
// sensor cuts the noise off, its changes are shown smaller than they are. The recipe's dark level takes as much of
// every lit bin whatever its light, so that a loss of light is shown up to a tenth larger than it is (a spot of nine
// bins of 30 DN, 3 DN taken).
//
// All memory is taken by create(). Doubles: this watches the station, it judges no part. Not thread-safe.
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
    double light = 1;              // 1: as much as at first
    bool since_reference = false;  // `light` is over the reference's; else over the first window's
    double dark_dn = 0;            // now
    double dark_drift_dn = 0;      // since the first window
    double uneven = 0;  // of the tile that changed most against the whole field, signed: -0.1 is a tenth darker
    float uneven_m = 0, uneven_n = 0;  // its middle, lenslets
    std::int64_t parts = 0;            // seen until then
};

class LightTrend {
  public:
    static constexpr int kMinWindow = 10, kMaxWindow = 1000;  // parts

    // Fails with invalid_argument for extents that check() refuses, or another window.
    static Result<LightTrend> create(const Extents& extents, int window);

    // One part's macro-pixel frame and inspection. True when a window was completed and latest() is new. Parts that
    // could not be judged are not looked at.
    bool add(const FrameView& frame, const Inspection& inspection);

    // None until the first window, which is the baseline of what comes after it.
    [[nodiscard]] const std::optional<LightAge>& latest() const { return latest_; }

    // Forgets everything (another recipe).
    void restart();

  private:
    LightTrend(const Extents& extents, int window);
    [[nodiscard]] double dark_level(const FrameView& frame);
    [[nodiscard]] float typical_light(const Inspection& inspection);
    void add_tiles(const Inspection& inspection, float typical);
    void close_window();
    void look_at_tiles(LightAge& age);

    Extents extents_;
    int window_;
    int tiles_m_, tiles_n_;
    std::vector<int> dark_columns_, dark_rows_;  // sampled lenslets
    std::vector<int> light_columns_, light_rows_;
    std::vector<float> typical_;
    std::vector<std::uint16_t> dark_samples_;
    std::vector<float> light_, dark_;  // of the window's parts
    std::vector<float> tiles_;  // of the window: `window` values a tile, those of parts that were seen there first
    std::vector<int> tile_seen_;
    std::vector<double> tile_sums_;  // of this part
    std::vector<int> tile_counts_;
    std::vector<float> tile_base_, tile_age_;  // 0: not known
    std::vector<float> ratios_;
    int in_window_ = 0;
    bool with_reference_ = false;
    std::optional<double> base_light_, base_dark_;
    std::int64_t parts_ = 0;
    std::optional<LightAge> latest_;
};

}  // namespace hord::algo
