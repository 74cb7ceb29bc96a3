// What a reference will do with parts that it was not learned from: it is learned again several times, each time
// without some of the parts, and judges these. Flaws are painted into the same frames (algo/good_parts/painted_flaw.h).
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algo/good_parts/false_rejects.h"
#include "algo/good_parts/painted_flaw.h"
#include "algo/good_parts/pod_curve.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/reference_learner.h"

namespace hord::algo {

struct CheckOptions {
    LearnOptions learning;    // as the reference was learned, with the numbers that were estimated then
    Recipe recipe;            // its limits; its reference is not used
    std::size_t folds = 4;    // how often it is learned again
    std::size_t trials = 96;  // painted flaws of each kind; 0: none
    std::uint64_t seed = 1;   // of their sizes and places
    std::function<void(double)> progress = [](double) {};  // 0..1
};

struct ReferenceCheck {
    static constexpr double kUnfit =
        100;  // score of a part that could not be judged, or in which no reference is found

    std::string not_checked;  // why there is no check: too few parts; empty: there is one
    struct Judged {
        std::size_t frame = 0, part = 0;
        double score = 0;  // over the limit: 1 and above is rejected
        std::string reason;
        double by_lenslets = 0, together = 0;  // Inspection::by_lenslets, together
    };
    std::vector<Judged> judged;        // every frame that was learned from
    std::vector<double> worst_scores;  // of each distinct part, over its exposures
    FalseRejects false_rejects;        // of worst_scores at the recipe's limits
    // The factor on the limits of lenslets (scale_score_limits()) at which at most half of kAimedFalseRejects are
    // rejected; and the pooled_score that half of it exceeds in the mean, as `hordctl tune` sets it. 0: not known.
    double factor = 1, pooled_score = 0;
    struct Found {
        std::size_t trials = 0, found = 0;
        PodCurve curve;  // after keep_to_tried()
    };
    std::array<Found, kPaintedFlaws.size()> flaws;
};

// Nothing is told of sizes that were not tried: a larger a90 or a90_95 is none, a smaller one is the smallest tried.
void keep_to_tried(PodCurve& curve, const PaintedFlawKind& kind);

// `part_of`: the part that each of `count` frames shows (DistinctParts); all frames of a part are left out together.
// `used`: whether it was learned from. Fails as learn_reference() and Pipeline::create().
Result<ReferenceCheck> check_reference(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
                                       const std::vector<std::size_t>& part_of, const std::vector<bool>& used,
                                       const CheckOptions& options);

// Sentences for people. In mm and mrad, too, if the recipe knows the pitches. `frames`: what the frames are called.
struct CheckSentences {
    std::vector<std::string> judged;         // the scores, and which parts would be rejected; or why there is no check
    std::vector<std::string> false_rejects;  // what is told of them, and the limits at which they would be fewer
    std::vector<std::string> flaws;          // which sizes are found
};
CheckSentences describe(const ReferenceCheck& check, const Recipe& recipe, std::span<const std::string> frames);

}  // namespace hord::algo
