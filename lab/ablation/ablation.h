// What each physical effect of a scene does to detection, and what it costs: the basis for naming it in a scene, or
// not.
#pragma once

#include "lab/experiment/experiment.h"

namespace hord::lab {

Result<ExperimentReport> run_ablation(const ExperimentOptions& options);

}  // namespace hord::lab
