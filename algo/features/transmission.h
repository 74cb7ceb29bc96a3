// Transmission: the sum of a lenslet relative to the part's typical lenslet.
//
// Dividing by the sum (Eq. 8) removes absorption and partial cover from a HORD, so sums are kept beside the HORDs.
// Typical is the median sum of the part's lenslets that have a HORD and are judged: defects and rim do not move it
// while they are less than half. If the median is itself below the limit of the transmission, measured by the light
// that a tenth of these lenslets exceeds, then that light is typical: most of the part is covered or absorbs. Unit: 1
// is typical, 0 is no light. Never negative; finite: sums are at most 2^24, typical at least 1. Dark lenslets have a
// transmission although they have no HORD; saturated ones get 0.
#pragma once

#include <cstdint>
#include <span>

namespace hord::algo {

// Of the sums whose mask is kValid or kBorder; 0 if there is none. `limit`: the least transmission, 0 (off) to 1.
// `scratch`: as long as `sums`.
std::uint32_t typical_light(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, float limit,
                            std::span<std::uint32_t> scratch);

// If `typical` is 0, all are 0.
void transmissions(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, std::uint32_t typical,
                   std::span<float> out);

}  // namespace hord::algo
