// What each physical effect of a scene does to detection, and what it costs: the basis for naming it in a scene, or
// not.
#pragma once

#include "firmware/experiment/experiment.h"

namespace hord::firmware {

Result<ExperimentReport> run_ablation(const ExperimentOptions& options);

}  // namespace hord::firmware
