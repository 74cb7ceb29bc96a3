// Flaws painted into frames of good parts: what a reference will find, before the first bad part is seen.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo {

enum class PaintedFlaw : std::uint8_t {
    hole,     // a disc that sends no light to the bins: a bubble or an opaque speck
    scratch,  // a line, kPaintedScratch long, that sends no light to the bins
    dimple,   // a disc of kPaintedDimple that deflects all light to one side
    haze,     // a disc of kPaintedHaze that scatters a share of the light, by a Gaussian of one bin
};
struct PaintedFlawKind {
    std::string_view name, size, unit;  // `size`: what of it varies
    double least, most;                 // sizes that are tried, in `unit`
};
inline constexpr std::array<PaintedFlawKind, 4> kPaintedFlaws = {{{"bubble or speck", "radius", "lenslets", 0.05, 1.5},
                                                                  {"scratch", "half width", "lenslets", 0.005, 0.3},
                                                                  {"dimple", "deflection", "bins", 0.02, 1},
                                                                  {"haze", "share of the light", "", 0.02, 0.8}}};
constexpr double kPaintedScratch = 5, kPaintedDimple = 1.5, kPaintedHaze = 1.2;  // lenslets: length, radii

constexpr const PaintedFlawKind& kind_of(PaintedFlaw flaw) { return kPaintedFlaws[static_cast<std::size_t>(flaw)]; }

// Paints a flaw of this size with its middle at (m, n), lenslets. `angle`, rad: of the scratch, of the deflection.
// Light is what lies above `pedestal_dn`. The photon noise of the light that stays is scaled with it.
void paint(Frame& frame, const Extents& extents, PaintedFlaw flaw, double m, double n, double size, double angle,
           double pedestal_dn);

}  // namespace hord::algo
