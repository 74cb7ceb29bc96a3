// The W1 distance of two HORDs projected onto a line. It bounds the earth mover's distance from below.
//
// In one dimension the distance is the integral of |F_a - F_b| (cumulative sums). Over the common denominator F_a - F_b
// is an exact integer below 2^49, held in a double. Only the at most 224 products and their sum round: relative error
// below 2^-44.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algo/emd/ground_distance.h"
#include "algo/frame/occupied_bins.h"

namespace hord::algo {

// The bins in which two HORDs differ: mass[k] = d = a * S_b - b * S_a of bin[k].
struct Difference {
    int count = 0;
    std::array<std::uint8_t, kMaxBinCount> bin;
    std::array<double, kMaxBinCount> mass;
};

class Projection {
  public:
    // (x, y): direction of the line, a unit vector.
    Projection(std::span<const Direction> directions, double x, double y);

    // W1 of the projections, times the common denominator.
    [[nodiscard]] double distance(const Difference& d) const;

  private:
    std::vector<std::uint8_t> place_of_bin_;  // rank along the line; bins at the same point share one
    std::vector<double> gap_;                 // distance from a rank to the next, bin pitches
};

}  // namespace hord::algo
