// The processor time of verdicts on frames of one geometry, over that of a clean frame by the same recipe.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"
#include "common/frame.h"
#include "common/result.h"
#include "lab/stability/stability.h"

namespace hord::lab {

// The goals of issue 21: a verdict's time over a clean frame's, and over the time with the exact map.
constexpr double kMaxOverClean = 3, kMaxOfExact = 0.6;

class VerdictSeries {
  public:
    // `shown`: what the frames have in common. Measures the clean frame's verdict and its exact map.
    static Result<VerdictSeries> of(const algo::Extents& extents, const algo::Recipe& recipe, Frame clean,
                                    std::string shown);

    // Measures the frame in turn with the clean one, and adds a row to `times.frames`.
    Result<void> add(const Frame& frame, std::string_view name, VerdictTimes& times);

    // A row of VerdictTimes::sizes.
    [[nodiscard]] std::vector<std::string> summary() const;

  private:
    VerdictSeries(algo::Pipeline pipeline, Frame clean, std::string size, std::string shown)
        : pipeline_(std::move(pipeline)), clean_(std::move(clean)), size_(std::move(size)), shown_(std::move(shown)) {}

    algo::Pipeline pipeline_;
    Frame clean_;
    std::string size_, shown_, worst_name_ = "none";
    double clean_ms_ = 0, of_exact_ = 0, worst_ = 0;
};

}  // namespace hord::lab
