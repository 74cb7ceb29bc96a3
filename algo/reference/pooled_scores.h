// What several lenslets show together: deviations from the reference, summed over bands and discs.
//
// A scratch, a stria and haze deviate weakly in each of many lenslets. A filter sums the standardised deviations (over
// noise and spread of good parts) of one kind over one shape; its score is that sum over its standard deviation. How
// good parts deviate together (waves, ripple) widens the sums: the standard deviation of each filter is what the frame
// itself shows, robustly, mixed with what good parts show (Reference::pooled_scales). A smooth change of form, a plane
// over the field, is taken off before. Why: docs/adr/0019-scores-of-several-lenslets.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/reference/reference.h"
#include "algo/reference/reference_comparison.h"
#include "algo/simd/isa.h"

namespace hord::algo {

// Shapes: bands of 4 or 8 lenslets along the row, the column or the diagonal that is nearest to the direction, whose
// profile across them weights up to five lines; and squares and a disc.
struct PooledFilter {
    Deviation deviation;         // light: missing light; scattering: added; deflection_shift: across the band
    std::uint8_t direction = 0;  // of a band: times 22.5 degrees from the rows, towards the columns
    std::uint8_t length = 0;     // of a band, lenslets along the row or column; 0: no band
    std::uint8_t profile = 0;    // of a band (pooled_scores.cpp); else the number of lenslets
    [[nodiscard]] bool is_band() const { return length > 0; }
};
std::span<const PooledFilter> pooled_filters();

// The lenslets of a frame that score highest together.
struct PooledPeak {
    float score = 0;         // standard deviations; 0: no filter has room in the field
    std::size_t filter = 0;  // of pooled_filters()
    // Written by find():
    float m = 0, n = 0;           // middle, lenslets
    float length = 0, width = 0;  // lenslets
    std::uint32_t area = 0;       // lenslets
    float value = 0;              // mean deviation over them, each towards its side of the band; in its unit
};

class PooledScorer {
  public:
    // Allocates all memory.
    explicit PooledScorer(const Extents& extents, Isa isa = best_isa());
    ~PooledScorer();
    PooledScorer(PooledScorer&&) noexcept;
    PooledScorer& operator=(PooledScorer&&) noexcept;

    // The highest score of a frame; 0 if the reference has no pooled_scales. Lenslets with a bit of kOutside or
    // kSaturated in `mask` do not count.
    PooledPeak highest(std::span<const Difference> differences, std::span<const std::uint8_t> mask,
                       const Reference& reference);
    // Where that is, of the frame of the last call of highest().
    void find(PooledPeak& peak, std::span<const Difference> differences);
    // The standard deviation of each filter in this frame, as it is robustly measured; 0 where it has no room.
    std::span<const float> measure(std::span<const Difference> differences, std::span<const std::uint8_t> mask,
                                   const Reference& reference);

    struct Work;

  private:
    std::unique_ptr<Work> work_;
};

}  // namespace hord::algo
