// Dust on the optics, found from the inspections of many parts: a place of the sensor that responds in part after part.
//
// In a judged part a lenslet responds if it is darker than its neighbours (kDip), differs from the reference
// (kNotable), or lies in a defect. Lenslets outside the part, at its rim, outside the recipe's zones, or saturated are
// not checked in that part. Lenslets that respond in most parts of a window, and more often than chance explains, are
// specks. The probability of a false alarm is at most kFalseAlarms a window. Exact rules: docs/notes/ageing.md.
//
// create() allocates all memory, about ten bytes a lenslet. Not thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/inspection/pipeline.h"
#include "common/result.h"

namespace hord::algo {

struct Speck {
    float m = 0, n = 0;  // centre, lenslets
    std::uint32_t lenslets = 0;
    float share = 0;           // largest share of parts in which one of its lenslets responds
    bool tells_apart = false;  // the parts moved and the speck did not: it is not a flaw of the parts
};

struct DustFound {
    static constexpr std::size_t kListed = 8;
    std::uint32_t specks = 0;
    std::array<Speck, kListed> largest{};  // most lenslets first; of equal ones the upper, left one
    std::int64_t parts = 0;                // since the start or restart()
    // Standard deviation of the poses in the window, lenslets, the smaller of both axes; none without a reference.
    std::optional<double> pose_spread;
};

class DustEstimator {
  public:
    static constexpr int kMinWindow = 25, kMaxWindow = 1000;  // parts
    static constexpr float kDip = 0.9F, kNotable = 3.0F;
    static constexpr double kShare = 0.5, kShareToStay = 0.3, kFalseAlarms = 1e-6;

    // Fails with invalid_argument for extents that check() refuses, or another window.
    static Result<DustEstimator> create(const Extents& extents, int window);

    // Adds one part's inspection. True if it completed a window and latest() is new. Ignores unfit frames.
    bool add(const Inspection& inspection);

    [[nodiscard]] const std::optional<DustFound>& latest() const { return latest_; }
    void restart();

  private:
    DustEstimator(const Extents& extents, int window);
    void mark_dips(const Inspection& inspection);
    void mark_defects(const Inspection& inspection);
    void close_window();
    [[nodiscard]] std::size_t tile_of(int m, int n) const {
        return static_cast<std::size_t>(n * tiles_n_ / extents_.n * tiles_m_ + m * tiles_m_ / extents_.m);
    }
    void count_tiles();
    [[nodiscard]] bool is_speck(std::size_t lenslet, std::size_t tile) const;
    [[nodiscard]] Speck grow_speck(std::uint32_t seed);
    void list(const Speck& speck);

    Extents extents_;
    int window_, reach_, tiles_m_, tiles_n_;
    std::vector<std::uint8_t> now_;  // state of each lenslet in this part, see dust.cpp
    std::vector<std::uint16_t> checked_, responded_;
    std::vector<std::uint8_t> speck_;  // of the last window, then of this one
    std::vector<std::uint32_t> queue_;
    std::vector<std::uint32_t> tile_checked_, tile_responded_;
    double rate_ = 0;  // of the whole field in this window
    double evidence_;  // required: ln(lenslets / kFalseAlarms)
    int in_window_ = 0, posed_ = 0;
    double x_ = 0, y_ = 0, xx_ = 0, yy_ = 0;  // poses of the window, from the first
    std::optional<Pose> first_pose_;
    std::int64_t parts_ = 0;
    std::optional<DustFound> latest_;
};

}  // namespace hord::algo
