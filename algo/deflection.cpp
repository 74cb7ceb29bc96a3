#include "algo/deflection.h"

namespace hord::algo {

Deflection mean_deflection(const Hord& hord, int bins_i, int bins_j) {
    std::int32_t moment_x = 0, moment_y = 0;  // half bins times DN
    const std::uint16_t* mass = hord.mass;
    for (int j = 0; j < bins_j; ++j, mass += bins_i) {
        std::int32_t line_sum = 0, line_moment = 0;
        for (int i = 0; i < bins_i; ++i) {
            line_sum += mass[i];
            line_moment += i * mass[i];
        }
        moment_x += 2 * line_moment - (bins_i - 1) * line_sum;
        moment_y += (2 * j - (bins_j - 1)) * line_sum;
    }
    constexpr int kReciprocalBits = 52;
    constexpr int kDropped = kReciprocalBits + 1 - DeflectionQ::kFractionBits;  // 1: from half bins to bins
    const std::int64_t reciprocal = (std::int64_t{1} << kReciprocalBits) / hord.sum;
    return {DeflectionQ::from_raw(shift_right_rounded(moment_x * reciprocal, kDropped)),
            DeflectionQ::from_raw(shift_right_rounded(moment_y * reciprocal, kDropped))};
}

void mean_deflections(const HordRow& row, const Extents& extents, std::span<Deflection> out) {
    for (int m = 0; m < extents.m; ++m) {
        out[static_cast<std::size_t>(m)] = (row.mask(m) & kDark) == 0 ? mean_deflection(row.hord(m), extents.i, extents.j) : Deflection{};
    }
}

}  // namespace hord::algo
