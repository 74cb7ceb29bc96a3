// The paper's Fig. 5: a clean lens, a spherical cut, an air bubble and an absorber, seen as EMD gradient, Jacobian
// norm, transmission and by a conventional telecentric camera; which of its claims hold, and for which lights
// and bubbles its picture is reproduced.
#pragma once

#include "lab/experiment/experiment.h"

namespace hord::lab {

Result<ExperimentReport> run_paper(const ExperimentOptions& options);

}  // namespace hord::lab
