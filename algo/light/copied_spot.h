// A fainter copy of a spot beside it (a ghost), whose light blends with the spot's: its share by cumulants.
//
// A spot with a copy is the spot convolved with two points. Cumulants of a convolution add, and a spot that is
// symmetric has none of third and fifth order. So these are the two points' alone, whatever the width of the spot:
//   k3 = v sqrt(1 - 4 v) d^3,   k5 = (1 - 12 v) d^2 k3,   v = s (1 - s),
// with the copy's share s of all light at the distance d.
// Two copies on opposite sides cancel in these. They raise the cumulants of even order, by those of three points:
//   k4 = s (1 - 3 s) d^4,   k6 = s (1 - 15 s + 30 s^2) d^6,
// with the share s of both. One spot has hardly any: a Gaussian none, an even disc of the radius r -r^4 / 16, a narrow
// one that three bins share at most 1/12 bin^4, as two copies of 0.5 % two bins away. docs/notes/inspection.md, "Near
// ghosts".
#pragma once

#include <span>

namespace hord::algo {

constexpr double kMinCopyBins = 2;    // a copy nearer than this is the spot's shape
constexpr int kMinBinsForCopies = 7;  // of the axis

// `axis`: light of the columns or rows, without pedestal and noise. `core`: middle of the main spot, bins from the
// first; `half_core`: bins; what the bins' width makes of the skewness there is the spot's own. The light repeats every
// axis.size() bins, because all lenslets show the same: the light that a copy sends into the next lenslet lies at the
// other end. 0 for less than kMinBinsForCopies bins. Exact to 0.0125 for shares up to 0.1; above it
// the cumulants hardly change with the share. Two copies on opposite sides are found up to 1/6, less by at most 0.03 if
// the spot is a disc of 1.2 bins radius.
double copied_share(std::span<const double> axis, double core, double half_core);

}  // namespace hord::algo
