// The maps by which a part is registered, one value a lenslet.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/features/deflection.h"

namespace hord::algo {

// The reference's. `mask`: no deflection at kDark and kSaturated, no value at kOutside.
struct ReferenceMaps {
    std::span<const float> light;  // DN
    std::span<const float> x, y;   // mean deflection, bin pitches
    std::span<const std::uint8_t> mask;
    std::array<float, 2> size_limits{};  // Reference::size_limits
    std::array<float, 2> blur_limits{};  // Reference::blur_limits
};

// One frame of a part. Of `mask` kDark and kSaturated are used.
struct PartMaps {
    std::span<const Deflection> deflections;
    std::span<const std::uint32_t> sums;
    std::span<const std::uint8_t> mask;
};

}  // namespace hord::algo
