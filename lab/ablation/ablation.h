// Ablation: the change in detection by each physical effect of a scene, and its rendering cost.
#pragma once

#include "lab/experiment/experiment.h"

namespace hord::lab {

Result<ExperimentReport> run_ablation(const ExperimentOptions& options);

}  // namespace hord::lab
