#include "algo/features/transmission.h"

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {

std::uint32_t typical_light(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, float limit,
                            std::span<std::uint32_t> scratch) {
    std::size_t count = 0;
    for (std::size_t k = 0; k < sums.size(); ++k) {
        if ((mask[k] & (kNoHord | kNotJudged)) == 0) scratch[count++] = sums[k];
    }
    if (count == 0) return 0;
    const auto judged = scratch.first(count);
    const std::uint32_t median = common::lower_median(judged), bright = common::nth_smallest(judged, count * 9 / 10);
    return static_cast<float>(median) < limit * static_cast<float>(bright) ? bright : median;
}

void transmissions(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, std::uint32_t typical,
                   std::span<float> out) {
    for (std::size_t k = 0; k < sums.size(); ++k) {
        const bool known = typical > 0 && (mask[k] & kSaturated) == 0;
        out[k] = known ? static_cast<float>(sums[k]) / static_cast<float>(typical) : 0.0F;
    }
}

}  // namespace hord::algo
