// Ablation: what each physical effect of a scene changes in detection, and what it costs to render.
#pragma once

#include "lab/experiment/experiment.h"

namespace hord::lab {

Result<ExperimentReport> run_ablation(const ExperimentOptions& options);

}  // namespace hord::lab
