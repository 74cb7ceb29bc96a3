// The chosen cell on whole parts: limits from some good parts, then verdicts on parts of another seed.
//
// A bad part is a good one with the light of a window about its defect in place: what a rendering of the whole would
// show, within rounding (test WholeParts.a_pasted_window_is_the_whole_rendering).
#pragma once

#include <functional>

#include "hal_sim/optics/camera/render.h"
#include "lab/design/cell_trial.h"

namespace hord::lab {

struct SizeCheck {
    double size_mm = 0;
    int found = 0, tried = 0;
};
struct DefectCheck {
    SizeCheck wanted, a90;  // a90.tried is 0 where the search found no a90
};
struct WholeCheck {
    algo::Recipe recipe;           // the limits for the station
    int limit_frames = 0;          // good frames that set them
    std::vector<FoundSize> found;  // with these limits, of the task's defects
    double worst_ratio = kNeverFound;
    int good = 0, rejected = 0;
    algo::Reason reason{};  // of the first good part that was rejected
    std::vector<DefectCheck> defects;
    double time_ms = 0, longest_ms = 0;  // processor time of a verdict on a good part: median, longest
};

struct CheckEffort {
    int poses = 10;           // rendered good parts that are judged
    int exposures = 2;        // of each; the limits come from poses * exposures parts
    int limit_exposures = 4;  // of each of these: noise alone sets the limits of a part without form
    int bad = 6;              // parts a defect and size
    Effort trials;            // of the sizes found with the limits of whole parts
};
// Parts for the limits are spread over one lenslet (spread_part); those for the verdicts are drawn by task.seed + 1000
// (good_part).
Result<WholeCheck> check_whole_parts(const CellChoice& cell, const SetTrial& set, const DesignTask& task,
                                     const PartSurvey& survey, const CheckEffort& effort,
                                     const std::function<void(double)>& progress);

// Judges one good part. Fails with unsupported and the reason if it is unfit in this cell.
Result<void> check_good_part(const CellChoice& cell, const DesignTask& task);

constexpr double kWobbleMm = 0.1;
// The good part number k of a seed: it lies a little differently.
sim::Scene good_part(const CellChoice& cell, const DesignTask& task, std::uint64_t seed, int k);

// Good part number k of `count` whose places on the lenslets differ evenly: along x and along y each lies in another
// one of `count` equal parts of a lenslet. Random places leave gaps; a lenslet that the part's edge covers in part
// misses most light in a tenth of the places.
sim::Scene spread_part(const CellChoice& cell, const DesignTask& task, int k, int count);

// `whole` with the lenslets of `window` (a rendering of window_of(scene, m, n, side)) in place.
void paste(sim::LightField& whole, const sim::LightField& window, int m, int n);

}  // namespace hord::lab
