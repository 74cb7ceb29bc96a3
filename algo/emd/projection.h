// HORDs seen along a line: the W1 distance of two projections, from which bounds of the earth mover's distance are
// made.
//
// In one dimension the distance is the integral of |F_a - F_b| (cumulative sums). Over the common denominator the
// difference is an exact integer: |sum of d| < 2^49, held in a double. Rounding is that of at most 224 products and
// sums: relative error below 2^-44.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algo/emd/ground_distance.h"
#include "algo/frame/occupied_bins.h"

namespace hord::algo {

// Bins in which two HORDs differ: d = a * S_b - b * S_a.
struct Difference {
    int count = 0;
    std::array<std::uint8_t, kMaxBinCount> bin;
    std::array<double, kMaxBinCount> mass;
};

class Projection {
  public:
    // Onto the line of direction (x, y).
    Projection(std::span<const Direction> directions, double x, double y);

    // W1 of the projections, times the common denominator.
    [[nodiscard]] double distance(const Difference& d) const;

  private:
    std::vector<std::uint8_t> place_of_bin_;  // its place in the order along the line; bins at the same spot share one
    std::vector<double> gap_;                 // from a place to the next
};

}  // namespace hord::algo
