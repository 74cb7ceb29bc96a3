// Finds the part in the field and masks its rim, which has large gradients (half-covered lenslets, side walls, the jump
// to the undisturbed light) and is not judged. How disturbed a lenslet inside the part is does not matter: a bubble or
// a cut cannot be mistaken for the rim. What is part and what is field follows the recipe's form of part
// (algo/recipe/recipe.h). The steps for each form, the choice of the margin and the limits of the rules:
// docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"
#include "algo/frame/flood.h"
#include "algo/inspection/plate_outline.h"
#include "algo/inspection/tube_outline.h"
#include "algo/recipe/recipe.h"

namespace hord::algo {

constexpr double kFreeToleranceBins = 0.25;  // deflection of free light from the median of the outermost lenslets
constexpr int kSmallestPart = 16;            // a part covers at least 1/kSmallestPart of the field

// Lenslets: 1.5 + 1/222 of the longer side of the field, rounded.
int default_rim_margin(const Extents& extents);

// What the last frame showed of the part.
struct FoundPart {
    // Connected regions of at least 1/kSmallestPart of the field; a tube or a plate is 1. 0: none, all of the field is
    // judged. A web is 0, because it is not looked for.
    int regions = 0;
    float border_share = 0;  // of the field's outermost lenslets, that belong to the part, 0..1; 0 without a part
    // At least half of the outermost lenslets show free light; else the medians are 0. Not looked for with a web.
    bool free_light = false;
    Deflection free_deflection;  // median of the outermost lenslets, bin pitches
    std::uint32_t free_sum = 0;  // the same of their light, DN above the dark level
};

class RimFinder {
  public:
    // margin: lenslets, 0..1024. steepest_bins: see TubeOutline. Allocates all memory.
    RimFinder(const Extents& extents, int margin, PartForm form = PartForm::round, float steepest_bins = 0);

    // With the recipe's form, rim_margin and limits.
    static RimFinder of(const Recipe& recipe, const Extents& extents);

    // Adds kRim and kOutside to `mask`, which holds kDark and kSaturated. All spans: one value a lenslet, row by row.
    void mark(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
              std::span<std::uint8_t> mask);

    [[nodiscard]] const FoundPart& found() const { return found_; }

  private:
    bool find_free_light(const FieldLight& light);
    std::size_t agreeing(const FieldLight& light, std::span<const std::uint32_t> ring);
    void reach_free_field();
    void keep_large_parts();
    void keep_long_regions();
    void find_part(const FieldLight& light);
    void enclose();
    void note_border_share();
    void mark_rim(std::span<std::uint8_t> mask);
    std::size_t mark_connected(std::uint32_t seed, std::uint8_t through, std::uint8_t mark, Connected connected);

    Extents extents_;
    int margin_;
    PartForm form_;
    std::optional<TubeOutline> tube_;    // if the form is a tube
    std::optional<PlateOutline> plate_;  // if it is a plate
    FoundPart found_;
    enum class Sides : std::uint8_t { all, beside_columns, beside_rows } free_sides_ = Sides::all;  // show free light
    std::vector<std::uint8_t> state_;                          // of each lenslet, outline::State
    std::vector<std::uint32_t> queue_;                         // of the flood fill
    std::vector<std::uint32_t> ring_;                          // the outermost lenslets,
    std::vector<std::uint32_t> beside_columns_, beside_rows_;  // and those of two sides: what lies beside a tube
    std::vector<std::int64_t> ring_values_;
    std::vector<int> first_, last_;    // rows of the part in each column
    std::vector<int> part_in_column_;  // lenslets of the part in the rows within the margin
};

}  // namespace hord::algo
