// Speed against accuracy of every feature, over bins, light, slopes of the part, strides and averaged frames.
#pragma once

#include "lab/experiment/experiment.h"
#include "lab/experiment/result_cache.h"
#include "lab/tradeoff/tradeoff_cells.h"
#include "lab/tradeoff/tradeoff_parts.h"

namespace hord::lab {

constexpr int kTradeoffSeeds = 3;  // of whole parts and cells: the given one and the next ones

Result<ExperimentReport> run_tradeoff(const ExperimentOptions& options);

// The measurements at each point (tradeoff_scores.h, tradeoff_times.h).
struct TradeoffResults {
    struct Cell {
        TradeoffPoint point;
        Json values;
    };
    std::vector<Cell> scores, times;
    std::vector<TriedCell> cells;
    Json approximations;
    PartCounts counts;
    int good_patches = 0, defects_of_a_family = 0;

    [[nodiscard]] const Json* scores_at(const TradeoffPoint& point) const;
    [[nodiscard]] const Json* times_at(TradeoffPoint point) const;  // independent of slope and frames
};

// The report, its tables and plots (tradeoff_report.cpp).
Result<ExperimentReport> report_tradeoff(const TradeoffResults& results, const ExperimentOptions& options);

}  // namespace hord::lab
