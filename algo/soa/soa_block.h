// Sixteen lenslets in a structure-of-arrays (SoA) layout: finds and gathers their lit bins, adds them up, and computes
// shares or marginals. Most bins are dark in all of sixteen neighbouring lenslets; only their line is scanned.
//
// Masses and sums are exact integers, uint16 inside for 8-bit samples (docs/notes/features.md); sums and moments of a
// lenslet are int32 (algo/frame/decode.h). The order of operations does not depend on the instruction set.
// Test: tests/algo/soa/soa_distances_test.cpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/frame/decode.h"
#include "algo/frame/occupied_bins.h"
#include "algo/simd/aligned.h"
#include "algo/simd/isa.h"

namespace hord::algo {

struct SoaBlock {
    static constexpr int kLanes = 16;      // lenslets
    static constexpr int kReadAhead = 64;  // samples that may be read after the last of a line

    using Lit = std::array<std::uint64_t, (kMaxBinCount + 63) / 64>;

    // What is computed besides the sums.
    struct Outputs {
        bool masses;   // of the lit bins
        bool margins;  // sums per column and per line
        bool moments;
    };

    // Lanes beyond the last lenslet are 0. Outputs not requested are undefined, except moments: 0.
    alignas(kAlignment) std::int32_t column[kMaxBins][kLanes];  // sum of each bin column
    std::int32_t line[kMaxBins][kLanes];                        // sum of each line
    std::int32_t sum[kLanes], moment_x[kLanes], moment_y[kLanes];
    std::int32_t saturated[kLanes];
    std::uint8_t mask[kLanes];
    float inverse[kLanes];  // 1 / sum; 0 without a HORD
    Lit lit;                // bins lit in any of the lenslets
    int count = 0;          // elements of `bin` and `mass`; one more is written
    std::uint8_t bin[kMaxBinCount + 1];
    alignas(kAlignment) std::uint16_t mass[kMaxBinCount + 1][kLanes];

    template <class Sample>
    using Gather = void (*)(const Sample* samples, std::ptrdiff_t stride, const Extents& extents,
                            const LightLevels& levels, Outputs outputs, SoaBlock& block);
    // Write to arrays `stride` apart: h of the lit bins or its square roots; cumulative marginals, I-1 along x, J-1
    // along y.
    using Shares = void (*)(const SoaBlock& block, std::size_t stride, bool roots, float* first);
    using Marginals = void (*)(const SoaBlock& block, const Extents& extents, std::size_t stride, float* first);
    struct Kernels {
        Gather<std::uint8_t> gather8;
        Gather<std::uint16_t> gather16;
        Shares shares;
        Marginals marginals;
    };
    static Kernels kernels(Isa isa);
};

}  // namespace hord::algo
