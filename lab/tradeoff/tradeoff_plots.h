// Plots of the trade-off: detection against time, probability of detection by size, error against time, and its axes.
#pragma once

#include <filesystem>
#include <vector>

#include "lab/tradeoff/tradeoff.h"

namespace hord::lab {

// Draws tradeoff-pareto, -pod, -error and -axes; returns the files. Fails as plot().
Result<std::vector<std::filesystem::path>> plot_tradeoff(const TradeoffResults& results,
                                                         const std::filesystem::path& folder);

}  // namespace hord::lab
