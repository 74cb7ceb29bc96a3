// Finds the bubbles and area lights that reproduce the paper's picture: the telecentric camera sees the cut, but not
// the bubble.
#pragma once

#include "lab/experiment/experiment.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/experiment/result_cache.h"

namespace hord::lab {

// `lens`: the clean scene at the figure's pitch; `emd`, `frobenius`: of its interior. The report's text is the table.
Result<ExperimentReport> vary_paper(const ExperimentOptions& options, const sim::Scene& lens, const Interior& emd,
                                    const Interior& frobenius, ResultCache& cells);

}  // namespace hord::lab
