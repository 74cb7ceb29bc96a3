// HORDs reduced to their lit bins, so that a difference is one vector operation (docs/notes/emd.md).
//
// Formats, ranges: a mass is < 2^16 and at most its HORD's sum. So where S_a * S_b < kInt32MassLimit both products of
// d = a * S_b - b * S_a, d, and the sum of a side are std::int32_t; other pairs are left to find_residual(). The same
// integers on every instruction set. Test: tests/algo/emd/sparse_hord_test.cpp.
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

constexpr int kMaxSparseBins = 8;    // lit bins of a HORD, and bins lit in either of a pair
constexpr int kMaxSparseSpan = 48;   // bins from the first lit one to the last
constexpr int kMaxSparseShift = 16;  // bins between the first lit ones of a pair

// One cache line. A HORD that is dark or exceeds the limits above is not compacted: only hord() is valid then.
struct alignas(kAlignment) SparseHord {
    static constexpr std::uint32_t kNotCompacted = 1U << 31;  // times any other sum: not below kInt32MassLimit

    const std::uint16_t* masses = nullptr;
    std::uint32_t sum = 0;
    std::uint32_t compacted_sum = kNotCompacted;      // the sum, or kNotCompacted
    std::uint64_t lit = 0;                            // bit k: bin[0] + k is lit
    std::array<std::int32_t, kMaxSparseBins> mass{};  // of the lit bins in order, then undefined
    std::array<std::uint8_t, kMaxSparseBins> bin{};

    [[nodiscard]] Hord hord() const { return {masses, sum}; }
    [[nodiscard]] bool is_compacted() const { return compacted_sum != kNotCompacted; }
};
static_assert(sizeof(SparseHord) == kAlignment);

// The difference of two HORDs, over the common denominator.
struct alignas(kAlignment) SparseDifference {
    std::int32_t excess[kMaxSparseBins];  // of the bins lit in either, in order, then zeros; > 0: surplus of the first
    std::uint8_t bin[kMaxSparseBins];
    std::int32_t denominator;  // S_a * S_b
    double* out;               // where the caller wants the distance; not used here
};
static_assert(sizeof(SparseDifference) == kAlignment);

// Compacts as many HORDs of `bins` bins as there are sums; their masses are contiguous and must stay valid until
// submit() returns.
using CompactFunction = void (*)(const std::uint16_t* masses, std::span<const std::uint32_t> sums, int bins,
                                 SparseHord* to);

// Needs AVX2; without it nothing is compacted, because scalar code costs more than it saves.
struct SparseKernels {
    CompactFunction compact;
    // Returns the number of bins lit in either; 0 if the pair cannot be compared so: one HORD is not compacted, their
    // first bins are too far apart, or S_a * S_b is not below kInt32MassLimit.
    int (*subtract)(const SparseHord& a, const SparseHord& b, SparseDifference& to);
    // Adds the difference as a problem to the batch of its shape. Returns the shape, or 0 if nothing has to move. Sets
    // *out to the denominator, or to 0.
    std::size_t (*put)(const SparseDifference& difference, TransportBatches<std::int32_t>& to);
};
SparseKernels sparse_kernels(Isa isa);

}  // namespace hord::algo
