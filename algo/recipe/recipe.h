// What is tolerated on a part: features, limits, masks and zones. Read from TOML by firmware/recipes/recipe_file.h.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algo/features/feature.h"
#include "algo/frame/extents.h"
#include "algo/verdict/verdict.h"

namespace hord::algo {

struct Point {
    float m = 0;  // lenslets, or mm of a zone in mm
    float n = 0;
};

// A region of the part. `inspect` zones: only lenslets in at least one of them are judged (none: all are).
// `ignore` zones: lenslets in any of them are not judged. They lie in the field and do not follow the part.
//
// In lenslets, (0, 0) is the centre of the top-left lenslet; in mm, it is the middle of the field, ((M-1)/2, (N-1)/2)
// in lenslets, of Recipe::lenslet_mm each. Both count to the right and down.
struct Zone {
    enum class Shape : std::uint8_t { circle, polygon };
    enum class Use : std::uint8_t { inspect, ignore };
    enum class Unit : std::uint8_t { lenslets, mm };
    Shape shape = Shape::circle;
    Use use = Use::inspect;
    Unit unit = Unit::lenslets;  // of all below
    Point centre;                // circle
    float radius = 0;            // circle
    std::vector<Point> corners;  // polygon, at least three

    [[nodiscard]] bool contains(float m, float n) const;  // a place in the zone's unit
};

// What is no reason to reject, though it is a defect: small ones of some kinds, not too many, somewhere on the part. A
// defect that exceeds every tolerance it falls under is one too many.
struct Tolerance {
    std::uint32_t kinds = 0xFFFFFFFFU;  // bit 1 << DefectKind: those that it is about
    std::optional<Zone> where;          // on the reference's part, in lenslets; none: everywhere
    float largest_mm = 0;               // diameter of a disc of the same area; of scratches the length
    float deepest_rad = 0;              // the largest change of direction; 0: any
    std::uint32_t number = 1;           // as many of them

    [[nodiscard]] bool is_about(DefectKind kind) const { return (kinds >> static_cast<unsigned>(kind) & 1U) != 0; }
};

struct Reference;  // algo/reference/reference.h

// The distances that a part can be judged by over neighbours, from the dearest down; why these and no others:
// docs/adr/0004-rungs.md.
inline constexpr std::array kJudgedGradients = {Feature::emd, Feature::marginal, Feature::hellinger, Feature::chi2};
constexpr bool is_judged_gradient(Feature feature) {
    return std::ranges::find(kJudgedGradients, feature) != kJudgedGradients.end();
}

// Light levels at 8 bits; at b bits they are 2^(b-8) times as many DN, the same share of the full scale.
// Dark: twelve times the rounding noise of 8 bits (0.29 DN) and five times a read noise of 0.6 DN, so dark bins stay
// empty. Least sum: 1/16 of a bin at full scale. With ten or more electrons a DN that is 160 electrons or more, where
// the EMD of two draws of one HORD is about half a bin; with less light a HORD is noise. A lenslet that dark is judged
// by its transmission.
constexpr std::uint32_t kDarkDn8Bit = 3;
constexpr std::uint32_t kMinSumDn8Bit = 16;

struct Recipe {
    std::string name = "default";

    // Light. `dark_dn` is subtracted from every sample (what is at or below it counts as no light); a lenslet whose sum
    // is then below `min_sum_dn` has no HORD (masked, never called 0); a lenslet with a sample at or above
    // `saturated_dn` is masked as saturated. 0 follows the bit depth: the levels above, and the full scale. Where the
    // camera has subtracted its dark level already, 1 is as good as none.
    std::uint32_t dark_dn = 0;
    std::uint32_t min_sum_dn = 0;
    std::uint32_t saturated_dn = 0;

    // Features: what is computed of a part, and judged. What is not chosen costs nothing, its map is empty, and its
    // limit stays as it is here.
    std::optional<Feature> gradient =
        Feature::emd;    // over neighbours: one of kJudgedGradients, or none; with a reference emd or none
    bool slopes = true;  // the Jacobian of the mean deflection
    bool light = true;   // the transmission; with a reference its own score of the light is judged instead

    // Limits. A region of lenslets at or above a limit, of at least `min_area` lenslets, is a defect.
    //
    // Gradients: a good part may use the whole range of 9 bins smoothly over 40 lenslets, 0.2 bin a lenslet along each
    // axis: 0.28 in the Frobenius norm, 0.57 in the EMD gradient (over two lenslets). Bins of finite width make that
    // ripple: a spot 1.22 bins wide moves its mean up to 1.27 times as fast as itself over 0.4 bin, so 0.36 and 0.72.
    // Noise adds less than 0.04 to the first from 500 electrons a lenslet on, and up to 0.3 to the second, where it
    // does not average out. Set them lower for weaker parts. Transmission: at 500 electrons a lenslet photon noise
    // is 4.5 %, 8-bit rounding with the dark level 2 %, together 25 % at five sigma; the light of a good lens varies by
    // 4 % more. An opaque spot that covers 30 % of a lenslet is found. Measured on traced frames in
    // tests/algo/inspection/real_frames_test.cpp, on drawn ones in properties_test.cpp.
    float emd_limit_bins = 1.0F;        // neighbour EMD gradient, Euclidean ground, bin pitches (Eqs. 9-11)
    float frobenius_limit_bins = 0.4F;  // |Jacobian of the mean deflection|_F, bin pitches a lenslet (Eqs. 12-14)
    float transmission_limit = 0.7F;    // light relative to the part's own typical lenslet, 0 (off) to 1
    std::uint32_t min_area = 1;         // lenslets
    // Of a gradient other than the EMD, in its own unit (unit_of). Good parts set it (hordctl tune), there is no usual
    // one.
    float gradient_limit = 0;

    // The part's own rim lights up in every gradient. `rim_margin` lenslets inside it are not judged; negative:
    // chosen from the number of lenslets (documented in algo/inspection/rim.h).
    int rim_margin = -1;

    // More than this share of the judged lenslets without light, or saturated, makes the frame unfit.
    float max_saturated_share = 0.02F;
    float min_lit_share = 0.05F;

    std::vector<Zone> zones;

    // Of the measurement plane and of a bin; 0: not known. Needed where a zone or a tolerance is in mm or radians.
    float lenslet_mm = 0;
    float bin_rad = 0;

    // Good parts to compare with (algo/inspection/reference_defects.h); none: parts are judged by themselves alone. The
    // scores are in units of noise: a lenslet at `reject_score` is a defect, it grows over neighbours down to
    // `grow_score`, and weaker ones that lie together count when the root of their sum of squares reaches
    // `cluster_score`.
    std::shared_ptr<const Reference> reference;
    float reject_score = 6.0F;
    float grow_score = 3.5F;
    float cluster_score = 9.0F;
    std::vector<Tolerance> tolerances;
};

// The limit of the gradient that was chosen; 0 without one.
float limit_of_gradient(const Recipe& recipe);

// The recipe's light levels at a bit depth, in DN.
struct LightLevels;  // algo/frame/decode.h
LightLevels light_levels(const Recipe& recipe, int bits);

// All problems of a recipe for light fields of these extents, one line each; empty when it can be used.
std::vector<std::string> problems(const Recipe& recipe, const Extents& extents);

}  // namespace hord::algo
