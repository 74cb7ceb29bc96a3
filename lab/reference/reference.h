// Does a reference judge light fields of another program rightly? It is learned from some poses of each part and judges
// the others, at several exposures, as `hordctl learn` and `hordctl inspect --reference` do with the default recipe.
#pragma once

#include "lab/experiment/experiment.h"

namespace hord::lab {

Result<ExperimentReport> run_reference(const ExperimentOptions& options);

}  // namespace hord::lab
