// Registration: finds a part's pose from its maps of light and mean deflection, to a small fraction of a lenslet, by
// robust Gauss-Newton from the reference's own pose over a regular sample of lenslets (docs/notes/reference.md).
//
// Where this fails, or the part lacks the reference's edges at that pose, blocks of lenslets tell another start, if the
// field has 48 lenslets or more.
//
// It fails if the steps do not converge, if the pose exceeds kFarthestLenslets (kFarthestByEdges) or kFarthestSine, if
// more than kForeignShare of the samples disagree grossly (another kind of part), if the edges are elsewhere, if
// opposite edges do not lie as far apart as those of the reference's parts, or if its edges are wider.
//
// Maps are read in floats, all else is doubles, + - * / and square roots in a fixed order: the same bits everywhere.
// The constructor allocates all memory.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"
#include "algo/reference/coarse_maps.h"
#include "algo/reference/edge_agreement.h"
#include "algo/reference/edge_blur.h"
#include "algo/reference/pose.h"
#include "algo/reference/registered_maps.h"
#include "algo/reference/size_difference.h"

namespace hord::algo {

constexpr double kFarthestLenslets = 2.5, kFarthestSine = 0.06;  // 3.4 degrees
// Along an axis of which edges of the light say where the part lies.
constexpr double kFarthestByEdges = CoarseMaps::kBlock * kFarthestLenslets;
constexpr int kMinFieldByEdges = 12 * CoarseMaps::kBlock;  // lenslets a side: interpolation leaves 9 blocks of 12
constexpr double kForeignShare = 0.4;

struct Registered {
    enum class Outcome : std::uint8_t {
        found,
        too_little,
        too_far,
        foreign,
        other_edges,
        unsettled,
        other_size,
        blurred,     // it moved while the light was on, or was exposed twice
        no_part,     // the reference has edges, the field shows none
        free_light,  // the reference has no edges, and the light is rather an empty field's (free_light.h)
    };
    Outcome outcome = Outcome::too_little;
    Pose pose;
    double light = 1;          // the part's light over the reference's, median over the sample
    double disagreeing = 0;    // share of the samples that disagree grossly
    bool has_edges = false;    // the reference has edges that say where a part lies
    double missing_edges = 2;  // share of the reference's edges that the part lacks there; 2: no pose was found
    // Whether the maps say where the part lies along x and y, and how it is turned (or it is round, so that no turn
    // matters). What they do not say stays near 0.
    std::array<bool, 3> determined{};
    SizeDifference size;  // at the pose that was found
    EdgeBlur blur;        // the same
    // How far a part may lie along x and y, lenslets: kFarthestByEdges where the reference's edges of the light tell.
    std::array<double, 2> farthest{kFarthestLenslets, kFarthestLenslets};
    [[nodiscard]] bool found() const { return outcome == Outcome::found; }
    [[nodiscard]] bool shows_no_part() const { return outcome == Outcome::no_part || outcome == Outcome::free_light; }
};

// One sentence for display.
const char* explain(Registered::Outcome outcome);
// With how far a part lies that is too far, if its edges show it, and how much larger or smaller it is.
std::string explain(const Registered& of);

class Registrar {
  public:
    explicit Registrar(const Extents& extents);

    // The noise follows from `electrons_per_dn` and the number of `parts` that the reference is the mean of. The part's
    // maps have one value a lenslet; of its mask kDark and kSaturated are used.
    Registered find(const ReferenceMaps& reference, std::span<const Deflection> deflections,
                    std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, double electrons_per_dn,
                    std::uint32_t parts);

  private:
    struct Problem;
    struct Step;
    bool begin(Problem& of);
    bool update_light(std::size_t count, std::size_t used, double& typical, double& light);
    std::size_t compare(const Problem& of, const PoseMap& map, std::size_t used, double typical, double light_ratio,
                        Step& step, double& next_typical);
    Registered settle(const Problem& of, const Pose& start);
    Registered find_pose(const Problem& of);
    [[nodiscard]] bool is_empty(const Problem& of) const;
    void check(const Problem& of, bool afar, Registered& result) const;
    void check_steps(const Problem& of, Registered& result) const;
    Registered settle_from_afar(const Problem& of);

    struct SamplePoint {
        std::uint32_t k;
        double m, n;
    };
    Extents extents_;
    std::vector<SamplePoint> sample_;  // begins with a quarter of it, evenly over the field:
    std::size_t coarse_ = 0;           // the first `coarse_` points
    std::vector<double> ratios_;
    std::unique_ptr<CoarseMaps> blocks_;    // of large fields
    std::unique_ptr<Registrar> on_blocks_;  // without the check of its poses
};

}  // namespace hord::algo
