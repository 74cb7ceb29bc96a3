// Light that a HORD no longer shows: the sum of a lenslet relative to the part's typical lenslet.
//
// Dividing by the sum (Eq. 8) erases absorption and hides a lenslet that is only partly covered, so the sums are kept
// beside the HORDs. Typical is the median sum over the part's lenslets that have a HORD and are judged: defects and
// rim do not move it as long as they are less than half. Unit: 1 is typical; 0 is no light. Never negative; a sum of at
// most 2^24 over a typical of at least 1 stays finite. A lenslet without a HORD because it is dark does have
// a transmission (that is how it is found); a saturated one has none: 0.
#pragma once

#include <cstdint>
#include <span>

namespace hord::algo {

// Median (the lower one of an even number) of the sums whose mask is kValid or kBorder; 0 when there is none.
// `scratch` is as long as `sums`.
std::uint32_t typical_light(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask,
                            std::span<std::uint32_t> scratch);

// typical 0: all 0.
void transmissions(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, std::uint32_t typical,
                   std::span<float> out);

}  // namespace hord::algo
