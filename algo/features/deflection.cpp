#include "algo/features/deflection.h"

namespace hord::algo {

Deflection mean_deflection(std::uint32_t sum, std::int32_t moment_x, std::int32_t moment_y) {
    return {DeflectionQ::from_raw(quotient_q24(moment_x, sum)), DeflectionQ::from_raw(quotient_q24(moment_y, sum))};
}

void mean_deflections(const HordRow& row, std::span<Deflection> out) {
    for (std::size_t m = 0; m < out.size(); ++m) {
        const bool dark = (row.mask()[m] & kDark) != 0;
        out[m] = dark ? Deflection{} : mean_deflection(row.sums()[m], row.moments_x()[m], row.moments_y()[m]);
    }
}

}  // namespace hord::algo
