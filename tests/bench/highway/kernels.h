// Two kernels typical of algo/, once with algo/simd and once with Google Highway; docs/adr/0011 compares them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/simd/isa.h"

namespace hord::bench {

constexpr int kLanes = 16;
using Lit = std::array<std::uint64_t, 4>;  // bit set of the lit bins

// The position of the first lane whose value is `least`: row * 16 + lane.
inline int first_of(const float* values, const std::int32_t* rows, float least) {
    for (int l = 0; l < kLanes; ++l) {
        if (values[l] == least) return rows[l] * kLanes + l;
    }
    return -1;
}

// chi2 terms of 16 lenslets, summed over the lit bins; bin k at a[k * stride].
void ours_chi2(const float* a, const float* b, std::size_t stride, const Lit& lit, float* out, algo::Isa isa);
void highway_chi2(const float* a, const float* b, std::size_t stride, const Lit& lit, float* out);

// The smallest reduced cost (cost - u - v) of rows x 16, and its position.
int ours_cheapest(const float* cost, const float* v, float u, int rows, float* value, algo::Isa isa);
int highway_cheapest(const float* cost, const float* v, float u, int rows, float* value);

// Restricts Highway to one target (HWY_AVX2 ...).
void choose_highway_target(std::int64_t target);

}  // namespace hord::bench
