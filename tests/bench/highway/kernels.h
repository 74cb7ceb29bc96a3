// Two kernels of the kind that algo/ has, once with algo/simd and once with Google Highway: what docs/adr/0011
// compares.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/simd/isa.h"

namespace hord::bench {

constexpr int kLanes = 16;
using Lit = std::array<std::uint64_t, 4>;  // lit bins, a bit each

// The index of the first lane whose value is `least`: its row times 16 plus its lane.
inline int first_of(const float* values, const std::int32_t* rows, float least) {
    for (int l = 0; l < kLanes; ++l) {
        if (values[l] == least) return rows[l] * kLanes + l;
    }
    return -1;
}

// chi2 terms of 16 lenslets, summed over the lit bins; bin k at a[k * stride].
void ours_chi2(const float* a, const float* b, std::size_t stride, const Lit& lit, float* out, algo::Isa isa);
void highway_chi2(const float* a, const float* b, std::size_t stride, const Lit& lit, float* out);

// The least reduced cost (cost - u - v) of rows x 16, and where it is.
int ours_cheapest(const float* cost, const float* v, float u, int rows, float* value, algo::Isa isa);
int highway_cheapest(const float* cost, const float* v, float u, int rows, float* value);

// Makes Highway take this target (HWY_AVX2 ...) alone.
void choose_highway_target(std::int64_t target);

}  // namespace hord::bench
