// Kinds of defect: what the simulated line makes (hal_sim/cell/production.h), and which camera or feature sees it.
#pragma once

#include "lab/experiment/experiment.h"

namespace hord::lab {

Result<ExperimentReport> run_kinds(const ExperimentOptions& options);

}  // namespace hord::lab
