// Raw frames of a drawn part: a round lens with free light around it, behind any lattice of lenslets.
#pragma once

#include <cstdint>

#include "algo/frame/lenslet_grid.h"
#include "common/frame.h"

namespace hord::bench {

constexpr int kRawSide = 5000;  // px
constexpr int kRawLenslets = 555;
constexpr double kElectronsPerDn = 40, kReadDn = 0.6;

// The lattice of a 25-megapixel sensor with 9 px a lenslet: square and nearly parallel to the sensor, or hexagonal and
// turned by 3 degrees.
algo::LensletGrid raw_grid(bool hexagonal);

// One exposure, 8 bits: the lens deflects by up to 3.5 px at its rim; its centre is moved by (dx, dy) lenslets. Photon
// and read noise by `seed`. `defect`: a disc of four lenslets that deflects by 1.2 px more.
Frame drawn_raw(const algo::LensletGrid& grid, double dx, double dy, std::uint64_t seed, bool defect = false);

}  // namespace hord::bench
