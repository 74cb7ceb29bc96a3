// Does the bound of false rejects hold that `hordctl learn` and `hordctl tune` tell? On drawn families of parts, with
// many seeds, each judged by parts of another stream.
#pragma once

#include <cstddef>
#include <cstdint>

#include "lab/experiment/experiment.h"

namespace hord::lab {

Result<ExperimentReport> run_guarantee(const ExperimentOptions& options);
// Reports the seeds that an interrupted run has finished. Fails with invalid_argument if it has none.
Result<ExperimentReport> report_finished_guarantee(const ExperimentOptions& options);

// One seed of one family.
struct ToldBounds {
    struct Told {
        double bound = 1;     // of the share of good parts that are rejected, as it is told
        double measured = 0;  // share of the tested parts that are
        [[nodiscard]] bool holds() const { return measured <= bound; }
    };
    Told learned;             // at the recipe's limits, from the parts that were learned from
    Told tuned;               // at limits tuned on other parts, some of them exposed twice
    std::size_t counted = 0;  // distinct parts that were found among the frames to tune on
};
Result<ToldBounds> bounds_of(std::size_t family, std::uint64_t seed, int tested);

constexpr int kLearnedParts = 24, kTunedParts = 60, kTunedAgain = 15;  // parts; of those to tune on exposed twice

}  // namespace hord::lab
