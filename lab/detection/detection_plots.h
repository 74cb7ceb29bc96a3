// gnuplot scripts of the detection experiment, for plot() of lab/report/tables.h.
#pragma once

#include <string>

#include "lab/detection/detection.h"

namespace hord::lab {

// ROC curves of the flawed figures against the parts that wobble.
std::string roc_script(const DetectionResults& results);
// Share of the bubbles found by radius, with the fitted curve.
std::string pod_script(const DetectionResults& results);
// Area under the ROC curve by slope. `points`: a line of slope, AUC and its interval each.
std::string slope_script(const std::string& points);

}  // namespace hord::lab
