// The light of a drawn scene, what may happen to it, and what a sensor reads of it.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "algo/frame/extents.h"
#include "common/frame.h"
#include "tests/support/frames.h"

namespace hord::algo::testing {

// The light of a drawn scene, before the sensor: one value a bin, DN, row by row of the macro-pixel frame.
struct LightImage {
    Extents extents;
    std::vector<double> bins;
    [[nodiscard]] double& at(int x, int y) { return bins[static_cast<std::size_t>(y * extents.width_px() + x)]; }
    [[nodiscard]] double at(int x, int y) const { return bins[static_cast<std::size_t>(y * extents.width_px() + x)]; }
};

// Gaussian spots of standard deviation `spread_bins`; Spot::light 1: the brightest bin of a centred spot reads
// `peak_dn`.
LightImage spots(const Extents& extents, double peak_dn, double spread_bins, const std::function<Spot(int, int)>& spot);

// What the sensor reads: light, pedestal and normal noise of `noise_dn`, rounded, clipped. 10 electrons a DN.
struct Sensor {
    double pedestal_dn = 0, noise_dn = 0.2, light = 1;
    bool photon_noise = true;
};
Frame exposed(const LightImage& light, const Sensor& sensor, std::uint64_t seed, int bits = 8);

// Changes of the light. `change`: what a bin has afterwards.
LightImage changed(LightImage light, const std::function<double(int x, int y, double light)>& change);
LightImage moved_px(const LightImage& light, double right_px, double down_px);  // bilinear; dark light enters
LightImage blurred(const LightImage& light, double spread_px);                  // Gaussian, across lenslets too
LightImage with_ghost(LightImage light, double share, int right_px, int down_px);
LightImage joined(const LightImage& left, const LightImage& right, int from_column);  // lenslet columns

}  // namespace hord::algo::testing
