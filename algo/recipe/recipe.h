// What is tolerated on a part: features, limits, zones. Read from TOML by firmware/recipes/recipe_file.h.
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

// A region of the field; it does not follow the part. If there are `inspect` zones, only lenslets in at least one of
// them are judged. Lenslets in an `ignore` zone are not judged.
//
// Coordinates grow to the right and down. In lenslets, (0, 0) is the centre of the top-left lenslet. In mm, (0, 0) is
// the middle of the field, lenslet ((M-1)/2, (N-1)/2), and a lenslet is Recipe::lenslet_mm wide.
struct Zone {
    enum class Shape : std::uint8_t { circle, polygon };
    enum class Use : std::uint8_t { inspect, ignore };
    enum class Unit : std::uint8_t { lenslets, mm };
    Shape shape = Shape::circle;
    Use use = Use::inspect;
    Unit unit = Unit::lenslets;  // of the members below
    Point centre;                // circle
    float radius = 0;            // circle
    std::vector<Point> corners;  // polygon, at least three

    [[nodiscard]] bool contains(float m, float n) const;  // (m, n) in the zone's unit
};

// Allows up to `number` defects of the given kinds, place and size. A defect that no tolerance allows rejects the part.
struct Tolerance {
    std::uint32_t kinds = 0xFFFFFFFFU;  // bit 1 << DefectKind: the kinds it applies to
    std::optional<Zone> where;          // in lenslets of the reference; none: everywhere
    float largest_mm = 0;               // diameter of the disc of equal area; of scratches the length
    float deepest_rad = 0;              // largest change of direction; 0: unlimited
    std::uint32_t number = 1;           // defects allowed

    [[nodiscard]] bool applies_to(DefectKind kind) const { return (kinds >> static_cast<unsigned>(kind) & 1U) != 0; }
};

// What a part looks like in the field: where it ends, and what of it is not judged (algo/inspection/rim.h).
enum class PartForm : std::uint8_t {
    round,  // a solid body with an outline inside the field: lenses, domes, moulded parts
    tube,   // a hollow body with dark flanks along its axis: vials, syringes, tubes
    plate,  // a flat body with edges inside the field; its middle does not deflect light
    web,    // fills the field in every frame: film, strip, sheet glass
};

struct Reference;  // algo/reference/reference.h

// The distances between neighbours that can judge a part, the most expensive first. Why only these:
// docs/adr/0004-feature-sets.md.
inline constexpr std::array kJudgedGradients = {Feature::emd, Feature::marginal, Feature::hellinger, Feature::chi2};
constexpr bool is_judged_gradient(Feature feature) {
    return std::ranges::find(kJudgedGradients, feature) != kJudgedGradients.end();
}

// Default light levels at 8 bits, DN; at b bits 2^(b-8) times as many, the same share of the full scale.
// Why these: docs/notes/inspection.md.
constexpr std::uint32_t kDarkDn8Bit = 3;
constexpr std::uint32_t kMinSumDn8Bit = 16;

struct Recipe {
    std::string name = "default";

    // Light levels. `dark_dn` is subtracted from every sample; negative differences count as 0. A lenslet whose sum is
    // then below `min_sum_dn` is masked: it has no HORD. A lenslet with a sample at or above `saturated_dn` is masked
    // as saturated. 0 selects the defaults: the levels above, and the full scale; with a reference dark_dn is then the
    // level that the reference learned with. Give dark_dn = 1 if the camera subtracts its dark level itself.
    std::uint32_t dark_dn = 0;
    std::uint32_t min_sum_dn = 0;
    std::uint32_t saturated_dn = 0;

    // The dark level is raised to the frame's own dark bins (algo/light/dark_bins.h). The pedestal may lie so far above
    // `dark_dn`, DN; 0: the default of the bit depth. Beyond it the frame is unfit (Reason::unexpected_light).
    std::uint32_t max_dark_rise_dn = 0;

    // Limits on the free light; without free light on all lit lenslets (the offset: webs and plates only). 0: off.
    // Beyond a limit the frame is unfit (Reason::unexpected_light; algo/inspection/frame_checks.h).
    float max_offset_bins = 0.5F;    // mean deflection from the middle of the bins, or from the reference's free light
    float max_spot_bins = 1.0F;      // root mean square of the spot along each axis
    float max_second_share = 0.05F;  // of the light in spots beside the main one, 0..1
    bool check_period = true;        // period of the macro-pixels (Reason::unexpected_geometry), and alternation

    // Features that are computed and judged. A feature that is not chosen is not computed, its map is empty, and its
    // limit must keep the default.
    std::optional<Feature> gradient = Feature::emd;  // one of kJudgedGradients or none; with a reference: emd or none
    bool slopes = true;                              // the Jacobian of the mean deflection
    bool light = true;  // the transmission; with a reference the score of the light is judged instead

    // Limits. A region of lenslets at or above a limit, of at least `min_area` lenslets, is a defect. Why these
    // defaults: docs/notes/inspection.md.
    float emd_limit_bins = 1.0F;        // neighbour EMD gradient, Euclidean ground, bin pitches (Eqs. 9-11)
    float frobenius_limit_bins = 0.4F;  // |Jacobian of the mean deflection|_F, bin pitches a lenslet (Eqs. 12-14)
    float transmission_limit = 0.7F;    // light relative to the part's own typical lenslet, from 0 (off) to below 1
    std::uint32_t min_area = 1;         // lenslets
    float gradient_limit = 0;           // of a gradient other than the EMD, in its unit (unit_of); from hordctl tune

    PartForm form = PartForm::round;
    bool part_required = true;  // a frame without one whole part is unfit (Reason::no_part)
    // A round part is convex and looks the same when it is turned by 180 degrees, as discs and rectangles do; half a
    // part does not. A plate's outline looks the same, too, or is a rectangle as far as the field shows it. The field
    // cuts no plate and no tube, unless they reach from border to border. Not checked with a reference.
    bool symmetric_outline = true;

    // The part's rim has large gradients. So many lenslets inwards from the outline are not judged; negative:
    // default_rim_margin() of algo/inspection/rim.h, and none for a web.
    int rim_margin = -1;

    // Shares of the judged lenslets; beyond them the frame is unfit.
    float max_saturated_share = 0.02F;
    float min_lit_share = 0.05F;

    std::vector<Zone> zones;

    // Pitch of a lenslet on the measurement plane, and of a bin; 0: unknown. Needed where a zone or a tolerance is in
    // mm or radians.
    float lenslet_mm = 0;
    float bin_rad = 0;

    // Good parts to compare with (algo/inspection/reference_defects.h); none: a part is compared with itself only.
    // Scores are in units of noise: a lenslet at `reject_score` is a defect; its region extends over neighbours down to
    // `grow_score`; a region of weaker scores is a defect when the root of their sum of squares reaches
    // `cluster_score`; what several lenslets show together, at `pooled_score` (algo/reference/pooled_scores.h).
    std::shared_ptr<const Reference> reference;
    bool lacks_reference_file = false;  // the recipe file has a section [reference] that names none
    float reject_score = 6.0F;
    float grow_score = 3.5F;
    float cluster_score = 9.0F;
    float pooled_score = 0;  // 0: not judged. `hordctl tune` sets it, from good parts
    std::vector<Tolerance> tolerances;
};

// The limit of the chosen gradient; 0 if there is none.
float limit_of_gradient(const Recipe& recipe);
// The gradient that it chooses is a distance in bin pitches, over two lenslets.
bool gradient_is_in_bins(const Recipe& recipe);

// Multiplies the limits of scores against a reference. grow_score is not lowered, but to reject_score at most: regions
// would grow over lenslets of noise alone, and good parts would have higher scores over the lower limits.
void scale_score_limits(Recipe& recipe, double factor);

// A pooled_score that no frame reaches: to measure what the lenslets of good parts show together.
constexpr float kPooledUnreached = 1000;

// The recipe's light levels at a bit depth, in DN.
struct LightLevels;  // algo/frame/decode.h
LightLevels light_levels(const Recipe& recipe, int bits);
enum class DarkLevel : std::uint8_t;                          // algo/light/dark_bins.h
DarkLevel kind_of_dark_level(const Recipe& recipe);           // that of a reference counts as chosen
std::uint32_t max_dark_rise(const Recipe& recipe, int bits);  // DN

// What of the recipe judges nothing, or less than it seems to, one sentence each, with the value from which on it does:
// forms of parts that single frames cannot judge, limits out of reach, light levels, margins and zones that leave
// nothing. Empty if there is nothing to say.
std::vector<std::string> notes(const Recipe& recipe);

// All problems of a recipe for light fields of these extents, one message each; empty if it can be used.
std::vector<std::string> problems(const Recipe& recipe, const Extents& extents);

}  // namespace hord::algo
