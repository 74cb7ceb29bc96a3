// Defects of a part that is compared with itself: regions of lenslets at or above a limit.
//
// A lenslet's severity is the largest of its values over their limits, of the features that the recipe chooses:
//
//     gradient / its limit        frobenius / frobenius_limit        (1 - transmission) / (1 - transmission_limit)
//
// where the slope that is a tube's own is taken off the Jacobian, and twice off a gradient in bins (over two lenslets).
//
// Lenslets of severity 1 and above are flagged. Flagged lenslets that touch, at sides or corners, or have one lenslet
// between them, are one region. Regions with fewer flagged lenslets than `min_area` are dropped.
//
// A defect's position is the centroid of its flagged lenslets. Its peak is the largest value of the feature that
// exceeds its limit most (for missing light: the missing share, 0..1). Its kind, for display only:
// docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <span>

#include "algo/frame/extents.h"
#include "algo/inspection/tube_outline.h"
#include "algo/recipe/recipe.h"
#include "algo/verdict/verdict.h"
#include "common/opaque.h"

namespace hord::algo {

// The features of one frame, one value a lenslet; empty if not judged. `mask`: MaskBit.
struct Features {
    std::span<const float> gradient;  // of the distance that the recipe chooses
    std::span<const float> frobenius;
    std::span<const float> transmission;
    std::span<const std::uint8_t> mask;
    std::span<const std::uint8_t> bounds = {};  // 1: `gradient` is an upper bound there; empty: it is exact everywhere
    std::span<const OwnSlope> own_slopes = {};  // of a tube (TubeOutline::own_slopes()); empty: none
};

// The norm of the Jacobian without a tube's own slope.
float slope_beyond(const OwnSlope& own, float frobenius);

struct FoundDefects {
    std::span<const Defect> defects;  // most severe first; valid until the next call
    Reason reason = Reason::none;     // of the most severe
    float score = 0;                  // its severity; without defects the largest severity of the part, below 1, where
                                      // gradients that are bounds do not count
    // With a reference: the score of what lenslets show together (algo/reference/pooled_scores.h), standard deviations;
    // and `score` without it.
    float together = 0, by_lenslets = 0;
};

class DefectFinder {
  public:
    DefectFinder(const Extents& extents, const Recipe& recipe);

    // Allocates only if a lenslet exceeds a limit. Fails with internal if OpenCV does.
    Result<FoundDefects> find(const Features& features);

    // Of lenslet k: the severity of its gradient, and of its other features. 0 where there is none or it is not judged.
    struct Severities {
        float gradient = 0, others = 0;
    };
    [[nodiscard]] Severities severities(const Features& features, std::size_t k) const;

  private:
    struct Workspace;
    common::Opaque<Workspace> workspace_;
};

}  // namespace hord::algo
