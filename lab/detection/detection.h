// Detection against a reference on simulated production: false rejects, probability of detection, kinds, contrast,
// time.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "lab/experiment/experiment.h"
#include "lab/experiment/result_cache.h"
#include "lab/report/statistics.h"

namespace hord::lab {

Result<ExperimentReport> run_detection(const ExperimentOptions& options);
// Reports an interrupted run from its finished cells; figures with too few parts are marked.
Result<ExperimentReport> report_finished_detection(const ExperimentOptions& options);

inline constexpr double kGoodShare = 3e-4;  // share of good parts that the tuned limits should reject
inline constexpr int kContrastSeeds = 3;
inline constexpr double kLightLevels[] = {200, 2000, 20000};  // electrons a lenslet

// A judged part.
struct JudgedPart {
    double score = 0;  // 1 and above: rejected
    bool unfit = false;
    bool hit = false;     // a defect was found at the flaw
    int kind = -1;        // algo::DefectKind of that defect; -1: none was found
    double size = 0;      // of its flaw
    double from_rim = 0;  // lenslets
    int defects = 0;
};

struct DetectionResults {
    double factor = 1;  // on the recipe's default limits; not 1: from the tuning parts
    int tuned_on = 0;   // 0: the default limits
    std::map<std::string, std::vector<JudgedPart>> parts;  // by figure
    std::map<std::string, std::size_t> wanted;             // parts of a finished figure
    int poses = 0, slope_poses = 0;                        // part k of a figure has pose k % poses
    int bubble_exposures = 1, flaw_exposures = 1;          // consecutive exposures of one traced part
    std::vector<double> slopes;
    Json contrast, times;  // null while they are not finished; contrast: of kContrastSeeds seeds from `seed` on
    std::uint64_t seed = 1;
};

// Contrast to noise of the paper's cut at 16 places between the lenslets, with `all_flaws` first of the paper's scenes;
// and the time that judging against a reference takes (detection_contrast.cpp).
Result<Json> measure_contrast(const ExperimentOptions& options, std::uint64_t seed, bool all_flaws);
Result<Json> measure_times(const ExperimentOptions& options);

// The report, its tables and plots (detection_report.cpp).
Result<ExperimentReport> report_detection(const DetectionResults& results, const ExperimentOptions& options);

}  // namespace hord::lab
