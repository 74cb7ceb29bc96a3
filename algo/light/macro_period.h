// The period of a frame's macro-pixels, found by folding: does the image repeat every I columns and J rows?
//
// Column sums (over bands of rows) and row sums (over bands of columns) are cut into windows of kWindow samples. A fold
// at period p explains 1 - (R / (W - p)) / (S / (W - 1)) of a window of W samples: S is the sum of squares about its
// mean, R what the fold leaves of it. Windows are summed up; short ones follow light that a part deflects smoothly. The
// result is the expected period unless another one contradicts it. Derivation and limits: docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo {

struct MacroPeriod {
    int x = 0, y = 0;      // samples between repetitions, 2..kMaxBins; 0: none is clear
    bool expected = true;  // no clear period contradicts the extents' I and J
};

class MacroPeriodFinder {
  public:
    static constexpr int kWindow = 60;    // samples: a multiple of most periods, four of the longest
    static constexpr int kBands = 12;     // of rows, and of columns
    static constexpr int kBandRows = 30;  // samples; holds every phase of every period

    // Allocates all memory.
    explicit MacroPeriodFinder(const Extents& extents);

    // `frame` has the extents' size.
    MacroPeriod find(const FrameView& frame);

  private:
    template <class Sample>
    void sum(const FrameView& frame);

    Extents extents_;
    std::vector<int> first_columns_, first_rows_;  // of the bands
    int band_columns_, band_rows_;                 // their width and height
    std::vector<std::uint32_t> columns_, rows_;    // sums of each column and row
};

// The period of one profile, samples: `expected` unless another one contradicts it, that one, or 0 if none is clear or
// the profile is too short.
int period_of(std::span<const std::uint32_t> profile, int expected);

}  // namespace hord::algo
