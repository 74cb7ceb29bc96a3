// `hord-lab experiment whole`, the trade on whole parts: good ones that are rejected, bad ones that pass, and the time
// of a verdict, by recipe.
//
// Frames of whole lenses go through algo::Pipeline as the station runs it. A bad part is a good one with a rendered
// window about its defect in place (lab/design/whole_parts.h). Limits come from good parts of the seed, as `hord-lab
// design` sets them; with a reference they are the default ones, on a reference that these parts taught. The verdicts
// are those on parts of another seed.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "lab/design/wanted_defect.h"
#include "lab/experiment/experiment.h"
#include "lab/experiment/result_cache.h"

namespace hord::lab {

struct WholePoint {
    int lenslets = 111;  // a side; 9x9 bins of 15 mrad, 24 mm field, 12 bits, 10,000 electrons full well
    std::uint64_t seed = 1;
    [[nodiscard]] std::string key() const;
};

struct WholeLadder {
    WantedKind kind;
    std::array<double, 4> sizes_mm;
};
inline constexpr std::array<WholeLadder, 4> kWholeLadders{{{WantedKind::bubble, {0.03, 0.06, 0.12, 0.24}},
                                                           {WantedKind::scratch, {0.003, 0.006, 0.012, 0.024}},
                                                           {WantedKind::dimple, {0.15, 0.3, 0.6, 1.2}},
                                                           {WantedKind::inclusion, {0.02, 0.04, 0.08, 0.16}}}};

struct WholeEffort {
    int poses = 8;         // rendered good parts for the limits: kMinParts of a reference
    int judged_poses = 8;  // of the good and the bad parts that are judged
    int exposures = 2;     // of each good part
    int places = 3;        // bad parts of a kind and size
};

// By recipe's name: {"good", "rejected": good parts, "ms": processor time of each verdict on one thread, and by kind
// [[size_mm, missed, tried], ...]}. Unfit counts as rejected. `frames`: a folder for count_instructions.sh, which gets
// the first good and the last bad frame, and the recipes; empty: none.
Result<Json> judge_whole_parts(const WholePoint& point, const WholeEffort& effort, int threads,
                               const std::filesystem::path& frames, const std::function<void(double)>& progress);

struct JudgedWhole {
    WholePoint point;
    Json values;
};
constexpr std::uint64_t kWholeSeeds = 3;  // the given one and the next ones
constexpr int kCountedLenslets = 111;     // of the frames whose instructions are counted (count_instructions.sh)

// 111, 222 and 555 lenslets, kWholeSeeds each; the quick form 55 lenslets and one seed.
Result<ExperimentReport> run_whole(const ExperimentOptions& options);
// The same of what an interrupted run has finished.
Result<ExperimentReport> report_finished_whole(const ExperimentOptions& options);

}  // namespace hord::lab
