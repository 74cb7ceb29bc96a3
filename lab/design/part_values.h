// The worst value of each feature on a frame, and which of them a feature set judges.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::lab {

// The gradients of algo::kJudgedGradients in their order and units, then the Jacobian's Frobenius norm (bin pitches a
// lenslet), then the missing light (1 - transmission).
inline constexpr std::size_t kGradientValues = algo::kJudgedGradients.size();
inline constexpr std::size_t kSlopesValue = kGradientValues, kLightValue = kGradientValues + 1;
inline constexpr std::size_t kPartValues = kGradientValues + 2;
using PartValues = std::array<double, kPartValues>;

struct JudgedSet {
    std::optional<algo::Feature> gradient;
    bool slopes = false, light = false;
    [[nodiscard]] bool has(std::size_t value) const;
    [[nodiscard]] std::string name() const;
};
// The sets that a design chooses from, the one with the fewest features first.
std::span<const JudgedSet> judged_sets();

// A recipe that judges this set at these limits. `base`: form of the part, zones, light levels.
algo::Recipe recipe_of(const JudgedSet& set, const PartValues& limits, const algo::Recipe& base);

class FrameValues {
  public:
    // For frames of these extents. `only`: the values of this set, else all. Fails as algo::Pipeline::create().
    static Result<FrameValues> create(const algo::Extents& extents, int bits, const algo::Recipe& base,
                                      std::optional<JudgedSet> only = {});
    // 0 where the set has no such feature. Fails as algo::Pipeline::inspect().
    Result<PartValues> of(const FrameView& frame);
    // Verdict of the last frame with the base recipe's limits.
    [[nodiscard]] algo::Verdict verdict() const { return verdict_; }
    [[nodiscard]] algo::Reason reason() const { return reason_; }

  private:
    std::vector<std::pair<JudgedSet, algo::Pipeline>> pipelines_;
    algo::Verdict verdict_{};
    algo::Reason reason_{};
};

}  // namespace hord::lab
