// Maps of blocks of kBlock x kBlock lenslets: the light is summed, deflections are means. A step finds a part there
// that lies kBlock times as far away.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/reference/registered_maps.h"

namespace hord::algo {

class CoarseMaps {
  public:
    static constexpr int kBlock = 4;

    explicit CoarseMaps(const Extents& fine);
    // Blocks from the middle of the field; what is left at its borders belongs to none.
    [[nodiscard]] const Extents& extents() const { return extents_; }
    void fill(const ReferenceMaps& reference, const PartMaps& part);
    [[nodiscard]] ReferenceMaps reference() const { return {light_, x_, y_, reference_mask_}; }
    [[nodiscard]] PartMaps part() const { return {deflections_, sums_, part_mask_}; }

  private:
    Extents fine_, extents_;
    std::vector<float> light_, x_, y_;
    std::vector<std::uint32_t> sums_;
    std::vector<Deflection> deflections_;
    std::vector<std::uint8_t> reference_mask_, part_mask_;
};

}  // namespace hord::algo
