#include "algo/features/transmission.h"

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {

std::uint32_t typical_light(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask,
                            std::span<std::uint32_t> scratch) {
    std::size_t count = 0;
    for (std::size_t k = 0; k < sums.size(); ++k) {
        if ((mask[k] & (kNoHord | kNotJudged)) == 0) scratch[count++] = sums[k];
    }
    if (count == 0) return 0;
    return common::lower_median(scratch.first(count));
}

void transmissions(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, std::uint32_t typical,
                   std::span<float> out) {
    for (std::size_t k = 0; k < sums.size(); ++k) {
        const bool known = typical > 0 && (mask[k] & kSaturated) == 0;
        out[k] = known ? static_cast<float>(sums[k]) / static_cast<float>(typical) : 0.0F;
    }
}

}  // namespace hord::algo
