// Lenslets beside a jump of the reference: half a bin of deflection or a tenth of the light between neighbours, and two
// lenslets around it. How far good parts deviate there depends on where the edge lies between the lenslets.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "algo/reference/reference.h"

namespace hord::algo {

constexpr int kEdgeReach = 2;      // lenslets
constexpr int kMaxEdgeLevel = 15;  // of a jump: it is 2^level times the least
constexpr std::size_t kEdgeClasses = (kMaxEdgeLevel + 1) * (kEdgeReach + 1);

// The class of each lenslet by the size of the jump and its distance; -1: none is near.
std::vector<std::int16_t> edge_classes(const Reference& reference);

}  // namespace hord::algo
