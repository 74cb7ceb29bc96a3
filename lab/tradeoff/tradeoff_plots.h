// The trade-off drawn: time and detection, probability of detection by size, error and time, and what changes it.
#pragma once

#include <filesystem>
#include <vector>

#include "lab/tradeoff/tradeoff.h"

namespace hord::lab {

// tradeoff-pareto, -pod, -error and -axes as SVG and PNG; returns them. Fails as plot() does.
Result<std::vector<std::filesystem::path>> plot_tradeoff(const TradeoffResults& results,
                                                         const std::filesystem::path& folder);

}  // namespace hord::lab
