// Where the part is in the field, found without being told, and the rim that is not judged.
//
// The part's own rim lights up in every gradient: half-covered lenslets, side walls, and the jump to the undisturbed
// light around it. It is masked by the following rule, which never asks how disturbed a lenslet *inside* the part is,
// so a bubble or a cut cannot be taken for rim:
//
// 1. Free light. The outermost ring of lenslets shows undisturbed light if at least half of it agrees: lit, its mean
//    deflection within `kFreeToleranceBins` of the ring's median, its light at least half of the ring's median. If it
//    does not, there is no free light in sight: the part fills the field.
// 2. Free field. Free light is followed from the ring inwards, through places at least three lenslets wide: a gap of
//    two in an outline lets nothing in. Whatever is not reached is part - the middle of a lens, which deflects nothing
//    either, is enclosed by lenslets that do, and a dark cut or a bubble is not free light at all.
// 3. Part. Regions that are not reached are parts if they cover at least 1/kSmallestPart of the field; smaller ones
//    (dust beside the part) are outside. Reached lenslets that have part on both sides in their row or in their column
//    are inside, too: the flat middle of a cylinder lens that is open at its ends. No part: the whole field is judged,
//    for an empty field and a flat window that fills it look the same, and both pass.
// 4. Rim. Lenslets of the part within `margin` lenslets (king's moves) of a reached one or of the field's border are
//    kRim; everything that is not inside is kOutside.
//
// Margin: 1.5 lenslets + 1/222 of the longer side of the field, rounded: 2 at 111, 4 at 555. Central differences
// across a half-covered lenslet reach 1.5 lenslets in; side walls seen at a slant are of a length in millimetres, hence
// a share of the field. Give a recipe's own margin for parts that are tilted more, and zones where the rule does not
// fit.
//
// An outline too weak to be followed (a jump below the tolerance, no light lost) is not masked, and need not be: its
// gradient is of the order of the tolerance and stays below the limits. Mistakes of the rule reject: a part that is
// too small, or that covers more than half of the ring, has its rim judged. It does not see a chip broken out of the
// rim through which free light passes; the outline follows the chip.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"

namespace hord::algo {

constexpr double kFreeToleranceBins = 0.25;
constexpr int kSmallestPart = 16;

// The margin of the rule above.
int default_rim_margin(const Extents& extents);

class RimFinder {
  public:
    // margin: lenslets, 0..1024. Takes all memory.
    RimFinder(const Extents& extents, int margin);

    // Adds kRim and kOutside to `mask`, which holds kDark and kSaturated. One value a lenslet each, row by row.
    void mark(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
              std::span<std::uint8_t> mask);

  private:
    bool find_free_light(std::span<const Deflection>, std::span<const std::uint32_t>,
                         std::span<const std::uint8_t> mask);
    void reach_free_field();
    void keep_large_parts();
    void enclose();
    void mark_rim(std::span<std::uint8_t> mask);
    std::size_t flood(std::uint32_t seed, std::uint8_t through, std::uint8_t mark, bool diagonally);

    Extents extents_;
    int margin_;
    std::vector<std::uint8_t> place_;   // what is known of a lenslet, see rim.cpp
    std::vector<std::uint32_t> queue_;  // of a flood
    std::vector<std::uint32_t> ring_;   // the outermost lenslets
    std::vector<std::int64_t> ring_values_;
    std::vector<int> first_, last_;    // part in a column
    std::vector<int> part_in_column_;  // of the rows within the margin
};

}  // namespace hord::algo
