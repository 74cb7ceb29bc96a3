// A map of the reference between its lenslets: value, slopes and how fast these change.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/frame/extents.h"

namespace hord::algo {

// Value and derivatives of a map at a point, by cubic interpolation of the 4x4 lenslets around it.
struct MapAt {
    double value = 0, by_m = 0, by_n = 0;
    double curvature = 0;  // change of the slope over a lenslet, large at edges
};
class CubicReader {
  public:
    CubicReader(const Extents& extents, std::span<const std::uint8_t> mask) : extents_(extents), mask_(mask) {}
    bool move_to(double m, double n);         // false if the 4x4 are not inside the field
    [[nodiscard]] std::uint8_t mask() const;  // the bits of all 4x4, combined
    [[nodiscard]] MapAt read(std::span<const float> map) const;

  private:
    Extents extents_;
    std::span<const std::uint8_t> mask_;
    std::size_t corner_ = 0;
    float wm_[4] = {}, wn_[4] = {}, dm_[4] = {}, dn_[4] = {};
};

}  // namespace hord::algo
