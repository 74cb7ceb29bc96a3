// A fainter copy of a spot beside it (a ghost), whose light blends with the spot's: its share by cumulants.
//
// A spot with a copy is the spot convolved with two points. Cumulants of a convolution add, and a spot that is
// symmetric has none of third and fifth order. So these are the two points' alone, whatever the width of the spot:
//   k3 = v sqrt(1 - 4 v) d^3,   k5 = (1 - 12 v) d^2 k3,   v = s (1 - s),
// with the copy's share s of all light at the distance d. docs/notes/inspection.md, "Near ghosts".
#pragma once

#include <span>

namespace hord::algo {

constexpr double kMinCopyBins = 2;    // a copy nearer than this is the spot's shape
constexpr int kMinBinsForCopies = 7;  // of the axis

// `axis`: light of the columns or rows, without pedestal and noise. `core`: middle of the main spot, bins from the
// first; `half_core`: bins; what the bins' width makes of the skewness there is the spot's own. The light repeats every
// axis.size() bins, because all lenslets show the same: the light that a copy sends into the next lenslet lies at the
// other end. 0 for less than kMinBinsForCopies bins. Exact to 0.0125 for shares up to 0.1; above it
// the cumulants hardly change with the share.
double copied_share(std::span<const double> axis, double core, double half_core);

}  // namespace hord::algo
