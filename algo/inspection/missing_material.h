// Places of a part where material is missing: holes, slits, notches and tears through which light passes that the part
// around them takes in part. Without a reference no other feature sees them, because nothing else judges light that is
// too bright.
//
// A place is bright where the light steps down on the way from it: along its row and its column, in both directions,
// however far away. All that is met first must be such steps, or places that are not judged (a notch is open there);
// how many steps are needed follows from the form of the part. So a hole may have any size. A step is a change between
// two squares that goes on to neither side, so lamps and lenses, whose light changes smoothly, have none. Bright places
// that touch are one region. Most of its outline must be steps. Squares are single lenslets, 3 x 3 lenslets, and 3 x 3
// blocks of 2, 4, 8, ... lenslets, because noise hides small steps from small squares. Why these limits and what they
// find: docs/notes/inspection.md.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/recipe/recipe.h"

namespace hord::algo {

constexpr float kMinExcess = 0.03F;       // of the light beyond a step; glass of index 1.5 reflects 0.08, water 0.04
constexpr float kMinExcessSigmas = 5;     // of the difference between two such squares of the part
constexpr float kMinOfSideSquare = 0.6F;  // of a square: lenslets that are judged and lit

struct MissingMaterial {
    float m = 0, n = 0;           // its middle, lenslets
    std::uint32_t area = 0;       // lenslets
    float length = 0, width = 0;  // of the box about it, lenslets
    float excess = 0;             // of its light over that beyond the smallest of the steps that count
    float score = 0;              // excess over its limit
};

struct SoughtMaterial {
    std::uint32_t min_area = 1;  // lenslets
    float light_beside = 0;      // DN, of the free light beside the part; 0: not known
};

class MissingMaterialFinder {
  public:
    explicit MissingMaterialFinder(const Extents& extents, PartForm form = PartForm::round);  // allocates all memory

    // The region with the largest score among the smallest squares that show one, of at least `min_area` lenslets; none
    // if no score reaches 1. `sums`, `mask` (MaskBit): one value a lenslet, row by row. Saturated lenslets count with
    // the light that was read.
    std::optional<MissingMaterial> find(std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask,
                                        const SoughtMaterial& sought = {});

  private:
    static constexpr int kPad = 10;                   // twice the distance of squares of 3 x 3
    static constexpr std::size_t kMaxSamples = 2048;  // of the noise
    // Sums over blocks of lenslets, with kPad blocks of zeros on each side.
    struct Level {
        Level(int columns, int rows, int lenslets_a_block);
        [[nodiscard]] std::size_t index(int m, int n) const;
        int m, n, block;
        std::size_t stride;
        std::vector<float> light, count;  // of the judged, lit lenslets of a block
    };
    enum Direction : std::uint8_t { right, left, down, up };
    // Squares of 2 * half + 1 blocks of a level.
    struct Squares {
        const Level* level;
        int half;
        SoughtMaterial sought;
        float seen_excess;      // a hole with more light is seen between the next smaller squares
        float limit = 0;        // of the excess
        bool is_trial = false;  // regions are only marked
        std::size_t judged = 0;
        [[nodiscard]] int side() const { return (2 * half + 1) * level->block; }  // lenslets
        // Blocks between two that are compared: 1 and 2/3 of the side, rounded up. A partly covered block lies between.
        [[nodiscard]] int distance() const { return 3 * half + 2; }
        [[nodiscard]] int lenslets_apart() const { return distance() * level->block; }
    };
    struct Region {
        std::size_t squares = 0;
        float most = 0;  // excess, of the brightest square
        double sum_m = 0, sum_n = 0;
        float light = 0;
        int left = INT32_MAX, right = 0, top = INT32_MAX, bottom = 0;
    };
    void look_at(Squares& squares, MissingMaterial& best);
    void look_again(Squares& squares, MissingMaterial& best);
    void find_regions(const Squares& squares, MissingMaterial& best);
    void sum_squares(const Level& level);
    std::optional<float> noise(const Squares& squares);
    [[nodiscard]] bool is_at_outline(const Squares& squares, std::size_t at) const;
    [[nodiscard]] bool is_step_of_light(const Squares& squares) const;
    [[nodiscard]] bool any_change(const Squares& squares) const;
    bool find_steps(const Squares& squares);
    void follow(const Squares& squares, Direction direction);
    void count_steps(const Level& level);
    bool mark_bright(const Level& level, int steps);
    void take_region(const Squares& squares, std::size_t seed, MissingMaterial& best);
    [[nodiscard]] bool is_sharp(const Squares& squares, const Region& region) const;
    [[nodiscard]] bool is_part(const Squares& squares, const Region& region) const;
    static std::size_t beside(std::size_t at, std::ptrdiff_t way) {
        return static_cast<std::size_t>(static_cast<std::ptrdiff_t>(at) + way);
    }

    PartForm form_;
    std::vector<Level> levels_;
    std::vector<float> light_, count_;       // of squares of 3 x 3 blocks
    std::vector<float> mean_;                // light of squares; 0: not judged
    std::vector<std::int32_t> steps_;        // bit of a direction: the light steps down from the square that way
    std::vector<std::uint8_t> returns_;      // the same: beyond that step the light steps up again
    std::array<std::vector<float>, 4> met_;  // of a direction: excess over what is beyond the first step; < 0: up
    std::vector<std::int32_t> ways_;         // that lead down; -1: one leads up
    std::vector<float> least_;               // of the excesses over what lies beyond these steps
    std::vector<float> excess_;              // of bright squares; 0: not bright, or in a region already
    std::vector<std::uint8_t> of_hole_;      // 1: of what may be a hole by the trial's limit
    std::vector<std::uint32_t> region_;
    std::vector<float> samples_;
    float noise_of_lenslet_ = 0;
};

}  // namespace hord::algo
