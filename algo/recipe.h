// What is tolerated on a part: features, limits, masks and zones. Read from TOML by firmware/recipe_file.h.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "algo/light_field.h"

namespace hord::algo {

struct Point {
    float m = 0;  // lenslets
    float n = 0;
};

// A region of the part. `inspect` zones: only lenslets in at least one of them are judged (none: all are).
// `ignore` zones: lenslets in any of them are not judged.
struct Zone {
    enum class Shape : std::uint8_t { circle, polygon };
    enum class Use : std::uint8_t { inspect, ignore };
    Shape shape = Shape::circle;
    Use use = Use::inspect;
    Point centre;                // circle
    float radius = 0;            // circle, lenslets
    std::vector<Point> corners;  // polygon, at least three

    [[nodiscard]] bool contains(float m, float n) const;
};

struct Recipe {
    std::string name = "default";

    // Light. Samples at or below `dark_dn` count as no light; a lenslet whose sum is below `min_sum_dn` has no HORD
    // (masked, never called 0); a lenslet with a sample at or above `saturated_dn` is masked as saturated.
    // 0 means: derived from the frame's bit depth (documented at Pipeline::create).
    std::uint32_t dark_dn = 3;
    std::uint32_t min_sum_dn = 0;
    std::uint32_t saturated_dn = 0;

    // Limits. A region of lenslets above a limit, of at least `min_area` lenslets, is a defect.
    float emd_limit_bins = 1.0F;           // neighbour EMD gradient, Euclidean ground, bin pitches (Eqs. 9-11)
    float frobenius_limit_bins = 1.0F;     // |Jacobian of the mean deflection|_F, bin pitches a lenslet (Eqs. 12-14)
    float transmission_limit = 0.5F;       // light relative to the part's own typical lenslet, 0..1
    std::uint32_t min_area = 1;            // lenslets

    // The part's own rim lights up in every gradient. `rim_margin` lenslets inside it are not judged; negative:
    // chosen from the number of lenslets (documented in algo/rim.h).
    int rim_margin = -1;

    // More than this share of the judged lenslets without light, or saturated, makes the frame unfit.
    float max_saturated_share = 0.02F;
    float min_lit_share = 0.05F;

    std::vector<Zone> zones;
};

// All problems of a recipe for light fields of these extents, one line each; empty when it can be used.
std::vector<std::string> problems(const Recipe& recipe, const Extents& extents);

}  // namespace hord::algo
