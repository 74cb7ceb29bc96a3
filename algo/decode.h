// First step: one row of lenslets of a macro-pixel frame becomes a row of HORDs.
//
//     mass(m; i, j) = max(0, sample(m*I + i, n*J + j) - dark)        sum(m) = sum of its masses
//
// so that h = mass / sum (Eq. 8) is known exactly and nothing has been divided yet. Masses fit 16 bits, sums of
// at most 225 of them 24 bits. A lenslet whose sum is below `min_sum` is kDark, one with a sample at or above
// `saturated` is kSaturated (before the dark level is subtracted): neither has a HORD.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/frame.h"
#include "algo/hord.h"
#include "algo/light_field.h"
#include "algo/mask.h"

namespace hord::algo {

struct LightLevels {
    std::uint32_t dark = 0;       // DN, subtracted from every sample
    std::uint32_t min_sum = 1;    // DN, at least 1
    std::uint32_t saturated = 0;  // DN
};

// Storage for one row of HORDs; all memory is taken by the constructor.
class HordRow {
  public:
    explicit HordRow(const Extents& extents)
        : bins_(static_cast<std::size_t>(extents.bins())), masses_(static_cast<std::size_t>(extents.m) * bins_),
          sums_(static_cast<std::size_t>(extents.m)),
          peaks_(static_cast<std::size_t>(extents.m)), mask_(static_cast<std::size_t>(extents.m)) {}

    [[nodiscard]] Hord hord(int m) const { return {masses_.data() + static_cast<std::size_t>(m) * bins_, sums_[static_cast<std::size_t>(m)]}; }
    [[nodiscard]] bool has_hord(int m) const { return mask_[static_cast<std::size_t>(m)] == kValid; }
    [[nodiscard]] std::uint32_t sum(int m) const { return sums_[static_cast<std::size_t>(m)]; }
    [[nodiscard]] std::uint8_t mask(int m) const { return mask_[static_cast<std::size_t>(m)]; }  // kDark, kSaturated

  private:
    friend void decode_row(const FrameView&, const Extents&, const LightLevels&, int, HordRow&);
    std::size_t bins_;
    std::vector<std::uint16_t> masses_;
    std::vector<std::uint32_t> sums_;
    std::vector<std::uint16_t> peaks_;  // brightest sample
    std::vector<std::uint8_t> mask_;
};

// Decodes lenslet row n. The frame has the extents' size and, above 8 bits, aligned two-byte samples.
void decode_row(const FrameView& frame, const Extents& extents, const LightLevels& levels, int n, HordRow& row);

}  // namespace hord::algo
