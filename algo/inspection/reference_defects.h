// Defects of a part that is compared with a reference: regions that differ from good parts by more than noise and the
// spread of good parts.
//
// A lenslet's severity is the larger of its score against the reference (algo/reference/reference_comparison.h), in
// units of noise, over `reject_score`, also at the part's rim; and of its gradients over neighbours less those of a
// typical good part, over their limits, not at the rim.
// Hysteresis: a region is connected, at sides or corners, at or above `grow_score`. It is a defect if the severity of
// one lenslet reaches 1, or if the root of the sum of its squared scores reaches `cluster_score`. In that sum a score
// counts by the share of noise in its variance, because neighbours deviate together by the spread of good parts.
// What several lenslets show together is a defect where it reaches `pooled_score` and no region lies there. So is a
// square of lenslets whose light changed (algo/reference/light_patches.h) by `reject_score` standard deviations, or by
// what noise alone reaches in one of 10,000 frames, if that is more.
// Tolerances of the recipe may allow a defect. Lenslets outside the part, outside the recipe's zones, or saturated are
// not judged.
//
// Score of missing light, and the kind of a defect: docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "algo/inspection/defects.h"
#include "algo/inspection/flaw_size.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/light_patches.h"
#include "algo/reference/pooled_scores.h"
#include "algo/reference/reference.h"
#include "algo/reference/reference_comparison.h"

namespace hord::algo {

constexpr double kScratchLength = 5, kScratchRatio = 2.5;  // lenslets; length over width

// One frame compared with the reference, one value a lenslet.
struct ComparedFrame {
    std::span<const Difference> differences;
    std::span<const float> emd, frobenius;      // over neighbours; empty if not judged
    std::span<const std::uint8_t> mask;         // MaskBit
    std::span<const std::uint8_t> bounds = {};  // 1: `emd` is an upper bound there; empty: it is exact everywhere
    std::optional<ComparedLight> light = {};    // to measure sizes by; without it they are those of the regions
};

class ReferenceDefects {
  public:
    // Place and size of the worst defects are measured by the light, up to these limits: about 5 ms.
    static constexpr std::size_t kMaxSized = 32, kMaxSizedLenslets = 1000;  // defects; lenslets of their regions
    static constexpr std::size_t kSizedOf = 4;  // the next is measured if less than 1/kSizedOf of the field was read

    // Allocates all memory, for up to a thousand defects; find() allocates for more.
    ReferenceDefects(const Extents& extents, const Recipe& recipe);

    // First: the scores of a frame, row by row, of different rows by any threads at once. `z_score` receives every
    // lenslet's worst score. compared.emd holds the gradients, or bounds, of these rows.
    void score_lenslets(const ComparedFrame& compared, std::span<float> z_score);
    void score_row(const ComparedFrame& compared, int n, std::span<float> z_score);

    // The severity of lenslet k by its scores, its slope and its EMD gradient compared.emd[k]; not decreasing with it.
    // 0 if it is not judged. Kept from score_row() where the gradient is still the bound that it was then.
    [[nodiscard]] float severity(const ComparedFrame& compared, std::size_t k) const {
        return is_bound(compared, k) ? severity_[k] : severity_now(compared, k);
    }
    // The same at score_row() if the region and the score of a defect can depend on the exact gradient, else 0.
    [[nodiscard]] float severity_by_gradient(std::size_t k) const { return by_gradient_[k]; }
    // The severity from which a lenslet belongs to a region.
    [[nodiscard]] float grow_severity() const { return recipe_.grow_score / recipe_.reject_score; }

    // `all_exact` false: some lenslets at or above grow_severity() are bounds. Tolerances then allow no defect, because
    // a region may be larger than it is, or be two.
    FoundDefects find(const ComparedFrame& compared, const Pose& pose, bool all_exact = true);

  private:
    struct Region {
        std::uint32_t area = 0;
        double m = 0, n = 0, mm = 0, nn = 0, mn = 0, weight = 0;  // weighted sums of positions and their products
        // Sums of squared scores: of all, each by the share of noise in it; by deviation.
        double squares = 0, missing_light = 0, added_light = 0, shift = 0, scattering = 0, shape = 0, gradient = 0;
        float worst = 0;                                                           // severity
        float min_light = 0, max_shift = 0, max_scattering = 0, max_gradient = 0;  // in their own units
    };
    [[nodiscard]] static bool is_bound(const ComparedFrame& compared, std::size_t k) {
        return !compared.bounds.empty() && compared.bounds[k] != 0;
    }
    [[nodiscard]] float severity_now(const ComparedFrame& compared, std::size_t k) const;
    [[nodiscard]] float severity_without_emd(const ComparedFrame& compared, std::size_t k) const;
    [[nodiscard]] float severity_of_emd(const ComparedFrame& compared, std::size_t k) const;
    [[nodiscard]] float noise_share(const Scores& scores, const Difference& difference) const;
    std::span<const std::uint32_t> take_lenslets(std::uint32_t seed);
    Region grow_region(std::uint32_t seed, const ComparedFrame& compared);
    [[nodiscard]] Defect describe(const Region& region, Reason& reason) const;
    void measure_worst(const ComparedLight& light, const PoseMap& pose);
    void add_weak(Defect defect, Reason reason, bool all_exact, const PoseMap& map);
    float find_patch(const ComparedFrame& compared, bool all_exact, const PoseMap& map);
    [[nodiscard]] Defect describe(const PooledPeak& peak, Reason& reason) const;
    [[nodiscard]] bool tolerated(const Defect& defect, const Region& region, const PoseMap& pose);

    struct Found {
        Defect defect;
        Reason reason = Reason::none;
        std::uint32_t seed = 0;  // a lenslet of the region; of a weak one none
    };

    Extents extents_;
    const Recipe recipe_;
    const Reference& reference_;
    FlawSizer sizer_;
    LightPatches patches_;
    float patch_limit_;                   // standard deviations
    std::optional<PooledScorer> pooled_;  // if it is judged, and the reference has scales for it
    std::vector<Scores> scores_;
    std::vector<float> z_severity_, severity_;  // by the scores alone; of all
    std::vector<float> without_emd_;            // of all but the gradient
    std::vector<float> by_gradient_;            // severity_by_gradient()
    std::vector<std::uint8_t> visited_;
    std::vector<std::uint32_t> queue_;
    std::vector<Found> found_;
    std::vector<Defect> allowed_;  // by tolerances
    std::vector<Defect> defects_;
    std::vector<std::uint32_t> used_;  // defects that each tolerance has allowed
};

// All problems of a recipe's limits of scores and its tolerances, one message each; empty if they can be used.
std::vector<std::string> problems_of_reference(const Recipe& recipe);

// In what the frames differ from those that the recipe's reference was learned from, one message each.
std::vector<std::string> mismatches_of_reference(const Recipe& recipe, const Extents& extents, int bits);

}  // namespace hord::algo
