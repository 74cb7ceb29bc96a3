// Dust on the optics, told from defects of the parts: a place of the sensor that responds in part after part.
//
// In every part that could be judged a lenslet responds when
//   - without a reference: its light (Inspection::sums) is below kDip of what its neighbours at `reach` lenslets (4;
//   less in small fields) to the left and
//     right, or above and below, have on average: the lesser of the two, so that a slope of the light, or a line, is no
//     response;
//   - with a reference: it differs from the reference by kNotable standard deviations or more (Inspection::z_score);
//   - or it lies in a defect that was found (the disc of its area about its centre; not in one of more than 1/64 of the
//   field).
// Lenslets outside the part, at its rim, outside the recipe's zones, or saturated are not looked at in that part.
//
// After a window of parts a lenslet is a speck's when it was looked at in half of them or more, responded in a share of
// these of at least kShare (to stay one: kShareToStay), and in more than chance explains. Chance: in n parts that are
// independent of each other the lenslet responds each time with probability p, the larger of the whole field's rate in
// this window and that of the tile of 16 x 16 lenslets or a little more that it lies in (a place where flaws are
// frequent). The probability of a share s > p or more is at most exp(-n D), D = s ln(s/p) + (1-s) ln((1-s)/(1-p))
// (Chernoff's bound on the binomial tail); it must not exceed kFalseAlarms over the number of lenslets. So a window of
// parts whose flaws lie anywhere raises a false alarm with a probability of at most kFalseAlarms, one in a million
// windows, whatever the number of lenslets; lenslets of one part need not be independent of each other. Share and bound
// together decide: at a rate of 1 % a window of 100 parts has D n = 161 at the share of a half, where ln(308,000 /
// kFalseAlarms) = 26 is asked.
//
// A speck that makes its lenslets respond in most parts is found within two windows of its coming: that is one that
// takes a sixth of a lenslet's light from 500 electrons a lenslet on (noise of the comparison 4.5 %: it responds in
// about 9 parts of 10). Up to 2 x reach lenslets wide it responds as a whole; a wider one at its edges, and it is seen
// as uneven light (algo/ageing/light_trend.h). Dust far from the lenslets and from the part's image (in the focal
// plane, on the lenses) is spread over many lenslets: it takes a little light of all, and is not found here.
//
// The same flaw at the same place in every part looks the same while all parts lie alike. With a reference the parts'
// poses are known. A round flaw of radius r that moves with them, normally with standard deviation s along each axis,
// covers the lenslet in its middle in q = 1 - exp(-r^2 / 2 s^2) of the parts, and half of the parts or more up to the
// distance e where r is the median of Rice's distribution: r^2 <= e^2 + 2 ln(2) s^2, so e >= s sqrt(-2 ln(1 - q) - 2 ln
// 2). A speck that responds so often and is smaller than that (q at the lower end of two standard deviations, 1 - 3/n
// at most; e less half a lenslet) is none: Speck::tells_apart. One that responds in all of 100 parts is told apart up
// to a radius of 2.4 s - 0.5 lenslets.
//
// All memory is taken by create(): ten bytes a lenslet and some. Not thread-safe.
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
    float share = 0;           // of the parts, where it responds most
    bool tells_apart = false;  // the parts moved and it did not: no flaw of theirs
};

struct DustFound {
    static constexpr std::size_t kListed = 8;
    std::uint32_t specks = 0;
    std::array<Speck, kListed> largest{};  // most lenslets first; those of a place alike: the upper, left one
    std::int64_t parts = 0;                // seen until then
    std::optional<double> pose_spread;     // of the window's parts, lenslets: the smaller of both axes' standard
                                           // deviations; none without a reference
};

class DustEstimator {
  public:
    static constexpr int kMinWindow = 25, kMaxWindow = 1000;  // parts
    static constexpr float kDip = 0.9F, kNotable = 3.0F;
    static constexpr double kShare = 0.5, kShareToStay = 0.3, kFalseAlarms = 1e-6;

    // Fails with invalid_argument for extents that check() refuses, or another window.
    static Result<DustEstimator> create(const Extents& extents, int window);

    // One part's inspection. True when a window was completed and latest() is new.
    bool add(const Inspection& inspection);

    [[nodiscard]] const std::optional<DustFound>& latest() const { return latest_; }
    void restart();

    [[nodiscard]] int reach() const { return reach_; }

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
    [[nodiscard]] Speck gather(std::size_t seed);  // of latest_
    void list(const Speck& speck);

    Extents extents_;
    int window_, reach_, tiles_m_, tiles_n_;
    std::vector<std::uint8_t> now_;  // this part: what is known of a lenslet, see dust.cpp
    std::vector<std::uint16_t> looked_at_, responded_;
    std::vector<std::uint8_t> speck_;  // of the last window, then of this one
    std::vector<std::uint32_t> queue_;
    std::vector<std::uint32_t> tile_looked_at_, tile_responded_;
    double rate_ = 0;  // of the whole field in this window
    double evidence_;  // that is asked: ln(lenslets / kFalseAlarms)
    int in_window_ = 0, posed_ = 0;
    double x_ = 0, y_ = 0, xx_ = 0, yy_ = 0;  // poses of the window, from the first
    std::optional<Pose> first_pose_;
    std::int64_t parts_ = 0;
    std::optional<DustFound> latest_;
};

}  // namespace hord::algo
