// The bin pitch as an axis of the paper's figure: what nine bins of 5 to 200 mrad see of the cut, the bubble and the
// absorber.
#pragma once

#include "hal_sim/optics/scene/scene.h"
#include "lab/experiment/experiment.h"
#include "lab/experiment/result_cache.h"

namespace hord::lab {

// `lens`: the clean scene at the figure's pitch. The report's text is the table.
Result<ExperimentReport> vary_pitch(const ExperimentOptions& options, const sim::Scene& lens, ResultCache& cells);

}  // namespace hord::lab
