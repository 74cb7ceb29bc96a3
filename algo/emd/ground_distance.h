// Ground distance: the cost c(k,l) of moving light from one angular bin to another (Eqs. 9-11).
//
// The paper leaves open c and the direction r(i,j) of a bin. Here r is the bin's index (one bin pitch apart), or comes
// from a calibrated direction map in bin pitches. c is a norm of the difference of directions, optionally limited to a
// threshold. Costs are doubles in bin pitches (squared_euclidean: squared), exactly symmetric, zero on the diagonal.
//
// euclidean and manhattan, limited or not, are metrics: mass that two HORDs share never needs to move.
// squared_euclidean is none: shared mass may move in an optimal plan and must be kept.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "common/result.h"

namespace hord::algo {

enum class GroundNorm : std::uint8_t { euclidean, manhattan, squared_euclidean };

// Direction of the light of a bin, in bin pitches.
struct Direction {
    double x = 0;
    double y = 0;
};

class GroundDistance {
  public:
    static constexpr double kNoThreshold = std::numeric_limits<double>::infinity();
    static constexpr double kMaxDirection = 1e6;  // bin pitches

    // Bins one pitch apart: r(i,j) = (i, j). Fails with invalid_argument when bins_i or bins_j is not 3..15, or
    // the threshold is not positive.
    static Result<GroundDistance> between_bins(int bins_i, int bins_j, GroundNorm norm = GroundNorm::euclidean,
                                               double threshold = kNoThreshold);

    // One direction per bin, j outer, i inner. Coincident directions are allowed (moving between them is free).
    // Fails as above, and when there are not bins_i * bins_j directions, or one is not finite or larger than
    // kMaxDirection.
    static Result<GroundDistance> between_directions(int bins_i, int bins_j, std::span<const Direction> directions,
                                                     GroundNorm norm = GroundNorm::euclidean,
                                                     double threshold = kNoThreshold);

    [[nodiscard]] int bins_i() const { return bins_i_; }
    [[nodiscard]] int bins_j() const { return bins_j_; }
    [[nodiscard]] int bins() const { return bins_i_ * bins_j_; }
    [[nodiscard]] GroundNorm norm() const { return norm_; }
    [[nodiscard]] double threshold() const { return threshold_; }
    [[nodiscard]] bool is_metric() const { return norm_ != GroundNorm::squared_euclidean; }
    [[nodiscard]] std::span<const Direction> directions() const { return directions_; }

    // The cost between bins p and q (numbered j*I + i), and all costs from bin p.
    [[nodiscard]] double operator()(int p, int q) const { return row(p)[q]; }
    [[nodiscard]] const double* row(int p) const { return cost_.data() + p * bins(); }
    [[nodiscard]] double largest() const { return largest_; }

  private:
    GroundDistance() = default;
    int bins_i_ = 0;
    int bins_j_ = 0;
    GroundNorm norm_ = GroundNorm::euclidean;
    double threshold_ = kNoThreshold;
    double largest_ = 0;
    std::vector<Direction> directions_;
    std::vector<double> cost_;  // bins x bins
};

}  // namespace hord::algo
