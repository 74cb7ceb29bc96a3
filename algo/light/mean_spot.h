// The mean spot of many lenslets: where it lies, how wide it is, and whether it is one spot.
//
// The samples of the lenslets are averaged bin by bin, so that their noise averages out. What the darkest bins of this
// mean read is subtracted from all (a pedestal; noise that the sensor clips at 0). Then come the moments.
//
// A second spot shows in one of two ways. Far from the main one it stands alone: the main spot holds all bins that can
// be reached from the brightest one, over sides and corners, without climbing by more than kClimb of its light; what is
// brighter than kClimb and cannot be reached is beside it. A near one shares bins with the main one. It makes the spot
// lopsided: more light lies beyond the core on one side than on the opposite one, the mean of all light lies beside the
// middle of the core, and the light is skewed (algo/light/copied_spot.h). Limits and reasons: docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <span>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo {

constexpr double kClimb = 0.02;        // of the brightest bin's light
constexpr double kCoreBins = 1.5;      // half the side of the core, a square about the brightest place
constexpr double kSecondSpotBins = 4;  // distance at which the light of a lopsided spot is counted as a second spot

struct MeanSpot {
    bool measured = false;        // there was light
    double x = 0, y = 0;          // mean deflection, bin pitches, positive to the right and downwards
    double rms_x = 0, rms_y = 0;  // spread about the mean along each axis, bin pitches
    // Share of the light in a second spot, the largest of four: what stands beside the main spot; what lies beyond the
    // core on one side more than on the opposite one; the distance from the core's middle to the mean over
    // kSecondSpotBins; without `centres`, a copy of the main spot. The last three along the worse axis.
    double second_share = 0;
    double light_dn = 0;   // of a lenslet, what no dark level was subtracted from
    double lit_share = 0;  // bins of these lenslets above the dark level
    double floor_dn = 0;   // what the dark bins of the mean read, their median; 0: too few bins are dark
};

// `lenslets`: indices, at most 65536. `frame` has the extents' size. `dark_dn`: for lit_share alone.
// `centres`: empty, or one deflection a lenslet of the field: each lenslet's samples are first moved by its own mean
// deflection, rounded to whole bins, so that a part which deflects light smoothly does not widen the spot. x and y are
// then what rounding leaves.
MeanSpot mean_spot(const FrameView& frame, const Extents& extents, std::uint32_t dark_dn,
                   std::span<const std::uint32_t> lenslets, std::span<const Deflection> centres = {});

// Root mean square of the positions of evenly lit bins about their mean: the widest that a spot without focus is.
double rms_of_even_light(int bins);

}  // namespace hord::algo
