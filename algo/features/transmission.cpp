#include "algo/features/transmission.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "algo/frame/decode.h"
#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

// The values of two ranks in ascending order, as common::nth_smallest() gives them. By counting: the upper and the
// lower half of the bits of a sum, which is below 2^24. Sums of a field are close together, so that comparing takes
// longer.
constexpr unsigned kHalfBits = 12;
static_assert(kSumLimit <= 1U << (2 * kHalfBits));

std::pair<std::uint32_t, std::uint32_t> of_ranks(std::span<const std::uint32_t> values, std::size_t a, std::size_t b) {
    std::array<std::uint32_t, std::size_t{1} << kHalfBits> upper{}, lower{};
    for (const std::uint32_t v : values) ++upper[v >> kHalfBits];
    // The first count with which more than `rank` are counted; `rank` becomes that within it.
    const auto find = [](std::span<const std::uint32_t> counts, std::size_t& rank) {
        std::uint32_t at = 0;
        for (; rank >= counts[at]; ++at) rank -= counts[at];
        return at;
    };
    const auto of_rank = [&](std::size_t rank) {
        const std::uint32_t half = find(upper, rank);
        lower.fill(0);
        for (const std::uint32_t v : values) {
            if (v >> kHalfBits == half) ++lower[v & ((1U << kHalfBits) - 1)];
        }
        return half << kHalfBits | find(lower, rank);
    };
    const std::uint32_t of_a = of_rank(a);
    return {of_a, of_rank(b)};
}

}  // namespace

std::uint32_t typical_light(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, float limit,
                            std::span<std::uint32_t> scratch) {
    std::size_t count = 0;
    for (std::size_t k = 0; k < sums.size(); ++k) {  // branch-free: every sum is stored, some stay
        scratch[count] = sums[k];
        count += (mask[k] & (kNoHord | kNotJudged)) == 0 ? 1 : 0;
    }
    if (count == 0) return 0;
    const auto judged = scratch.first(count);
    const auto [median, bright] = of_ranks(judged, (count - 1) / 2, count * 9 / 10);
    return static_cast<float>(median) < limit * static_cast<float>(bright) ? bright : median;
}

void transmissions(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, std::uint32_t typical,
                   std::span<float> out) {
    if (typical == 0) {
        std::ranges::fill(out.first(sums.size()), 0.0F);
        return;
    }
    const auto of_typical = static_cast<float>(typical);
    for (std::size_t k = 0; k < sums.size(); ++k) {
        // A sum is below 2^24; from signed numbers vectors convert faster.
        const float share = static_cast<float>(static_cast<std::int32_t>(sums[k])) / of_typical;
        out[k] = (mask[k] & kSaturated) == 0 ? share : 0.0F;
    }
}

}  // namespace hord::algo
