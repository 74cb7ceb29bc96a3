#include "algo/reference/map_reader.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "algo/reference/pose.h"

namespace hord::algo {

bool CubicReader::move_to(double m, double n) {
    const double floor_m = std::floor(m), floor_n = std::floor(n);
    const int first_m = static_cast<int>(floor_m) - 1, first_n = static_cast<int>(floor_n) - 1;
    if (first_m < 0 || first_n < 0 || first_m + 3 >= extents_.m || first_n + 3 >= extents_.n) return false;
    corner_ = extents_.index(first_m, first_n);
    const auto keep = [](const CubicWeights& from, float(&to)[4]) {
        for (int k = 0; k < 4; ++k) to[k] = static_cast<float>(from.of[k]);
    };
    keep(CubicWeights::at(m - floor_m), wm_), keep(CubicWeights::at(n - floor_n), wn_);
    keep(CubicWeights::slope_at(m - floor_m), dm_), keep(CubicWeights::slope_at(n - floor_n), dn_);
    return true;
}

std::uint8_t CubicReader::mask() const {
    std::uint32_t all = 0;
    for (std::size_t r = 0; r < 4; ++r) {
        std::uint32_t row = 0;
        std::memcpy(&row, mask_.data() + corner_ + r * static_cast<std::size_t>(extents_.m), sizeof row);
        all |= row;
    }
    all |= all >> 16U;
    return static_cast<std::uint8_t>(all | all >> 8U);
}

MapAt CubicReader::read(std::span<const float> map) const {
    const float* row[4];
    for (std::size_t r = 0; r < 4; ++r) row[r] = map.data() + corner_ + r * static_cast<std::size_t>(extents_.m);
    float value[4], slope[4];  // of the columns
    for (int c = 0; c < 4; ++c) {
        value[c] = (wn_[0] * row[0][c] + wn_[1] * row[1][c]) + (wn_[2] * row[2][c] + wn_[3] * row[3][c]);
        slope[c] = (dn_[0] * row[0][c] + dn_[1] * row[1][c]) + (dn_[2] * row[2][c] + dn_[3] * row[3][c]);
    }
    const auto along_row = [](const float(&w)[4], const float(&v)[4]) {
        return static_cast<double>((w[0] * v[0] + w[1] * v[1]) + (w[2] * v[2] + w[3] * v[3]));
    };
    MapAt at;
    at.value = along_row(wm_, value), at.by_m = along_row(dm_, value), at.by_n = along_row(wm_, slope);
    const auto outer = [&](int r) { return (row[r][0] - row[r][1]) - (row[r][2] - row[r][3]); };
    const auto inner = [&](int r) { return row[r][1] + row[r][2]; };
    const float along = outer(1) + outer(2), across = (inner(0) - inner(1)) - (inner(2) - inner(3));
    at.curvature = 0.25 * static_cast<double>(std::max(std::abs(along), std::abs(across)));
    return at;
}

}  // namespace hord::algo
