// Decodes one row of lenslets of a macro-pixel frame into a row of HORDs.
//
//     mass(m; i, j) = max(0, sample(m*I + i, n*J + j) - dark)        sum(m) = sum of its masses
//     moment_x = sum of (2i - (I-1)) * mass        moment_y = sum of (2j - (J-1)) * mass        half bins times DN
//
// All are exact integers: h = mass / sum (Eq. 8) is not divided, and half bins have no fraction where the centre of an
// even number of bins lies between two of them.
// Ranges: a mass fits 16 bits; at most 15 x 15 of them sum to less than 2^24, moments are below 14 * 2^24 < 2^28.
//
// A lenslet whose sum is below `min_sum` is kDark. One with a sample at or above `saturated`, before the dark level is
// subtracted, is kSaturated. Neither has a HORD.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/frame/hord.h"
#include "algo/frame/mask.h"
#include "algo/simd/isa.h"
#include "common/frame.h"

namespace hord::algo {

struct LightLevels {
    std::uint32_t dark = 0;       // DN, subtracted from every sample
    std::uint32_t min_sum = 1;    // DN, at least 1
    std::uint32_t saturated = 0;  // DN
};

// Storage for one row of HORDs. The constructor allocates all memory.
class HordRow {
  public:
    explicit HordRow(const Extents& extents);

    [[nodiscard]] Hord hord(int m) const {
        return {masses_.data() + static_cast<std::size_t>(m) * bins_, sums_[static_cast<std::size_t>(m)]};
    }
    [[nodiscard]] bool has_hord(int m) const { return mask_[static_cast<std::size_t>(m)] == kValid; }

    // One value a lenslet.
    [[nodiscard]] std::span<const std::uint32_t> sums() const { return sums_; }
    [[nodiscard]] std::span<const std::int32_t> moments_x() const { return moments_x_; }
    [[nodiscard]] std::span<const std::int32_t> moments_y() const { return moments_y_; }
    [[nodiscard]] std::span<const std::uint8_t> mask() const { return mask_; }  // kDark, kSaturated

  private:
    friend void decode_row(const FrameView&, const Extents&, const LightLevels&, int, HordRow&, Isa);

    std::size_t bins_;
    std::vector<std::uint16_t> masses_;  // with room behind them for a store of a whole vector
    std::vector<std::uint32_t> sums_;
    std::vector<std::int32_t> moments_x_, moments_y_;
    std::vector<std::uint8_t> mask_;
};

// Preconditions of decode_row: the extents' size, the bit depth (8..16), a sufficient stride and, above 8 bits, aligned
// two-byte samples. Both fail with invalid_argument.
Result<void> check_frame(const FrameView& frame, const Extents& extents, int bits);
Result<void> check_bits(int bits);

// Decodes lenslet row n of a checked frame. The result does not depend on `isa`, which this processor must have.
void decode_row(const FrameView& frame, const Extents& extents, const LightLevels& levels, int n, HordRow& row,
                Isa isa = best_isa());

}  // namespace hord::algo
