#include "algo/recipe/recipe.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "algo/frame/decode.h"
#include "algo/light/dark_bins.h"
#include "algo/recipe/zones.h"
#include "algo/reference/reference.h"

namespace hord::algo {
namespace {

// Lenslets: a defect of 4 x 4 is a whole bubble or speck, and no longer noise of single lenslets.
constexpr std::uint32_t kLargeMinArea = 16;

// Lenslets: a quarter is left of 61x61 lenslets, half of 111x111.
constexpr int kLargeMargin = 16;

// Scores against a reference: a lenslet without any light has sqrt(2 N) for N electrons, 100 at 5000; a hundred of them
// as a region ten times as much.
constexpr float kLargeScore = 100, kLargeClusterScore = 1000;

constexpr float kLargeSaturatedShare = 0.25F;

// As a recipe file's problems name it: counted from 0.
std::string name_of_zone(std::size_t number) { return "zone[" + std::to_string(number) + "]: "; }

void check_zone(const Zone& zone, std::size_t number, float lenslet_mm, std::vector<std::string>& messages) {
    const std::string name = name_of_zone(number);
    const bool in_mm = zone.unit == Zone::Unit::mm;
    const std::string unit = in_mm ? "mm" : "lenslets";
    if (in_mm && !(lenslet_mm > 0))
        messages.push_back(name + "is in mm, and the size of a lenslet is not known: give lenslet_mm");
    if (zone.shape == Zone::Shape::circle) {
        if (!std::isfinite(zone.centre.m) || !std::isfinite(zone.centre.n))
            messages.push_back(name + "the centre is not a number: give it in " + unit);
        if (!(zone.radius > 0) || !std::isfinite(zone.radius))
            messages.push_back(name + "a circle needs a radius above 0 " + unit);
        return;
    }
    if (zone.corners.size() < 3) messages.push_back(name + "a polygon needs at least three corners");
    for (const Point& corner : zone.corners) {
        if (std::isfinite(corner.m) && std::isfinite(corner.n)) continue;
        messages.push_back(name + "a corner is not a number: give it in " + unit);
        break;
    }
}

// Whether the box around the zone lies outside the lenslets' centres.
bool is_outside(const Zone& zone, const Extents& extents, float lenslet_mm) {
    std::vector<Point> box = zone.corners;
    if (zone.shape == Zone::Shape::circle) {
        box = {{zone.centre.m - zone.radius, zone.centre.n - zone.radius},
               {zone.centre.m + zone.radius, zone.centre.n + zone.radius}};
    }
    const bool in_mm = zone.unit == Zone::Unit::mm;
    const auto outside = [&](float Point::*axis, int count) {
        const auto [low, high] = std::ranges::minmax(box, {}, axis);
        const double scale = in_mm ? 1 / static_cast<double>(lenslet_mm) : 1, origin = in_mm ? 0.5 * (count - 1) : 0;
        return high.*axis * scale + origin < 0 || low.*axis * scale + origin > count - 1;
    };
    return outside(&Point::m, extents.m) || outside(&Point::n, extents.n);
}

// The chosen features can judge a part, and every limit that is given belongs to one of them.
void check_features(const Recipe& r, std::vector<std::string>& messages) {
    const Recipe defaults;
    if (r.gradient && !is_judged_gradient(*r.gradient)) {
        std::string judged;
        for (const Feature feature : kJudgedGradients)
            judged += (judged.empty() ? "" : ", ") + std::string(name_of(feature));
        messages.push_back("no part is judged by " + std::string(name_of(*r.gradient)) + ": use one of " + judged);
    }
    const bool other_than_emd = r.gradient && *r.gradient != Feature::emd;
    if (other_than_emd && !(r.gradient_limit > 0 && std::isfinite(r.gradient_limit))) {
        messages.push_back("the limit of " + std::string(name_of(*r.gradient)) +
                           " must be above 0: good parts tell which (hordctl tune)");
    }
    const auto check_unused = [&](bool on, float limit, float default_limit, const char* name, const char* feature) {
        if (!on && limit != default_limit)
            messages.push_back(std::string(name) + " is a limit of " + feature +
                               ", which is not among the recipe's features: add that, or leave the limit out");
    };
    check_unused(r.gradient == Feature::emd, r.emd_limit_bins, defaults.emd_limit_bins, "emd_limit_bins", "emd");
    check_unused(other_than_emd, r.gradient_limit, defaults.gradient_limit, "gradient_limit",
                 "marginal, hellinger or chi2");
    check_unused(r.slopes, r.frobenius_limit_bins, defaults.frobenius_limit_bins, "frobenius_limit_bins",
                 "jacobian-frobenius");
    check_unused(r.light, r.transmission_limit, defaults.transmission_limit, "transmission_limit", "transmission");
    if (r.reference && other_than_emd) {
        messages.push_back(
            "a reference knows how much the emd of good parts changes from lenslet to lenslet, not their " +
            std::string(name_of(*r.gradient)) + ": choose emd or no gradient");
    }
    if (!r.reference && !r.gradient && !r.slopes && !(r.light && r.transmission_limit > 0)) {
        messages.emplace_back("nothing would be judged: choose a feature, or give a reference");
    }
}

}  // namespace

bool gradient_is_in_bins(const Recipe& recipe) {
    return recipe.gradient == Feature::emd || recipe.gradient == Feature::marginal;
}

float limit_of_gradient(const Recipe& recipe) {
    if (!recipe.gradient) return 0;
    return *recipe.gradient == Feature::emd ? recipe.emd_limit_bins : recipe.gradient_limit;
}

void scale_score_limits(Recipe& recipe, double factor) {
    const auto scale = [](float& limit, double by) { limit = static_cast<float>(static_cast<double>(limit) * by); };
    scale(recipe.reject_score, factor), scale(recipe.cluster_score, factor);
    scale(recipe.grow_score, std::max(factor, 1.0));
    recipe.grow_score = std::min(recipe.grow_score, recipe.reject_score);
}

namespace {

std::uint32_t default_dark_dn(int bits) { return kDarkDn8Bit << (bits - 8); }

}  // namespace

LightLevels light_levels(const Recipe& recipe, int bits) {
    const std::uint32_t full_scale = (1U << bits) - 1U;
    const std::uint32_t per_8_bit_dn = 1U << (bits - 8);
    return {recipe.dark_dn != 0    ? recipe.dark_dn
                : recipe.reference ? recipe.reference->levels.dark
                                   : default_dark_dn(bits),
            recipe.min_sum_dn == 0 ? kMinSumDn8Bit * per_8_bit_dn : recipe.min_sum_dn,
            recipe.saturated_dn == 0 ? full_scale : recipe.saturated_dn};
}

DarkLevel kind_of_dark_level(const Recipe& recipe) {
    return recipe.dark_dn == 0 && recipe.reference == nullptr ? DarkLevel::by_default : DarkLevel::chosen;
}

namespace {

// Limits of gradients from which on no light field of the largest bins reaches them: the EMD of neighbours is at most
// the diagonal along both axes; a central difference of the mean deflection at most half the side, in four components.
constexpr float kLargestEmdGradient = 2 * (kMaxBins - 1), kLargestJacobian = kMaxBins - 1;
constexpr std::uint32_t kFullScale8Bit = 255;

// What keys change nothing, or let nothing be judged, at the values that they have.
void note_blind_limits(const Recipe& recipe, std::vector<std::string>& messages) {
    const auto out_of_reach = [&](const char* key, float limit, float largest) {
        messages.push_back(std::string(key) + " " + std::to_string(std::lround(limit)) +
                           " is reached by no light field, so that nothing is judged by it: 15x15 bins reach " +
                           std::to_string(std::lround(largest)) + ", 9x9 bins " +
                           std::to_string(std::lround(largest * 8 / (kMaxBins - 1))) + "; lower it");
    };
    if (recipe.gradient == Feature::emd && recipe.emd_limit_bins >= kLargestEmdGradient)
        out_of_reach("emd_bins", recipe.emd_limit_bins, kLargestEmdGradient);
    if (recipe.slopes && recipe.frobenius_limit_bins >= kLargestJacobian)
        out_of_reach("frobenius_bins", recipe.frobenius_limit_bins, kLargestJacobian);
}

void note_light_levels(const Recipe& recipe, std::vector<std::string>& messages) {
    const auto of_full_scale = [](std::uint32_t dn) { return std::to_string(dn) + " of 255 DN"; };
    const std::uint32_t dark = recipe.dark_dn == 0 ? kDarkDn8Bit : recipe.dark_dn;
    // The light of a full bin, if it lies on the corner of four, is a quarter in each.
    if (recipe.dark_dn > kFullScale8Bit / 4)
        messages.push_back("dark_dn takes " + of_full_scale(recipe.dark_dn) +
                           " of 8-bit frames away: a full bin's light that lies between four does not count above 63 "
                           "DN, and nothing does from 255 on; give the level of the dark bins");
    if (recipe.max_dark_rise_dn > 0 && recipe.max_dark_rise_dn + dark > kFullScale8Bit / 4)
        messages.push_back(
            "max_dark_rise_dn lets fog or a black level of " +
            of_full_scale(std::min(recipe.max_dark_rise_dn + dark, kFullScale8Bit)) +
            " of 8-bit frames pass: above 63 DN it takes a full bin's light that lies between four; lower it");
    const bool most_may_be = recipe.max_saturated_share > kLargeSaturatedShare;
    if (recipe.saturated_dn > 0 && recipe.saturated_dn <= kFullScale8Bit / 4)
        messages.push_back("lenslets with a sample of " + std::to_string(recipe.saturated_dn) +
                           " DN (saturated_dn) are not judged: at a quarter of the full scale and below that is nearly "
                           "every lit one, and the frame " +
                           (most_may_be ? "passes unjudged (max_saturated_share)" : "is unfit (saturated)") +
                           "; give the level at which the sensor clips");
    if (most_may_be)
        messages.push_back("saturated lenslets are not judged, and " +
                           std::to_string(std::lround(100 * recipe.max_saturated_share)) +
                           " % of a part may be (max_saturated_share): a defect among them passes; lower it, and the "
                           "exposure");
}

// Side of the largest of these square fields of which the zones leave nothing; 0: none.
int side_without_judged(const Recipe& recipe) {
    if (std::ranges::none_of(recipe.zones, [](const Zone& z) { return z.use == Zone::Use::ignore; })) return 0;
    if (std::ranges::any_of(recipe.zones, [](const Zone& z) { return z.unit == Zone::Unit::mm; }) &&
        !(recipe.lenslet_mm > 0))
        return 0;  // a problem
    int largest = 0;
    for (const int side : {15, 31, 61, 111, 222, 555}) {
        if (!leaves_nothing(recipe.zones, {side, side, 9, 9}, recipe.lenslet_mm)) break;
        largest = side;
    }
    return largest;
}

// Of the fields that a sensor is likely to have, the largest; lenslets.
constexpr int kLargeField = 555;

// An inspect zone of which no lenslet lies on a field of any usual size.
bool has_zone_outside(const Recipe& recipe) {
    return std::ranges::any_of(recipe.zones, [&](const Zone& zone) {
        return zone.use == Zone::Use::inspect && (zone.unit == Zone::Unit::lenslets || recipe.lenslet_mm > 0) &&
            leaves_nothing(std::span(&zone, 1), {kLargeField, kLargeField, 9, 9}, recipe.lenslet_mm);
    });
}

// What single frames of a form cannot show.
void note_form_alone(const Recipe& recipe, std::vector<std::string>& messages) {
    if (recipe.form == PartForm::tube)
        messages.emplace_back(
            "the flanks and ends of a tube are not judged without a reference, holes and cracks in its wall can "
            "pass, and so can slopes that are alike along its whole length and on both sides of its axis; good "
            "tubes whose walls hardly bend light, or with few lenslets across, can be unfit or rejected: learn "
            "one with `hordctl learn`");
    if (recipe.form == PartForm::plate && recipe.part_required)
        messages.emplace_back(
            "a plate is found by its edges and by the light that its faces reflect: one whose edges neither darken nor "
            "deflect light, or whose faces are coated against reflections, is unfit (no-part); learn a reference of it "
            "(hordctl learn), or write [part] present = \"unchecked\"; without one small holes and thin cracks "
            "(three lenslets across or less in clear glass), and corners and notches of two lenslets at its edge, "
            "can pass; of one that reaches from border to border only what is in the field is judged");
    if (recipe.form == PartForm::web && recipe.light && recipe.transmission_limit > 0)
        messages.emplace_back(
            "a hole in a film that takes less than 3 % of the light, as one that is coated against reflections, shows "
            "the same light as the film and passes, and dense rows of holes in clear film, and a film of which a "
            "corner is left in the field, can pass: learn a reference with `hordctl learn`");
    if (recipe.form == PartForm::round && recipe.symmetric_outline && recipe.light && recipe.transmission_limit > 0)
        messages.emplace_back(
            "a round part is compared with itself: small holes and cracks in it, and notches at its rim, can pass, and "
            "so can one that is bad all over in the same way (haze, another curvature): learn a reference with "
            "`hordctl learn`");
    if (!recipe.symmetric_outline && recipe.form != PartForm::web)
        messages.emplace_back(
            recipe.form == PartForm::tube
                ? "[part] outline = \"any\" takes a tube of which the field shows one end for a whole one, so that "
                  "late "
                  "triggers and broken tubes can pass: show both ends or none, or learn a reference with `hordctl "
                  "learn`"
                : "[part] outline = \"any\" takes a broken part for one of another shape, so that missing corners, "
                  "notches and halves can pass: learn a reference with `hordctl learn`");
}

// Keys of [reference] that change nothing without a reference.
void note_scores_alone(const Recipe& recipe, std::vector<std::string>& messages) {
    const Recipe usual;
    const bool has_scores = recipe.reject_score != usual.reject_score || recipe.grow_score != usual.grow_score ||
        recipe.cluster_score != usual.cluster_score || recipe.pooled_score != usual.pooled_score;
    if (has_scores || recipe.lacks_reference_file)
        messages.push_back(
            std::string(has_scores ? "the scores of [reference] change nothing" : "[reference] changes nothing") +
            ", because it names no file: parts are compared with themselves, by [limits]; learn a "
            "reference with `hordctl learn`");
}

// Defects that the features and their limits do not see.
void note_features_alone(const Recipe& recipe, std::vector<std::string>& messages) {
    const bool any_gradient = (recipe.gradient == Feature::emd && recipe.emd_limit_bins < kLargestEmdGradient) ||
        (recipe.gradient && recipe.gradient != Feature::emd) ||
        (recipe.slopes && recipe.frobenius_limit_bins < kLargestJacobian);
    if (!recipe.light || recipe.transmission_limit <= 0)
        messages.emplace_back(
            any_gradient ? "missing light is not judged, nor light that is too bright, and dark lenslets have no "
                           "gradient, so that specks, cuts, bubbles, holes and notches can pass: name transmission in "
                           "features, with a limit above 0"
                         : "no defect can reach these limits, so every part passes: lower emd_bins "
                           "below 28 or frobenius_bins below 14, or set transmission above 0");
    if (any_gradient || (recipe.light && recipe.transmission_limit > 0)) note_blind_limits(recipe, messages);
    if (!recipe.gradient && !recipe.slopes && recipe.light && recipe.transmission_limit > 0)
        messages.emplace_back(
            "nothing but light is judged: scratches, dimples, striae and bubbles that bend light and take none pass; "
            "name emd and jacobian-frobenius in features, with limits in reach");
}

void note_reference(const Recipe& recipe, std::vector<std::string>& messages) {
    if (recipe.pooled_score > 0 && recipe.reference->pooled_scales.empty())
        messages.emplace_back(
            "the reference was learned by a program that did not measure what several lenslets show "
            "together, so that pooled_score changes nothing: haze, striae and faint scratches can pass; learn "
            "it again (hordctl learn)");
    if (recipe.reject_score > kLargeScore)
        messages.push_back("reject_score " + std::to_string(std::lround(recipe.reject_score)) +
                           " is reached by hardly any defect: a lenslet without light has 100 at 5000 electrons; lower "
                           "it (the default is 6)");
    if (recipe.cluster_score > kLargeClusterScore)
        messages.push_back("cluster_score " + std::to_string(std::lround(recipe.cluster_score)) +
                           " is reached by hardly any region: a hundred lenslets without light have 1000 at 5000 "
                           "electrons; lower it (the default is 9)");
}

// What is too small or too near to the rim to be judged.
void note_area_and_rim(const Recipe& recipe, std::vector<std::string>& messages) {
    if (recipe.min_area > kLargeMinArea)
        messages.push_back("defects of fewer than " + std::to_string(recipe.min_area) +
                           " lenslets pass (min_area), and all of them where the part has fewer: a dark spot " +
                           std::to_string(static_cast<int>(
                               std::lround(2 * std::sqrt(recipe.min_area * std::numbers::inv_pi_v<double>)))) +
                           " lenslets across; choose a smaller min_area, or raise the limits instead");
    if (recipe.rim_margin >= kLargeMargin) {
        const auto left_of = [&](int side) { return std::to_string(std::max(side - 2 * recipe.rim_margin, 0)); };
        messages.push_back("rim_margin " + std::to_string(recipe.rim_margin) +
                           " leaves nothing to judge of a field of " + std::to_string(2 * recipe.rim_margin) +
                           " lenslets across or less, or of such a part, " + left_of(61) +
                           " lenslets across of 61 and " + left_of(111) + " of 111: the default is 2 at 111, 4 at 555");
    }
}

}  // namespace

std::vector<std::string> notes(const Recipe& recipe) {
    std::vector<std::string> messages;
    if (recipe.reference) {
        note_reference(recipe, messages);
    } else {
        note_form_alone(recipe, messages);
        note_scores_alone(recipe, messages);
        note_features_alone(recipe, messages);
    }
    note_light_levels(recipe, messages);
    constexpr std::uint32_t kSumOf9x9 = 81 * 255;
    if (recipe.min_sum_dn > kSumOf9x9)
        messages.push_back("min_sum_dn " + std::to_string(recipe.min_sum_dn) +
                           " is more than 9x9 bins of 8 bits can hold, " + std::to_string(kSumOf9x9) +
                           ": such frames are refused");
    note_area_and_rim(recipe, messages);
    if (const int side = side_without_judged(recipe); side > 0)
        messages.push_back("the zones leave nothing of a field of " + std::to_string(side) + "x" +
                           std::to_string(side) + " lenslets to judge: make the ignore zones smaller");
    if (has_zone_outside(recipe))
        messages.push_back("an inspect zone lies outside of a field of " + std::to_string(kLargeField) + "x" +
                           std::to_string(kLargeField) + " lenslets, and of smaller ones: nothing is judged in it");
    if (!recipe.part_required)
        messages.emplace_back("whether a part is there is not checked: a frame of the empty field can pass");
    return messages;
}

std::uint32_t max_dark_rise(const Recipe& recipe, int bits) {
    const std::uint32_t rise = recipe.max_dark_rise_dn == 0 ? default_dark_rise(bits) : recipe.max_dark_rise_dn,
                        dark = light_levels(recipe, bits).dark;
    // A reference's own dark level does not lower the highest pedestal that is allowed.
    return rise + (recipe.dark_dn == 0 ? default_dark_dn(bits) - std::min(dark, default_dark_dn(bits)) : 0);
}

std::vector<std::string> problems(const Recipe& recipe, const Extents& extents) {
    std::vector<std::string> messages;
    const auto positive = [&](float value, const char* name, const char* unit) {
        if (!(value > 0) || !std::isfinite(value)) messages.push_back(std::string(name) + " must be above 0 " + unit);
    };
    const auto share = [&](float value, const char* name) {
        if (!(value >= 0 && value <= 1)) messages.push_back(std::string(name) + " must be from 0 to 1");
    };
    positive(recipe.emd_limit_bins, "emd_limit_bins", "bin pitches");
    positive(recipe.frobenius_limit_bins, "frobenius_limit_bins", "bin pitches a lenslet");
    if (!(recipe.transmission_limit >= 0 && recipe.transmission_limit < 1)) {
        messages.push_back("transmission_limit must be from 0 (off) to below 1");
    }
    check_features(recipe, messages);
    share(recipe.max_saturated_share, "max_saturated_share");
    share(recipe.min_lit_share, "min_lit_share");
    share(recipe.max_second_share, "max_second_share");
    const auto limit_or_off = [&](float value, const char* name) {
        if (!(value >= 0) || !std::isfinite(value))
            messages.push_back(std::string(name) + " must be above 0 bin pitches, or 0: off");
    };
    limit_or_off(recipe.max_offset_bins, "max_offset_bins");
    limit_or_off(recipe.max_spot_bins, "max_spot_bins");
    if (recipe.min_area > extents.lenslets())
        messages.push_back("min_area must be at most the number of lenslets, " + std::to_string(extents.lenslets()));
    if (std::int64_t{recipe.rim_margin} * 2 >= std::min(extents.m, extents.n)) {
        messages.push_back("rim_margin " + std::to_string(recipe.rim_margin) + " leaves nothing of a field of " +
                           std::to_string(extents.m) + "x" + std::to_string(extents.n) +
                           " lenslets to judge: use at most " +
                           std::to_string((std::min(extents.m, extents.n) - 1) / 2));
    }
    for (const Zone& zone : recipe.zones) {
        if (zone.unit == recipe.zones.front().unit) continue;
        messages.push_back("some zones are in lenslets and some in mm: use one unit for all");
        break;
    }
    for (std::size_t k = 0; k < recipe.zones.size(); ++k) {
        const std::size_t known = messages.size();
        check_zone(recipe.zones[k], k, recipe.lenslet_mm, messages);
        if (messages.size() == known && is_outside(recipe.zones[k], extents, recipe.lenslet_mm))
            messages.push_back(name_of_zone(k) + "lies outside the field of " + std::to_string(extents.m) + "x" +
                               std::to_string(extents.n) + " lenslets: move it into the field, or leave it out");
    }
    return messages;
}

}  // namespace hord::algo
