#include "algo/recipe/recipe.h"

#include <cmath>

#include "algo/frame/decode.h"

namespace hord::algo {
namespace {

void check_zone(const Zone& zone, std::size_t number, float lenslet_mm, std::vector<std::string>& lines) {
    const std::string name = "zone " + std::to_string(number + 1) + ": ";
    const bool in_mm = zone.unit == Zone::Unit::mm;
    const std::string unit = in_mm ? "mm" : "lenslets";
    if (in_mm && !(lenslet_mm > 0))
        lines.push_back(name + "is in mm, and the size of a lenslet is not known: give lenslet_mm");
    if (zone.shape == Zone::Shape::circle) {
        if (!std::isfinite(zone.centre.m) || !std::isfinite(zone.centre.n))
            lines.push_back(name + "the centre is not a number: give it in " + unit);
        if (!(zone.radius > 0) || !std::isfinite(zone.radius))
            lines.push_back(name + "a circle needs a radius above 0 " + unit);
        return;
    }
    if (zone.corners.size() < 3) lines.push_back(name + "a polygon needs at least three corners");
    for (const Point& corner : zone.corners) {
        if (std::isfinite(corner.m) && std::isfinite(corner.n)) continue;
        lines.push_back(name + "a corner is not a number: give it in " + unit);
        break;
    }
}

// What is chosen can be judged, and no limit is given that nothing is judged by.
void check_features(const Recipe& r, std::vector<std::string>& lines) {
    const Recipe usual;
    if (r.gradient && !is_judged_gradient(*r.gradient)) {
        std::string judged;
        for (const Feature feature : kJudgedGradients)
            judged += (judged.empty() ? "" : ", ") + std::string(name_of(feature));
        lines.push_back("no part is judged by " + std::string(name_of(*r.gradient)) + ": use one of " + judged);
    }
    const bool other = r.gradient && *r.gradient != Feature::emd;
    if (other && !(r.gradient_limit > 0 && std::isfinite(r.gradient_limit))) {
        lines.push_back("the limit of " + std::string(name_of(*r.gradient)) +
                        " must be above 0: good parts tell which (hordctl tune)");
    }
    const auto idle = [&](bool on, float limit, float as_it_is, const char* name, const char* feature) {
        if (!on && limit != as_it_is)
            lines.push_back(std::string(name) + " is a limit of " + feature +
                            ", which is not among the recipe's features: add that, or leave the limit out");
    };
    idle(r.gradient == Feature::emd, r.emd_limit_bins, usual.emd_limit_bins, "emd_limit_bins", "emd");
    idle(other, r.gradient_limit, usual.gradient_limit, "gradient_limit", "marginal, hellinger or chi2");
    idle(r.slopes, r.frobenius_limit_bins, usual.frobenius_limit_bins, "frobenius_limit_bins", "jacobian-frobenius");
    idle(r.light, r.transmission_limit, usual.transmission_limit, "transmission_limit", "transmission");
    if (r.reference && other) {
        lines.push_back("a reference knows how much the emd of good parts changes from lenslet to lenslet, not their " +
                        std::string(name_of(*r.gradient)) + ": choose emd or no gradient");
    }
    if (!r.reference && !r.gradient && !r.slopes && !(r.light && r.transmission_limit > 0)) {
        lines.emplace_back("nothing would be judged: choose a feature, or give a reference");
    }
}

}  // namespace

float limit_of_gradient(const Recipe& recipe) {
    if (!recipe.gradient) return 0;
    return *recipe.gradient == Feature::emd ? recipe.emd_limit_bins : recipe.gradient_limit;
}

LightLevels light_levels(const Recipe& recipe, int bits) {
    const std::uint32_t full_scale = (1U << bits) - 1U;
    const std::uint32_t per_8_bit_dn = 1U << (bits - 8);
    return {recipe.dark_dn == 0 ? kDarkDn8Bit * per_8_bit_dn : recipe.dark_dn,
            recipe.min_sum_dn == 0 ? kMinSumDn8Bit * per_8_bit_dn : recipe.min_sum_dn,
            recipe.saturated_dn == 0 ? full_scale : recipe.saturated_dn};
}

std::vector<std::string> problems(const Recipe& recipe, const Extents& extents) {
    std::vector<std::string> lines;
    const auto positive = [&](float value, const char* name, const char* unit) {
        if (!(value > 0) || !std::isfinite(value)) lines.push_back(std::string(name) + " must be above 0 " + unit);
    };
    const auto share = [&](float value, const char* name) {
        if (!(value >= 0 && value <= 1)) lines.push_back(std::string(name) + " must be from 0 to 1");
    };
    positive(recipe.emd_limit_bins, "emd_limit_bins", "bin pitches");
    positive(recipe.frobenius_limit_bins, "frobenius_limit_bins", "bin pitches a lenslet");
    if (!(recipe.transmission_limit >= 0 && recipe.transmission_limit < 1)) {
        lines.push_back("transmission_limit must be from 0 (off) to below 1");
    }
    check_features(recipe, lines);
    share(recipe.max_saturated_share, "max_saturated_share");
    share(recipe.min_lit_share, "min_lit_share");
    if (recipe.min_area > extents.lenslets())
        lines.push_back("min_area must be at most the number of lenslets, " + std::to_string(extents.lenslets()));
    if (std::int64_t{recipe.rim_margin} * 2 >= std::min(extents.m, extents.n)) {
        lines.push_back("rim_margin " + std::to_string(recipe.rim_margin) + " leaves nothing of a field of " +
                        std::to_string(extents.m) + "x" + std::to_string(extents.n) + " lenslets to judge");
    }
    for (const Zone& zone : recipe.zones) {
        if (zone.unit == recipe.zones.front().unit) continue;
        lines.push_back("some zones are in lenslets and some in mm: use one unit for all");
        break;
    }
    for (std::size_t k = 0; k < recipe.zones.size(); ++k) check_zone(recipe.zones[k], k, recipe.lenslet_mm, lines);
    return lines;
}

}  // namespace hord::algo
