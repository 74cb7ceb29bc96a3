// Finds a part's pose from what its light and its mean deflection look like, to a small fraction of a lenslet.
//
// The pose minimises, over a regular sample of lenslets (40 x 40 at most) and three channels (the light over the part's
// typical light, the mean deflection along x and y), the squares of part minus reference, each over its noise (more
// where the reference's slope changes: what edges look like depends on where in a lenslet they lie), with weights 1 /
// (1 + (r/3)^2) that leave defects out: Gauss-Newton from the reference's own pose, the reference's maps read by cubic
// interpolation. Weak priors (1 lenslet, 0.02 rad) and one as strong as what the reference's own noise seems to say
// keep still what leaves no trace; the turn of a round part, where less than kTurnShare of the maps' changes would be
// seen in one, stays 0. The first step and the last ones look at the whole sample, those in between at a quarter of it.
// A step that turns back is half as long: where the reference's own lenslets are, the interpolated maps have kinks, and
// a part that lies just as the reference does would be sought on either side of one without end.
//
// A part cannot be registered when the steps do not settle, when it lies further away than kFarthestLenslets or
// kFarthestSine, or when more than kForeignShare of what is compared disagrees grossly: then it is not such a part.
//
// Maps are read in floats, all else is doubles, + - * / and square roots in a fixed order: the same bits everywhere.
// All memory is taken by the constructor.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"
#include "algo/reference/pose.h"

namespace hord::algo {

constexpr double kFarthestLenslets = 2.5, kFarthestSine = 0.06;  // 3.4 degrees
constexpr double kForeignShare = 0.4;

// The reference's maps, one value a lenslet. `mask`: kDark or kSaturated: no deflection; kOutside: nothing is known
// there.
struct ReferenceMaps {
    std::span<const float> light;  // DN
    std::span<const float> x, y;   // mean deflection, bin pitches
    std::span<const std::uint8_t> mask;
};

struct Registered {
    enum class Outcome : std::uint8_t { found, too_little, too_far, foreign, unsettled };
    Outcome outcome = Outcome::too_little;
    Pose pose;
    double light = 1;        // of the part's light over the reference's: the median over the sample
    double disagreeing = 0;  // share of the sample that disagrees grossly
    [[nodiscard]] bool found() const { return outcome == Outcome::found; }
};

// One sentence for people.
const char* explain(Registered::Outcome outcome);

class Registrar {
  public:
    explicit Registrar(const Extents& extents);

    // `electrons_per_dn`, and how many `parts` the reference is the mean of: for the noise. The part's values as the
    // pipeline has them: mask kDark, kSaturated.
    Registered find(const ReferenceMaps& reference, std::span<const Deflection> deflections,
                    std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, double electrons_per_dn,
                    std::uint32_t parts);

  private:
    struct Sampled {
        std::uint32_t k;
        double m, n;
    };
    Extents extents_;
    std::vector<Sampled> sample_;  // a quarter of it, evenly over the field, first
    std::size_t coarse_ = 0;       // so many
    std::vector<double> ratios_;
};

// The value of a map at a place, and its change by m and n, from the 4x4 lenslets around it; false where the place is
// outside or one of them has one of the mask's bits `without`.
struct MapAt {
    double value = 0, by_m = 0, by_n = 0;
    double deflection_shift = 0;  // how much its slope changes over a lenslet: 0 where it is even, large at edges
};
class CubicReader {
  public:
    CubicReader(const Extents& extents, std::span<const std::uint8_t> mask) : extents_(extents), mask_(mask) {}
    bool move_to(double m, double n);
    [[nodiscard]] std::uint8_t mask() const;  // all bits of the 4x4
    [[nodiscard]] MapAt read(std::span<const float> map) const;

  private:
    Extents extents_;
    std::span<const std::uint8_t> mask_;
    std::size_t corner_ = 0;
    float wm_[4] = {}, wn_[4] = {}, dm_[4] = {}, dn_[4] = {};
};

}  // namespace hord::algo
