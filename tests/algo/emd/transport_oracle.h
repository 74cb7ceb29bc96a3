// The exact distance by LEMON's network simplex, on the whole histograms, without cancelling or compacting.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/emd/ground_distance.h"

namespace hord::algo::testing {

double lemon_distance(const std::vector<std::uint16_t>& a, const std::vector<std::uint16_t>& b,
                      const GroundDistance& ground);

}  // namespace hord::algo::testing
