// Defects of a part that is compared with a reference: where it differs from good parts by more than light and they
// explain, how large that is, of what kind, and whether it is tolerated.
//
// A lenslet's severity is 1 and above where it is too much; the worst of
//   - its scores against the reference (algo/reference/reference_comparison.h), in units of noise, over `reject_score`:
//   also at the part's rim, for how much good
//     parts differ there is in the reference. Light that is missing beyond that is counted: its score is the root of
//     the Poisson deviance, the most that a score with normal good parts can say (all of N electrons: sqrt(2 N));
//   - its gradients over neighbours, as without a reference (algo/inspection/defects.h), less what a typical good part
//   shows there; not at the rim.
// Hysteresis: a region is what is connected, at sides or corners, at or above `grow_score`. It is a defect when one of
// its lenslets is too much, or when many weaker ones lie together: the root of the sum of their squared scores reaches
// `cluster_score`.
//
// The kind, from the region's sums of squared scores:
//   scratch     long and thin (kScratchLength, kScratchRatio), whatever it does to the light
//   absorbing   most of it is missing light
//   scattering  much of it is a wider spread of deflections, and more than what is told by the next
//   surface     another mean deflection, and another shape of the HORD, for bins are coarse and a shift changes it;
//   with the spread of what is bent
//               differently within a lenslet that is most of it
//   unknown     none of these has its share
// Lenslets outside the part, outside the recipe's zones, or saturated are not judged.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/inspection/defects.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/reference.h"
#include "algo/reference/reference_comparison.h"

namespace hord::algo {

constexpr double kScratchLength = 5, kScratchRatio = 2.5;  // lenslets; length over width

// One frame compared lenslet by lenslet.
struct Compared {
    std::span<const Difference> differences;
    std::span<const float> emd, frobenius;  // over neighbours; empty: not judged
    std::span<const std::uint8_t> mask;     // MaskBit
};

class ReferenceDefects {
  public:
    // Takes all memory but that of more than a thousand defects.
    ReferenceDefects(const Extents& extents, const Recipe& recipe);

    // `z_score` receives every lenslet's worst score.
    FoundDefects find(const Compared& compared, const Pose& pose, std::span<float> z_score);

  private:
    struct Region {
        std::uint32_t area = 0;
        double m = 0, n = 0, mm = 0, nn = 0, mn = 0, weight = 0;
        double squares = 0;                                                                        // of scores
        double missing = 0, added = 0, deflection_shift = 0, spread = 0, shape = 0, gradient = 0;  // shares of that
        float worst = 0;                                                                           // severity
        float least_light = 0, most_bend = 0, most_blur = 0, most_gradient = 0;                    // in their own units
    };
    void look(const Compared& compared, std::span<float> z_score);
    Region gather(std::uint32_t seed, const Compared& compared);
    [[nodiscard]] Defect describe(const Region& region, Reason& reason) const;
    [[nodiscard]] bool tolerated(const Defect& defect, const Region& region, const PoseMap& pose);

    Extents extents_;
    const Recipe recipe_;
    const Reference& reference_;
    std::vector<Scores> scores_;
    std::vector<float> severity_;
    std::vector<std::uint8_t> visited_;
    std::vector<std::uint32_t> queue_;
    std::vector<std::pair<Defect, Reason>> found_;
    std::vector<Defect> defects_;
    std::vector<std::uint32_t> used_;  // of each tolerance
};

// What is wrong with the reference, its limits and the tolerances of a recipe, one line each; empty when they can be
// used.
std::vector<std::string> problems_of_reference(const Recipe& recipe, const Extents& extents, int bits);

}  // namespace hord::algo
