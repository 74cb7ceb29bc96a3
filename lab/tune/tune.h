// Which features should judge these parts: measured on frames of good and of bad ones, on this machine.
//
// A rung is a choice of features as a recipe makes it (docs/adr/0004-rungs.md). Each is measured on every frame, a
// frame a part:
//   score      of a part without a reference: the worst lenslet's value over the limit, over the rung's features, as
//   algo/inspection/defects.h has it; against a
//              reference what algo/inspection/reference_defects.h says, with the base recipe's limits
//   limits     from the good frames alone: what a share `false_rejects` of good parts exceed if their worst values are
//   Gumbel's
//              (gumbel_limit in experiment/statistics.h), at least kMargin above the highest of them; rounded up to
//              three digits. Each feature's own; of a rung with a reference one factor for all limits of the base
//              recipe
//   detection  area under the ROC curve (AUC), 95 % interval by bootstrap over the frames
//   time       of judging a frame, median; rungs take turns, so that what else the machine does falls on each alike.
//   Reading a file, and decoding
//              it through a calibration, is the same for all of them and not counted
//
// Chosen is the fastest rung whose AUC is within kAsGood of the best, among those that fit the budget; of those that
// are as fast (kAsFast), the one with the fewest features. Nothing is random but the bootstrap, whose seed is fixed:
// the same frames give the same answer, apart from the times.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/frame.h"
#include "common/result.h"
#include "firmware/recipes/recipe_file.h"
#include "lab/report/statistics.h"

namespace hord::lab {

using namespace firmware;

constexpr double kAsGood = 0.005;  // of the area under the curve
constexpr double kAsFast = 0.05;   // of the time: more than medians of the same work differ
constexpr double kMargin = 0.01;   // of a limit over the highest good value
constexpr std::size_t kMinGood = 8, kMinBad = 4;

struct Rung {
    std::optional<algo::Feature> gradient;
    bool slopes = false, light = false, reference = false;
    [[nodiscard]] std::string name() const;
    [[nodiscard]] int features() const {
        return (gradient ? 1 : 0) + (slopes ? 1 : 0) + (light ? 1 : 0) + (reference ? 1 : 0);
    }
};
// Those that are measured; with a reference those, too, that need one.
std::vector<Rung> rungs(bool with_reference);

struct TuneOptions {
    double budget_ms = 0;
    int threads = 1;
    double false_rejects = 1e-3;
    // Light levels, zones, rim, smallest area, reference and the limits that go with it; its features and their limits
    // are what is tuned.
    NumberedRecipe base;
    std::pair<int, int> bins{9, 9};
    std::function<Result<Frame>(const std::string& file)> read;
    std::function<void(double done, const std::string& note)> progress = [](double, const std::string&) {};
};

struct RungMeasured {
    Rung rung;
    NumberedRecipe recipe = {};  // with its limits
    std::string no_limit = {};   // why no limit can be given; empty: there is one
    Estimate auc = {};
    Estimate behind = {};  // by how much its AUC is below the best's of those that fit
    int found = 0,
        rejected =
            0;  // bad and good frames at its limits, by their scores; of the chosen rung as its recipe judges them
    double wall_ms = 0, processor_ms = 0;
    bool fits = false;                                           // the budget, and has a limit
    [[nodiscard]] bool apart() const { return behind.low > 0; }  // the frames tell it from the best
};

struct LeftOut {
    std::string file, why;
};

struct Tuned {
    algo::Extents extents;
    int bits = 8;
    int threads = 1;
    std::size_t good = 0, bad = 0;  // frames measured
    std::size_t unregistered = 0;   // good ones that the reference does not find
    double budget_ms = 0, false_rejects = 0;
    std::vector<LeftOut> left_out;
    std::vector<RungMeasured> rungs;
    std::optional<std::size_t> best, chosen;  // among those that fit; none: none fits
};

// Fails with invalid_argument (too few frames, of different sizes or depths, what the recipe says of itself), and as
// `read` does. An unfit frame is left out and named. That no rung fits is no failure.
Result<Tuned> tune(const std::vector<std::string>& good, const std::vector<std::string>& bad,
                   const TuneOptions& options);

}  // namespace hord::lab
