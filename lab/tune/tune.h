// Tuning: chooses the set of features to judge these parts, by measurements on frames of good and bad parts on this
// machine.
//
// A feature set is a choice of features as a recipe makes it (docs/adr/0004-feature-sets.md). Each set is measured on
// every frame:
//   score      Without a reference: the worst value of a lenslet over its limit (algo/inspection/defects.h), the
//   largest
//              of the set's features. With a reference: as in algo/inspection/reference_defects.h, with the base
//              recipe's limits.
//   parts      Copies and repeated exposures of a part count once (algo/good_parts/distinct_parts.h): a good part with
//              its worst score, a bad one with its least. kMinGood and kMinBad are distinct parts.
//   limits     From the good parts alone: the value that a share `false_rejects` of good parts exceeds if their worst
//              values follow a Gumbel distribution (gumbel_limit() of lab/report/statistics.h), at least kMargin above
//              the highest value, rounded up to three digits. A feature each; with a reference one factor for all
//              limits of lenslets of the base recipe, from predicted_limit() of algo/good_parts/false_rejects.h, and
//              pooled_score, from predicted_light_tailed_limit(), each for half of the share.
//   detection  Area under the ROC curve (AUC) of the parts, with a 95 % interval by bootstrap over them.
//   time       Of judging a frame, median. The sets take turns, so other load disturbs all alike. Reading a file and
//              decoding it through a calibration are not counted: they are the same for all sets.
//
// Chosen is the fastest set within the budget whose AUC is within kAsGood of the best; among sets as fast as that
// (kAsFast) the one with the fewest features. The bootstrap's seed is fixed: the same frames give the same answer,
// apart from the times.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "algo/good_parts/distinct_parts.h"
#include "algo/good_parts/false_rejects.h"
#include "common/frame.h"
#include "common/result.h"
#include "firmware/recipes/recipe_file.h"
#include "lab/report/statistics.h"

namespace hord::lab {

constexpr double kAsGood = 0.005;  // difference of the areas under the curve
constexpr double kAsFast = 0.05;   // relative difference of times: above that of two medians of the same work
constexpr double kMargin = 0.01;   // relative distance of a limit above the highest good value
constexpr double kGuessing = 0.5;  // AUC; a set that is not above it is not chosen
constexpr std::size_t kMinGood = 8, kMinBad = 4;

struct FeatureSet {
    std::optional<algo::Feature> gradient;
    bool slopes = false, light = false, reference = false;
    [[nodiscard]] std::string name() const;
    [[nodiscard]] int features() const {
        return (gradient ? 1 : 0) + (slopes ? 1 : 0) + (light ? 1 : 0) + (reference ? 1 : 0);
    }
};
// The sets that are measured. `with_reference` adds those that need a reference.
std::vector<FeatureSet> feature_sets(bool with_reference);

struct TuneOptions {
    double budget_ms = 0;
    int threads = 1;
    double false_rejects = 1e-3;
    // Defines light levels, zones, rim, smallest area, reference and its limits. Its features and their limits are
    // tuned.
    firmware::NumberedRecipe base;
    std::pair<int, int> bins{9, 9};
    std::function<Result<Frame>(const std::string& file)> read;
    std::function<void(double done, const std::string& note)> progress = [](double, const std::string&) {};
};

struct MeasuredFeatureSet {
    FeatureSet set;
    firmware::NumberedRecipe recipe = {};  // with its limits
    std::string no_limit = {};             // why the set cannot have a limit; empty: it has one
    Estimate auc = {};
    Estimate behind = {};  // how much its AUC is below that of the best set
    // Bad and good frames that are rejected at its limits: by their scores, for the chosen set by its recipe.
    int found = 0, rejected = 0;
    double wall_ms = 0, processor_ms = 0;
    bool fits = false;                      // within the budget, and has a limit
    algo::FalseRejects false_rejects = {};  // at its limits, from the distinct good parts
    // Whether the frames show a difference from the best set.
    [[nodiscard]] bool is_clearly_worse() const { return behind.low > 0; }
};

struct LeftOut {
    std::string file, why;
};

struct Tuned {
    algo::Extents extents;
    int bits = 8;
    int threads = 1;
    std::size_t good = 0, bad = 0;                 // frames measured
    algo::DistinctParts::Groups parts, bad_parts;  // of the good frames, of the bad ones
    std::size_t unregistered = 0;                  // good frames in which the reference was not found
    double budget_ms = 0, false_rejects = 0;
    std::vector<LeftOut> left_out;
    std::vector<MeasuredFeatureSet> feature_sets;
    // Among those that fit; empty: no set fits. Chosen is also empty if the best is no better than guessing.
    std::optional<std::size_t> best, chosen;
};

// Fails with invalid_argument (too few frames, frames of different sizes or depths, an impossible recipe), and as
// `options.read` does. Unfit frames are left out and listed. It is no error if no set fits.
Result<Tuned> tune(const std::vector<std::string>& good, const std::vector<std::string>& bad,
                   const TuneOptions& options);

}  // namespace hord::lab
