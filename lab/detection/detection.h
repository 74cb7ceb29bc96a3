// Does judging against a reference keep its promises on simulated production? False rejects, probability of detection,
// kinds, contrast, time.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "lab/experiment/experiment.h"
#include "lab/experiment/result_cache.h"
#include "lab/report/statistics.h"

namespace hord::lab {

Result<ExperimentReport> run_detection(const ExperimentOptions& options);
// What an interrupted run has finished, and nothing more: figures that have too few parts say so.
Result<ExperimentReport> report_finished_detection(const ExperimentOptions& options);

inline constexpr double kGoodShare = 3e-4;  // of good parts that the limits, fitted on the tuning parts, are to reject
inline constexpr double kLightLevels[] = {200, 2000, 20000};  // electrons a lenslet

// One part as it was judged: its score (1 and above rejects), whether a defect was found where the flaw is, the kind of
// it.
struct JudgedPart {
    double score = 0;
    bool unfit = false, hit = false;
    int kind = -1;        // algo::DefectKind; -1: nothing was found there
    double size = 0;      // of its flaw
    double from_rim = 0;  // lenslets
    int defects = 0;
};

struct DetectionResults {
    double factor = 1;  // on the recipe's default limits, from the tuning parts
    int tuned_on = 0;
    std::map<std::string, std::vector<JudgedPart>> parts;  // by figure
    std::map<std::string, std::size_t> wanted;             // so many parts a figure has when it is finished
    int poses = 0, slope_poses = 0;  // part k of a figure that is exposed again and again lies like part k % poses
    int bubble_exposures = 1, flaw_exposures = 1;  // that follow one another, of one traced part
    std::vector<double> slopes;
    Json contrast, times;  // null while they are not finished
    std::uint64_t seed = 1;
};

// Contrast to noise on the paper's cut and bubble, and the time that judging against a reference takes
// (detection_contrast.cpp).
Result<Json> measure_contrast(const ExperimentOptions& options);
Result<Json> measure_times(const ExperimentOptions& options);

// The report, its tables and plots (detection_report.cpp).
Result<ExperimentReport> report_detection(const DetectionResults& results, const ExperimentOptions& options);

}  // namespace hord::lab
