// Decodes whole rows of bins of 8-bit lenslets whose bins lie in rows and columns, with AVX2. Used by
// algo/frame/resample.cpp only. How: docs/notes/decoding.md.
//
// Formats as in algo/frame/resample.h; a pair of taps fits 16 bits, raw rows times weights fit 32. The same integers as
// Resampler::bin().
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace hord::algo {

struct LanePlan {
    static constexpr int kPhases = 32;
    static constexpr int kMaxTaps = 4;
    static constexpr int kMaxRows = 48;  // raw rows under a lenslet
    static constexpr int kWindow = 16;   // pixels that one shuffle reads

    struct Phase {
        std::int32_t second = 0;                  // first pixel of the window of bins 8 and up, from that of bin 0
        std::array<std::uint8_t, 32> shuffle[2];  // of taps 0 and 1, 2 and 3; bins 0 to 7, then 8 to 15
        std::array<std::int8_t, 32> weight[2];
    };
    // A row of bins of at most three taps that are not 0. `base` has the largest weight, the others w at most 64. With
    // 128 as the sum of the weights, (sum of weight * tap) / 128 = base + (sum of w (other - base)) / 128, in 16 bits.
    struct RowPhase {
        std::uint8_t base = 0, other[2] = {};  // taps
        std::int16_t factor[2] = {};           // -512 w, for the upper half of a product; 0: none
        std::int16_t weight[2] = {};           // -w, for the lower half
    };
    std::vector<Phase> phases;  // empty: bins are too wide
    std::array<RowPhase, kPhases> row_phases;
    bool two_pairs = false;  // the weight of tap 2 or 3 along x is not 0 somewhere
    int row_taps = 0;        // most taps along y that are not 0
    int rows = 0;            // raw rows under a lenslet, at most
};

// `column`, `row`: positions of the bins, 1/32 px; `weights_x`, `weights_y`: kPhases x taps. Returns an empty plan if
// bins are too wide.
LanePlan plan_lanes(std::span<const std::int32_t> column, std::span<const std::int32_t> row,
                    std::span<const std::uint8_t> weights_x, std::span<const std::uint8_t> weights_y, int taps_x,
                    int taps_y);

// One lenslet. `first` is the first pixel of the first bin in the first raw row. Reads 16 pixels from `first` and from
// `first + phase.second` in each raw row. Writes 16 samples to each line of `out`; those beyond the bins are undefined.
struct LanesOf8Bit {
    const std::byte* first;
    std::ptrdiff_t row_bytes;
    int place_y_fraction;               // of the first bin's row, 1/32 px
    std::span<const std::int32_t> row;  // of the bins, 1/32 px
    const std::uint8_t* weights_y;      // kPhases x taps_y
    int taps_y;
    std::span<const LanePlan::RowPhase> row_phases;
};
using DecodeLanes = void (*)(const LanesOf8Bit& lenslet, const LanePlan::Phase& phase, std::uint8_t* out,
                             std::ptrdiff_t stride);

// The kernel for the plan's taps. Null if the plan is empty, or this processor has no AVX2.
DecodeLanes decode_lanes(const LanePlan& plan);

}  // namespace hord::algo
