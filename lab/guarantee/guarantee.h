// Does the bound of false rejects hold that `hordctl learn` and `hordctl tune` tell, how many good parts are rejected
// at limits from 60 parts, and which flaws are found at these limits? On drawn families of parts, with many seeds, each
// judged by parts of another stream.
#pragma once

#include "lab/experiment/experiment.h"

namespace hord::lab {

Result<ExperimentReport> run_guarantee(const ExperimentOptions& options);
// Reports the seeds that an interrupted run has finished. Fails with invalid_argument if it has none.
Result<ExperimentReport> report_finished_guarantee(const ExperimentOptions& options);

}  // namespace hord::lab
