// Places of a part where material is missing: holes and notches through which light passes that the part around them
// takes in part. Without a reference no other feature sees them, because nothing else judges light that is too bright.
//
// A square of judged lenslets is compared with four squares of its size beside it, left, right, above and below, one
// and two thirds of its side away. Three of them or more must lie on the part (a notch is open at one side). The light
// must exceed that of the brightest of them: so lamps and lenses, whose light changes smoothly, and dark rims count
// for nothing. Squares are single lenslets, 3 x 3 lenslets, and 3 x 3 blocks of 2, 4, 8, ... lenslets. Why these limits
// and what they find: docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "algo/frame/extents.h"

namespace hord::algo {

constexpr float kMinExcess = 0.03F;       // of the light beside it; glass of index 1.5 reflects 0.08, water 0.04
constexpr float kMinExcessSigmas = 5;     // of the difference between two neighbouring squares of the part
constexpr float kMinOfSideSquare = 0.6F;  // of a square beside it: lenslets that are judged and lit

struct MissingMaterial {
    float m = 0, n = 0;  // middle of the square, lenslets
    int side = 1;        // of the square, lenslets
    float excess = 0;    // of its light over that of the brightest square beside it
    float score = 0;     // excess over its limit
};

class MissingMaterialFinder {
  public:
    explicit MissingMaterialFinder(const Extents& extents);  // allocates all memory

    // The place with the largest score, of at least `min_area` lenslets; none if no score reaches 1. `sums`, `mask`
    // (MaskBit): one value a lenslet, row by row. Saturated lenslets count with the light that was read.
    std::optional<MissingMaterial> find(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask,
                                        std::uint32_t min_area = 1);

  private:
    // Sums over blocks of lenslets, with kPad blocks of zeros on each side.
    struct Level {
        Level(int columns, int rows, int lenslets_a_block);
        [[nodiscard]] std::size_t index(int m, int n) const;
        int m, n, block;
        std::size_t stride;
        std::vector<float> light, count;  // of the judged, lit lenslets of a block
    };
    void look_at(const Level& level, int half, MissingMaterial& best);
    void sum_squares(const Level& level);
    std::optional<float> noise(const Level& level, int distance);

    std::vector<Level> levels_;
    std::vector<float> light_, count_;  // of squares of 3 x 3 blocks
    std::vector<float> whole_, part_;   // mean light of squares that are judged as a whole, and in part; 0: no such
    std::vector<float> excess_;         // of a row
    std::vector<float> samples_;
};

}  // namespace hord::algo
