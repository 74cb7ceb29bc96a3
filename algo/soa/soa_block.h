// Sixteen lenslets side by side, worked on at once: their lit bins are found and gathered, added up, and made into
// shares or marginals. Most bins are dark in all of sixteen neighbouring lenslets: those cost a look at their line.
//
// Numbers, all exact integers until a share is made:
//   samples of one byte   a mass < 2^8; sums over a line, a column or a lenslet <= 15 * 15 * 255 < 2^16: words without
//   a sign. A line's moment along
//                         x is at most 255 * (14 + 12 + ... + 2) = 14280 half bins times DN < 2^15, of either sign:
//                         words with one
//   of two bytes          a mass < 2^16; sums < 2^24, moments < 14 * 2^24 < 2^28: 32 bits
// Sums and moments of a lenslet are 32 bits in either case (algo/frame/decode.h). Whatever the instruction set, the
// same operations come in the same order.
//
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

    // Beside the sums.
    struct Wanted {
        bool masses;   // the lit bins'
        bool margins;  // sums by column and by line
        bool moments;
    };

    // Lanes of lenslets that are not there are 0. What is not wanted holds no meaning, moments apart: they are 0.
    alignas(kAlignment) std::int32_t column[kMaxBins][kLanes];  // sums over the lines, of each bin column
    std::int32_t line[kMaxBins][kLanes];                        // and over the columns, of each line
    std::int32_t sum[kLanes], moment_x[kLanes], moment_y[kLanes];
    std::int32_t saturated[kLanes];
    std::uint8_t mask[kLanes];
    float inverse[kLanes];  // 1 / sum; 0 without a HORD
    Lit lit;                // bins lit in any of the lenslets
    int count = 0;          // those bins, and their masses; one more is written than counts
    std::uint8_t bin[kMaxBinCount + 1];
    alignas(kAlignment) std::uint16_t mass[kMaxBinCount + 1][kLanes];

    template <class Sample>
    using Gather = void (*)(const Sample* samples, std::ptrdiff_t stride, const Extents& extents,
                            const LightLevels& levels, Wanted wanted, SoaBlock& block);
    static Gather<std::uint8_t> gather8(Isa isa);
    static Gather<std::uint16_t> gather16(Isa isa);

    // Into planes `stride` apart: h of the lit bins or its roots; cumulative marginals, I-1 along x and J-1 along y.
    using Shares = void (*)(const SoaBlock& block, std::size_t stride, bool roots, float* first);
    static Shares shares(Isa isa);
    using Marginals = void (*)(const SoaBlock& block, const Extents& extents, std::size_t stride, float* first);
    static Marginals marginals(Isa isa);
};

}  // namespace hord::algo
