// Registration: finds a part's pose from its maps of light and mean deflection, to a small fraction of a lenslet, by
// robust Gauss-Newton from the reference's own pose over a regular sample of lenslets (docs/notes/reference.md).
//
// It fails if the steps do not converge, if the pose exceeds kFarthestLenslets or kFarthestSine, or if more than
// kForeignShare of the samples disagree grossly (another kind of part).
//
// Maps are read in floats, all else is doubles, + - * / and square roots in a fixed order: the same bits everywhere.
// The constructor allocates all memory.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"
#include "algo/reference/pose.h"

namespace hord::algo {

constexpr double kFarthestLenslets = 2.5, kFarthestSine = 0.06;  // 3.4 degrees
constexpr double kForeignShare = 0.4;

// The reference's maps, one value a lenslet. `mask`: no deflection at kDark and kSaturated, no value at kOutside.
struct ReferenceMaps {
    std::span<const float> light;  // DN
    std::span<const float> x, y;   // mean deflection, bin pitches
    std::span<const std::uint8_t> mask;
};

struct Registered {
    enum class Outcome : std::uint8_t { found, too_little, too_far, foreign, unsettled };
    Outcome outcome = Outcome::too_little;
    Pose pose;
    double light = 1;        // the part's light over the reference's, median over the sample
    double disagreeing = 0;  // share of the samples that disagree grossly
    // Whether the maps say where the part lies along x and y, and how it is turned (or it is round, so that no turn
    // matters). What they do not say stays near 0.
    std::array<bool, 3> determined{};
    [[nodiscard]] bool found() const { return outcome == Outcome::found; }
};

// One sentence for display.
const char* explain(Registered::Outcome outcome);

class Registrar {
  public:
    explicit Registrar(const Extents& extents);

    // The noise follows from `electrons_per_dn` and the number of `parts` that the reference is the mean of. The part's
    // maps have one value a lenslet; of its mask kDark and kSaturated are used.
    Registered find(const ReferenceMaps& reference, std::span<const Deflection> deflections,
                    std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, double electrons_per_dn,
                    std::uint32_t parts);

  private:
    struct PartMaps;
    struct Step;
    bool update_light(std::size_t count, std::size_t used, double& typical, double& light);
    std::size_t compare(const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map, std::size_t used,
                        double typical, double light_ratio, Step& step, double& next_typical);

    struct SamplePoint {
        std::uint32_t k;
        double m, n;
    };
    Extents extents_;
    std::vector<SamplePoint> sample_;  // begins with a quarter of it, evenly over the field:
    std::size_t coarse_ = 0;           // the first `coarse_` points
    std::vector<double> ratios_;
};

}  // namespace hord::algo
