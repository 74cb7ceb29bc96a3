// The paper's Figs. 1 and 2 from traced light: where light of one direction lands behind each lenslet of a 4f camera
// and of a conventional plenoptic one.
#pragma once

#include "lab/experiment/experiment.h"
#include "lab/experiment/result_cache.h"

namespace hord::lab {

constexpr double kPlenopticFocalMm = 100, kPlenopticDistanceMm = 600;  // the main lens

// Writes paper-offsets.csv and the plot of it. The report's text says the spreads.
Result<ExperimentReport> compare_cameras(const ExperimentOptions& options, ResultCache& cells);

}  // namespace hord::lab
