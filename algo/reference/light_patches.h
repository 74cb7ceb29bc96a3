// Squares of lenslets that together show less or more light than the reference's: a hole or a chip in clear glass gives
// back a few percent of the light, which noise hides in each lenslet alone.
//
// The change of a square is the mean of its lenslets' changes, each weighted by one over its variance, noise and the
// spread of good parts together. Its score is that over its standard deviation, as if all lenslets deviated on their
// own; what good parts reach nevertheless is learned (Reference::patch_limit). Lenslets beside a jump of the reference
// (algo/reference/edge_classes.h) do not count: there all deviate alike, by where the part lies.
//
// A change that goes on around the square is one of the lamp or of the whole part: what counts is the smaller of the
// change and of its difference from the lenslets around it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <span>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/reference/reference.h"
#include "algo/reference/reference_comparison.h"

namespace hord::algo {

struct LightPatch {
    float score = 0;     // standard deviations; below 0: less light. 0: no square exceeds the limit
    float change = 0;    // of the light, relative to the reference's
    float m = 0, n = 0;  // middle, lenslets
    int side = 0;        // lenslets
};

class LightPatches {
  public:
    static constexpr int kSides[] = {2, 3, 5};

    // Allocates all memory.
    explicit LightPatches(const Reference& reference);

    // Squares that a frame has, of both signs.
    [[nodiscard]] static double tests(const Extents& extents) {
        return 2.0 * static_cast<double>(std::size(kSides)) * static_cast<double>(extents.lenslets());
    }

    // Reads the changes of a frame. Lenslets with a bit of kOutside or kSaturated in `mask` do not count. `reference`:
    // that of the constructor.
    void load(std::span<const Difference> differences, std::span<const std::uint8_t> mask, const Reference& reference);
    // Lenslets within `reach` of (m, n) do not count until the next load().
    void leave_out(float m, float n, float reach);
    // Of the squares whose score exceeds `least`, the one with the largest.
    [[nodiscard]] LightPatch strongest(float least);

  private:
    struct Sums;
    [[nodiscard]] std::size_t index(int m, int n) const {
        return static_cast<std::size_t>(n) * pitch_ + static_cast<std::size_t>(m);
    }
    void add(Sums& sums, int m, int n) const;
    [[nodiscard]] LightPatch measure(int m, int n, int side) const;
    template <int kSide>
    void find_stronger(float least, LightPatch& found);

    Extents extents_;
    std::size_t pitch_;  // floats a row, those beyond the field are 0
    // Of each lenslet: weight times change; one over the variance, 0: does not count.
    std::vector<float> change_, weight_;
    std::vector<float> change_of_columns_, weight_of_columns_;  // sums over the rows of a row of squares
    std::vector<std::uint8_t> beside_jump_;                     // of the reference's lenslets
};

}  // namespace hord::algo
