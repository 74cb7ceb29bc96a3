// How much good parts differ from the reference HORDs, lenslet by lenslet, beyond noise: pass 4 of
// algo/reference/reference_learner.h, which is its only user. A trimmed mean over 3x3 lenslets, larger where
// parts deviate far now and then: near edges. How far a part may go there beyond the others follows from the parts
// themselves (docs/notes/reference.md).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algo/reference/largest_by_part.h"
#include "algo/reference/reference.h"
#include "algo/reference/reference_comparison.h"

namespace hord::algo {

// The upper median; 0 of no values.
double median_or_0(std::vector<double> values);

class SpreadEstimate {
  public:
    explicit SpreadEstimate(const Extents& extents);

    // One lenslet of a part, with its gradients where it has a HORD.
    void add(std::uint32_t part, const Difference& difference, float emd, float frobenius);

    // Writes spread, emd and frobenius of the reference. `parts`: how many were added.
    void finish(double parts, Reference& reference) const;

    // No lenslet with a HORD was added.
    [[nodiscard]] bool empty() const { return chi2_ratios_.empty(); }
    // Chi-square over its expectation by noise alone, the median over the lenslets of all parts.
    [[nodiscard]] double median_chi2_ratio() const { return median_or_0(chi2_ratios_); }

    // For each of `count` parts: the number of lenslets whose deviation comes from this part alone. In these its share
    // of the sum of squared scores is larger than Grubbs' test allows among `parts` parts.
    [[nodiscard]] std::vector<double> sole_deviations(std::size_t count, double parts) const;

  private:
    struct Sums {
        std::array<float, kDeviations> squares{}, variance{};  // of shape: excess and its noise
        std::array<LargestByPart, kDeviations> largest{};
        float scores = 0, largest_score = 0;
        std::uint32_t largest_part = 0;
        std::uint16_t count = 0, hords = 0;
        std::array<float, 2> gradients{};  // EMD, Frobenius norm
        std::array<LargestByPart, 2> largest_gradients{};
    };
    struct Tails {
        std::vector<std::int16_t> edge_class;
        std::vector<LargestByPart> reached;
    };
    [[nodiscard]] double values(std::size_t k, std::size_t deviation) const {
        return deviation == 0 ? sums_[k].count : sums_[k].hords;
    }
    [[nodiscard]] std::vector<float> local_spread(std::size_t deviation, double parts) const;
    // `largest_of(k)`: the largest values of lenslet k.
    template <class LargestOf>
    [[nodiscard]] std::vector<LargestByPart> reached(std::span<const std::int16_t> edge_class,
                                                     const LargestOf& largest_of) const;
    [[nodiscard]] std::vector<float> usual_gradient(std::size_t which, std::span<const std::int16_t> edge_class) const;
    [[nodiscard]] double margin(std::size_t deviation, double parts, std::span<const float> spread, const Tails& tails,
                                bool near_jumps) const;
    [[nodiscard]] float noise(std::size_t k, std::size_t deviation) const;

    Extents extents_;
    std::vector<Sums> sums_;  // one a lenslet
    std::vector<double> chi2_ratios_;
};

}  // namespace hord::algo
