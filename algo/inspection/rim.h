// Finds the part in the field and masks its rim, which has large gradients (half-covered lenslets, side walls, the jump
// to the undisturbed light) and is not judged. How disturbed a lenslet inside the part is does not matter: a bubble or
// a cut cannot be mistaken for the rim. The four steps, the choice of the margin and the limits of the rule:
// docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"
#include "algo/frame/flood.h"

namespace hord::algo {

constexpr double kFreeToleranceBins = 0.25;  // deflection of free light from the median of the outermost lenslets
constexpr int kSmallestPart = 16;            // a part covers at least 1/kSmallestPart of the field

// Lenslets: 1.5 + 1/222 of the longer side of the field, rounded.
int default_rim_margin(const Extents& extents);

class RimFinder {
  public:
    // margin: lenslets, 0..1024. Allocates all memory.
    RimFinder(const Extents& extents, int margin);

    // Adds kRim and kOutside to `mask`, which holds kDark and kSaturated. All spans: one value a lenslet, row by row.
    void mark(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
              std::span<std::uint8_t> mask);

  private:
    bool find_free_light(std::span<const Deflection>, std::span<const std::uint32_t>,
                         std::span<const std::uint8_t> mask);
    void reach_free_field();
    void keep_large_parts();
    void enclose();
    void mark_rim(std::span<std::uint8_t> mask);
    std::size_t mark_connected(std::uint32_t seed, std::uint8_t through, std::uint8_t mark, Connected connected);

    Extents extents_;
    int margin_;
    std::vector<std::uint8_t> state_;   // of each lenslet, see rim.cpp
    std::vector<std::uint32_t> queue_;  // of the flood fill
    std::vector<std::uint32_t> ring_;   // the outermost lenslets
    std::vector<std::int64_t> ring_values_;
    std::vector<int> first_, last_;    // rows of the part in each column
    std::vector<int> part_in_column_;  // lenslets of the part in the rows within the margin
};

}  // namespace hord::algo
