// A HORD by its lit bins alone, closed up: most lenslets have few, and each is compared with four neighbours. Its lit
// bins are found once, and a difference is one vector, where find_residual() would look at every bin of both for every
// pair.
//
// Formats, ranges: a mass is below 2^16 and at most its HORD's sum, so that where S_a * S_b < 2^31 (kLightMass of
// algo/emd/residual.h) both products of d = a * S_b - b * S_a, d, and the sum of what has too much, are std::int32_t;
// pairs of more light are left to find_residual(). Lit bins are one word, from the first on: 48 of them, moved by at
// most 16, are at most 64, and none is lost. The same integers on every instruction set. Test:
// tests/algo/emd/sparse_hord_test.cpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/emd/transport_batch.h"
#include "algo/frame/hord.h"
#include "algo/simd/aligned.h"
#include "algo/simd/isa.h"

namespace hord::algo {

constexpr int kMaxSparseBins = 8;  // bins that are lit in one, or in either of two
constexpr int kClosedSpan = 48;    // from the first lit bin to the last
constexpr int kClosedApart = 16;   // the first lit bins of two

// One cache line. A HORD with more lit bins, or farther apart, or none, is not closed up: only hord() is of use.
struct alignas(kAlignment) SparseHord {
    static constexpr std::uint32_t kNotClosed = 1U << 31;

    const std::uint16_t* masses = nullptr;
    std::uint32_t sum = 0;
    std::uint32_t closed_sum = kNotClosed;  // the sum again, or kNotClosed: whatever it is multiplied with is not light
    // Of the lit bins, in order; what is behind them means nothing. Where it is not closed up, nothing does.
    std::uint64_t lit = 0;  // bit k: bin[0] + k is lit
    std::array<std::int32_t, kMaxSparseBins> mass{};
    std::array<std::uint8_t, kMaxSparseBins> bin{};

    [[nodiscard]] Hord hord() const { return {masses, sum}; }
    [[nodiscard]] bool is_closed() const { return closed_sum != kNotClosed; }
};
static_assert(sizeof(SparseHord) == kAlignment);

// The difference of two, over the common denominator.
struct alignas(kAlignment) ClosedDifference {
    std::int32_t
        more[kMaxSparseBins];  // of bins lit in either, in order, then zeros: above 0 where the first has too much
    std::uint8_t bin[kMaxSparseBins];
    std::int32_t denominator;  // S_a * S_b
    double* out;               // where the answer goes; not looked at here
};
static_assert(sizeof(ClosedDifference) == kAlignment);

// HORDs of `bins` bins, the masses of one after those of the other, as many as there are sums; valid while hord() is
// used: until submit() returns.
using CloseUp = void (*)(const std::uint16_t* masses, std::span<const std::uint32_t> sums, int bins, SparseHord* to);

// With AVX2; elsewhere nothing is closed up: bit by bit it would cost more than it saves.
struct SparseKernels {
    CloseUp compact;
    // How many bins are lit in either. 0: they cannot be compared so, because one is not closed up, they are too far
    // apart or have too much light.
    int (*subtract)(const SparseHord& a, const SparseHord& b, ClosedDifference& to);
    // Puts what has too much and what too little as a problem to those of its shape, which it returns; 0 where nothing
    // has to move.
    std::size_t (*put)(const ClosedDifference& difference, TransportBatches<std::int32_t>& to);
};
SparseKernels sparse_kernels(Isa isa);

}  // namespace hord::algo
