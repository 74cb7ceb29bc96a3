// MissingMaterialFinder: how much the light of two squares of a part differs by noise.
#include <algorithm>
#include <cmath>

#include "algo/inspection/missing_material.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr std::size_t kMinSamples = 32;
constexpr float kSigmasOfQuartile = 1 / 0.3186F;  // of a normal distribution, by the lower quartile of absolute values
constexpr float kErrorOfQuartile = 1.79F;         // standard error, relative, of one sample; of n: over sqrt(n)
constexpr float kNextShare = 0.618034F;  // (sqrt(5) - 1) / 2: its multiples, less whole ones, are spread evenly
constexpr float kSurely = 3;             // standard errors that the noise is taken to be larger than it seems

}  // namespace

// Whether the outline of what may be a hole lies within a square. Its places are known to one more.
bool MissingMaterialFinder::is_at_outline(const Squares& squares, std::size_t at) const {
    const auto reach = static_cast<std::ptrdiff_t>(squares.half) + 1,
               stride = static_cast<std::ptrdiff_t>(squares.level->stride);
    for (std::ptrdiff_t n = -reach; n <= reach; ++n) {
        for (std::ptrdiff_t m = -reach; m <= reach; ++m) {
            if (of_hole_[beside(at, n * stride + m)] != of_hole_[at]) return true;
        }
    }
    return false;
}

// Standard deviation of the relative difference of two squares, of up to kMaxSamples in places all over the part; by
// the lower quartile, so that pairs across the outline of what is missing hardly add to it. None if there are too few.
// Sums of light are whole numbers. Where they are small, most differences are 0, 1 or 2, and so is their quartile.
// Therefore a part of 1, from -1/2 to 1/2, is added to each, every time another (dither). After a trial the pairs
// across the outline of what may be a hole do not count.
std::optional<float> MissingMaterialFinder::noise(const Squares& squares) {
    const Level& level = *squares.level;
    const std::vector<float>& count = squares.half > 0 ? count_ : level.count;
    float share = 0;  // in [0, 1)
    samples_.clear();
    const auto blocks = static_cast<std::size_t>(level.m) * static_cast<std::size_t>(level.n);
    const auto shift = static_cast<std::size_t>(squares.distance()), below = shift * level.stride;
    const std::size_t step = std::max<std::size_t>((2 * squares.judged + kMaxSamples - 1) / kMaxSamples, 1);
    for (std::size_t k = 0; k < blocks; k += step) {
        const auto row = k / static_cast<std::size_t>(level.m), column = k % static_cast<std::size_t>(level.m);
        const std::size_t at = level.index(static_cast<int>(column), static_cast<int>(row));
        if (mean_[at] <= 0) continue;
        for (const std::size_t other : {at + shift, at + below}) {
            if (mean_[other] <= 0) continue;
            if (squares.is_trial &&
                (of_hole_[at] != of_hole_[other] || is_at_outline(squares, at) || is_at_outline(squares, other)))
                continue;
            share += share < 1 - kNextShare ? kNextShare : kNextShare - 1;
            samples_.push_back(std::abs((mean_[at] + (share - 0.5F) / count[at]) / mean_[other] - 1));
        }
    }
    if (samples_.size() < kMinSamples) return std::nullopt;
    const float margin = 1 + kSurely * kErrorOfQuartile / std::sqrt(static_cast<float>(samples_.size()));
    return margin * kSigmasOfQuartile * common::nth_smallest(std::span(samples_), samples_.size() / 4);
}

}  // namespace hord::algo
