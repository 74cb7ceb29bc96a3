// A whole row of bins at once: the decode of 8-bit lenslets whose bins lie in rows and columns, with the integer
// instructions of AVX2. Used by algo/frame/resample.cpp only.
//
// Where a lenslet's first bin starts, to 1/32 px, decides all about x: which pixels its bins read, and with which
// weights. That is kept for each of the 32 phases as two shuffles of 16 pixels and their weights. Each raw row is
// shuffled and weighed once (a pair of taps in one instruction), then each row of bins weighs its raw rows.
//
// Formats, as in algo/frame/resample.h: weights are Q0.7, a phase's sum to 128. A pair of taps fits 16 bits: at most
// 255 * 128 = 32640 < 2^15. Raw rows times weights fit 32: 32640 * 128 < 2^23. The sums are those of Resampler::bin(),
// to the bit.
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
        bool usable = false;      // false: a weight of 128 does not fit a signed byte
        std::int32_t second = 0;  // the pixel where the window of bins 8 and up starts, from the first's
        std::array<std::uint8_t, 32> shuffle[2];  // of taps 0 and 1, 2 and 3; bins 0 to 7, then 8 to 15
        std::array<std::int8_t, 32> weight[2];
    };
    std::vector<Phase> phases;  // empty: bins too wide for this
    int rows = 0;               // raw rows that a lenslet may touch
};

// `column` and `row`: the bins' places in 1/32 px; `weights_x`: kPhases x taps. An empty plan where it cannot be done.
LanePlan plan_lanes(std::span<const std::int32_t> column, std::span<const std::int32_t> row,
                    std::span<const std::uint8_t> weights_x, int taps_x, int taps_y);

// One lenslet. `first` is the first bin's first pixel in the first raw row; 16 pixels from it and from `phase.second`
// on are read in each of the raw rows. Writes 16 samples from the start of each line of `out`: what is beyond the bins
// is garbage.
struct LanesOf8Bit {
    const std::byte* first;
    std::ptrdiff_t row_bytes;
    int place_y_fraction;               // of the first bin's row, 1/32 px
    std::span<const std::int32_t> row;  // of the bins, 1/32 px
    const std::uint8_t* weights_y;      // kPhases x taps_y
    int taps_x, taps_y;
};
using DecodeLanes = void (*)(const LanesOf8Bit& lenslet, const LanePlan::Phase& phase, std::uint16_t* out,
                             std::ptrdiff_t stride);

// Null where this processor has no AVX2.
DecodeLanes decode_lanes();

}  // namespace hord::algo
