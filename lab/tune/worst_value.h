// The worst value of a part's map: the limit at which the part would just be rejected.
#pragma once

#include <cstdint>
#include <span>

#include "algo/frame/extents.h"
#include "algo/inspection/pipeline.h"
#include "common/result.h"

namespace hord::lab {

// If the recipe has a smallest area above one lenslet, the limit at which a region of that area is just found instead,
// by bisection: within 2^-12 of the worst value.
class WorstValue {
  public:
    WorstValue(const algo::Extents& extents, const algo::Recipe& base) : extents_(extents), min_area_(base.min_area) {}

    // Of a gradient in its own unit; of light as 1 - transmission. `mask`: algo::MaskBit. Fail as algo::DefectFinder.
    [[nodiscard]] Result<double> of_gradient(algo::Map map, std::span<const std::uint8_t> mask) const;
    [[nodiscard]] Result<double> of_light(algo::Map transmission, std::span<const std::uint8_t> mask) const;

  private:
    template <class MakeFeatures>
    Result<double> of_region(double worst, const MakeFeatures& make_features) const;

    algo::Extents extents_;
    std::uint32_t min_area_;
};

}  // namespace hord::lab
