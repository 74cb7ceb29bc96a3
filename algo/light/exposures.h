// Signs that a frame holds two exposures: of the part and of something else (an empty field, the part before).
//
// - Alternation: neighbouring lenslets differ with a period of two (interlaced rows, two taps of a sensor). Central
//   differences skip a lenslet, so no gradient shows it.
// - Undeflected light: lenslets whose light is deflected far also have a spot where the free light is.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo {

// The strongest alternation in a block of kAlternationBlock x kAlternationBlock lenslets, along rows, columns or both
// (a checkerboard): half the difference between the two kinds of lenslets. 0: none. Every second row and column is
// read.
struct Alternation {
    double bins = 0;   // of the mean deflection, bin pitches
    double light = 0;  // of the light, relative to its mean

    [[nodiscard]] Alternation or_stronger(const Alternation& other) const {
        return {std::max(bins, other.bins), std::max(light, other.light)};
    }
};

constexpr int kAlternationBlock = 8;
constexpr int kMinAlternating = 12;         // lenslets with both neighbours, of the 24 that are read of a block
constexpr double kAlternatingShare = 0.95;  // of these must deviate in turn: a line, such as a scratch, does not

// Over the lenslets of rows first_row to last_row - 1 that have a HORD and are judged. first_row, and last_row unless
// it is the field's end, are multiples of kAlternationBlock. Spans: one value a lenslet of the field, row by row.
Alternation alternation(const Extents& extents, std::span<const Deflection> deflections,
                        std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, int first_row,
                        int last_row);

// Median share of the light, 0..1, that stays within 1.5 bins of the free light's place (`x`, `y`: bin pitches from the
// middle of the bins), over lenslets with a tenth of their light, and kFarShare of their light beyond 1.5 bins, farther
// than kFarBins from there (the larger of |x| and |y|). `lenslets`: indices; the first kMaxFar that do are used.
// `dark_dn` is subtracted from every sample. 0 if fewer than kMinFar do, and for less than 9 x 9 bins.
double undeflected_share(const FrameView& frame, const Extents& extents, std::uint32_t dark_dn,
                         std::span<const std::uint32_t> lenslets, double x, double y);

// Share, 0..1, of the lenslets (indices) whose light lies at opposite edges of the bins: in the outermost columns, or
// the outermost rows, in each twice what the middle has, and a tenth of all. A spot that the macro-pixels cut in two
// looks so. `dark_dn` is subtracted from every sample.
double split_share(const FrameView& frame, const Extents& extents, std::uint32_t dark_dn,
                   std::span<const std::uint32_t> lenslets);

constexpr double kFarBins = 2.5, kFarShare = 0.8;
constexpr std::size_t kMinFar = 16, kMaxFar = 256;

}  // namespace hord::algo
