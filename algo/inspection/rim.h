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
constexpr double kJumpBins = 0.25;           // light jumps between two lenslets if its mean deflection changes by more
constexpr double kJumpLight = 1.25;          // or its sum by more than this factor
constexpr int kMinBeside = 8;                // lenslets beside the part in a row or column that tell something

// What mark() found. `parts`: regions of at least 1/kSmallestPart of the field. Regions between which the light changes
// smoothly count once: the two flanks of a cylinder lens, whose middle shows free light.
struct FoundPart {
    bool free_light = false;    // the outermost lenslets show free light; without it there are no parts
    int parts = 0;              //
    std::size_t area = 0;       // lenslets of all parts
    std::size_t at_border = 0;  // of these, outermost lenslets of the field
    double sharp_outline = 0;   // share of the outline, in steps from lenslet to lenslet, where the light jumps
    // Share of the lenslets beside the part that show free light, in the row or the column with the fewest. It counts
    // rows with at least kMinBeside lenslets beside the part, and those without any free light; 1 if there is no part.
    double free_beside = 1;
    // Overlap of the part, with what it encloses, and its image turned by 180 degrees about its centroid, over both
    // together: 1 for a disc or a rectangle, 0.69 for half a disc.
    double symmetry = 0;
    std::span<const std::uint8_t> state = {};  // one a lenslet, valid until the next mark()

    static constexpr std::uint8_t kFreeField = 4;
    // The lenslet shows free light that is connected to that of the outermost lenslets.
    [[nodiscard]] bool shows_free_light(std::size_t k) const { return (state[k] & kFreeField) != 0; }
};

// Lenslets: 1.5 + 1/222 of the longer side of the field, rounded.
int default_rim_margin(const Extents& extents);

class RimFinder {
  public:
    // margin: lenslets, 0..1024. Allocates all memory.
    RimFinder(const Extents& extents, int margin);

    // Adds kRim and kOutside to `mask`, which holds kDark and kSaturated. All spans: one value a lenslet, row by row.
    void mark(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
              std::span<std::uint8_t> mask);

    // Of the last mark().
    [[nodiscard]] const FoundPart& found() const { return found_; }

  private:
    using Deflections = std::span<const Deflection>;
    using Sums = std::span<const std::uint32_t>;
    bool find_free_light(std::span<const Deflection>, std::span<const std::uint32_t>,
                         std::span<const std::uint8_t> mask);
    void reach_free_field();
    void keep_large_parts();
    void enclose();
    void describe(Deflections deflections, Sums sums, std::span<const std::uint8_t> mask);
    [[nodiscard]] int count_parts(Deflections deflections, std::span<const std::uint8_t> mask);
    [[nodiscard]] double sharp_share(Deflections deflections, Sums sums, std::span<const std::uint8_t> mask) const;
    [[nodiscard]] double least_free_beside() const;
    [[nodiscard]] double point_symmetry() const;
    void mark_rim(std::span<std::uint8_t> mask);
    std::size_t mark_connected(std::uint32_t seed, std::uint8_t through, std::uint8_t mark, Connected connected);

    Extents extents_;
    int margin_;
    std::vector<std::uint8_t> state_;   // of each lenslet, see rim.cpp
    std::vector<std::uint8_t> region_;  // number of its large region, from 1; valid where state_ has kPart
    std::vector<std::uint32_t> queue_;  // of the flood fill
    std::vector<std::uint32_t> ring_;   // the outermost lenslets
    std::vector<std::int64_t> ring_values_;
    std::vector<int> first_, last_;    // rows of the part in each column
    std::vector<int> part_in_column_;  // lenslets of the part in the rows within the margin
    Deflection free_;                  // median of the outermost lenslets
    int regions_ = 0;
    FoundPart found_;
};

}  // namespace hord::algo
