// A round lenslet with a soft edge among its neighbours: what second moments its window shows where the lattice is
// distorted. Used for lenslets that a stop cuts (calib/calibrate/cut_lenslets.h).
#pragma once

#include <array>
#include <optional>
#include <span>

#include "algo/frame/lenslet_grid.h"
#include "calib/lattice/centres.h"
#include "calib/lattice/white_image.h"

namespace hord::calib {

// A disc whose edge is blurred by a Gaussian.
struct RoundLenslet {
    double radius_px = 0, edge_px = 0;  // sigma
    [[nodiscard]] double light(double r_px) const;
};

// From a lenslet to those nearest to it; a square lattice has eight; a hexagonal one six, and the others are 0.
struct Neighbours {
    std::array<algo::PixelPoint, 8> to{};
    int count = 0;
};
Neighbours neighbours_of(const algo::LensletGrid::Steps& steps, algo::Stagger stagger);

// The lenslet whose light, with that of such neighbours, has the mean profile of `spots` in the finder's window. All
// `spots` have these neighbours: in a distorted frame they are fewer than the finder learned from. None if the profiles
// differ by more than 1 % of the height (RMS: spots, squares, lenslets with structure), or of fewer than 8 spots.
std::optional<RoundLenslet> round_lenslet(const WhiteImage& image, std::span<const Spot> spots,
                                          const CentreFinder& finder, const Neighbours& neighbours);

// What CentreFinder::elongation() answers where `lenslet` and its neighbours are: of one size everywhere, or scaled as
// their distances are, by `steps` over `middle`.
Elongation elongation_of_one_size(const CentreFinder& finder, const RoundLenslet& lenslet,
                                  const Neighbours& neighbours);
Elongation elongation_of_scaled(const CentreFinder& finder, const RoundLenslet& lenslet,
                                const algo::LensletGrid::Steps& steps, const algo::LensletGrid::Steps& middle,
                                algo::Stagger stagger);

}  // namespace hord::calib
