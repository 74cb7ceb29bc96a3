#include "algo/deflection.h"

namespace hord::algo {

Deflection mean_deflection(std::uint32_t sum, std::int32_t moment_x, std::int32_t moment_y) {
    constexpr int kReciprocalBits = 52;
    constexpr int kDropped = kReciprocalBits + 1 - DeflectionQ::kFractionBits;  // 1: from half bins to bins
    const std::int64_t reciprocal = (std::int64_t{1} << kReciprocalBits) / sum;
    return {DeflectionQ::from_raw(shift_right_rounded(moment_x * reciprocal, kDropped)),
            DeflectionQ::from_raw(shift_right_rounded(moment_y * reciprocal, kDropped))};
}

void mean_deflections(const HordRow& row, std::span<Deflection> out) {
    for (std::size_t m = 0; m < out.size(); ++m) {
        const bool dark = (row.mask()[m] & kDark) != 0;
        out[m] = dark ? Deflection{} : mean_deflection(row.sums()[m], row.moments_x()[m], row.moments_y()[m]);
    }
}

}  // namespace hord::algo
