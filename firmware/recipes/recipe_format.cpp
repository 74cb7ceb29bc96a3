// Writes a recipe as the text of its file, and the checksum of that text.
#include <string>
#include <string_view>

#include <fmt/format.h>

#include "common/crc32.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/recipes/recipe_words.h"
#include "firmware/recipes/reference_file.h"

namespace hord::firmware {
namespace {

// As a TOML basic string, in quotes.
std::string in_quotes(std::string_view text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') (out += '\\') += c;
        else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F)
            out += fmt::format("\\u{:04X}", static_cast<int>(c));
        else out += c;
    }
    return out + '"';
}

// Shape and place in units of `unit` lenslets from `origin`; zones in mm are not converted.
std::string format_place(const algo::Zone& zone, float unit, algo::Point origin) {
    const std::string_view suffix = zone.unit == algo::Zone::Unit::mm ? "_mm" : "";
    const auto m = [&](float v) { return (v - origin.m) * unit; };
    const auto n = [&](float v) { return (v - origin.n) * unit; };
    if (zone.shape == algo::Zone::Shape::circle) {
        return fmt::format("shape = \"circle\"\ncentre{} = [{}, {}]\nradius{} = {}\n", suffix, m(zone.centre.m),
                           n(zone.centre.n), suffix, zone.radius * unit);
    }
    std::string text = fmt::format("shape = \"polygon\"\ncorners{} = [", suffix);
    for (std::size_t k = 0; k < zone.corners.size(); ++k) {
        text += fmt::format("{}{}, {}", k == 0 ? "" : ", ", m(zone.corners[k].m), n(zone.corners[k].n));
    }
    return text + "]\n";
}

// Empty for the default features, so that the text and checksum of a recipe without `features` do not change.
std::string format_features(const algo::Recipe& r) {
    if (r.gradient == algo::Feature::emd && r.slopes && r.light) return "";
    std::string names;
    const auto add = [&](std::string_view name) { names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", name); };
    if (r.gradient) add(name_of(*r.gradient));
    if (r.slopes) add(kSlopes);
    if (r.light) add(kLight);
    return "features = [" + names + "]\n";
}

// The limits of the features that are on; of a feature that is off only if it is set, so that reading reports it.
std::string format_limits(const algo::Recipe& r) {
    const algo::Recipe usual;
    std::string text;
    const auto add = [&](bool on, std::string_view key, float value, float as_usual) {
        if (on || value != as_usual) text += fmt::format("{} = {}\n", key, value);
    };
    add(r.gradient == algo::Feature::emd, limit_key(algo::Feature::emd), r.emd_limit_bins, usual.emd_limit_bins);
    if (r.gradient && *r.gradient != algo::Feature::emd)
        add(true, limit_key(*r.gradient), r.gradient_limit, usual.gradient_limit);
    add(r.slopes, "frobenius_bins", r.frobenius_limit_bins, usual.frobenius_limit_bins);
    add(r.light, "transmission", r.transmission_limit, usual.transmission_limit);
    return text + fmt::format("min_area = {}\n", r.min_area);
}

// The limits on the frame's light; each is omitted where usual, so that the checksum of older recipes does not change.
std::string format_light_checks(const algo::Recipe& r) {
    const algo::Recipe usual;
    std::string text;
    const auto add = [&](std::string_view key, auto value, auto as_usual) {
        if (value != as_usual) text += fmt::format("{} = {}\n", key, value);
    };
    add("max_dark_rise_dn", r.max_dark_rise_dn, usual.max_dark_rise_dn);
    add("max_offset_bins", r.max_offset_bins, usual.max_offset_bins);
    add("max_spot_bins", r.max_spot_bins, usual.max_spot_bins);
    add("max_second_share", r.max_second_share, usual.max_second_share);
    if (!r.check_period) text += fmt::format("period = \"{}\"\n", kChecked[1]);
    return text;
}

// The recipe's text with `reference` as the name of its reference.
std::string format(const NumberedRecipe& numbered, const std::string& reference_name) {
    const algo::Recipe& r = numbered.recipe;
    std::string text =
        fmt::format("schema = {}\nname = {}\nnumber = {}\nversion = {}\nrim_margin = {}\n{}\n", kRecipeSchema,
                    in_quotes(r.name), numbered.number, numbered.version, r.rim_margin, format_features(r));
    // Omitted where usual, so that the checksum of older recipes does not change.
    const bool required = r.form != algo::PartForm::web;
    if (r.form != algo::PartForm::round || r.part_required != required || !r.symmetric_outline) {
        text += fmt::format("[part]\nform = \"{}\"\n", kPartForms[static_cast<std::size_t>(r.form)]);
        if (r.part_required != required)
            text += fmt::format("present = \"{}\"\n", kPartPresence[r.part_required ? 0 : 1]);
        if (!r.symmetric_outline) text += fmt::format("outline = \"{}\"\n", kOutlines[1]);
        text += "\n";
    }
    text += fmt::format(
        "[light]\ndark_dn = {}\nmin_sum_dn = {}\nsaturated_dn = {}\nmax_saturated_share = {}\nmin_lit_share = {}\n{}\n",
        r.dark_dn, r.min_sum_dn, r.saturated_dn, r.max_saturated_share, r.min_lit_share, format_light_checks(r));
    text += "[limits]\n" + format_limits(r);
    for (const algo::Zone& zone : r.zones) {
        text += fmt::format("\n[[zone]]\nuse = \"{}\"\n", zone.use == algo::Zone::Use::inspect ? "inspect" : "ignore");
        text += format_place(zone, 1, {});
    }
    // Omitted without a reference, so that the checksum of such a recipe does not change.
    if (r.lenslet_mm > 0 || r.bin_rad > 0) {
        text += "\n[scale]\n";
        if (r.lenslet_mm > 0) text += fmt::format("lenslet_mm = {}\n", r.lenslet_mm);
        if (r.bin_rad > 0) text += fmt::format("bin_rad = {}\n", r.bin_rad);
    }
    // Score limits may be set before a reference is learned.
    const algo::Recipe usual;
    const bool has_scores = r.reject_score != usual.reject_score || r.grow_score != usual.grow_score ||
        r.cluster_score != usual.cluster_score || r.pooled_score != usual.pooled_score;
    if (!numbered.reference_file.empty() || has_scores) {
        text += "\n[reference]\n";
        if (!numbered.reference_file.empty()) text += fmt::format("file = {}\n", in_quotes(reference_name));
        text += fmt::format("reject_score = {}\ngrow_score = {}\ncluster_score = {}\n", r.reject_score, r.grow_score,
                            r.cluster_score);
        // Omitted where it is the default, so that the checksum of recipes of before does not change.
        if (r.pooled_score != usual.pooled_score) text += fmt::format("pooled_score = {}\n", r.pooled_score);
    }
    for (const algo::Tolerance& t : r.tolerances) {
        text += "\n[[tolerate]]\nkinds = [";
        for (unsigned k = 0, named = 0; k < kDefectKinds; ++k) {
            if (t.applies_to(static_cast<algo::DefectKind>(k)))
                text += fmt::format("{}\"{}\"", named++ == 0 ? "" : ", ", name_of(static_cast<algo::DefectKind>(k)));
        }
        text += fmt::format("]\nlargest_mm = {}\nnumber = {}\n", t.largest_mm, t.number);
        if (t.deepest_rad > 0) text += fmt::format("deepest_rad = {}\n", t.deepest_rad);
        if (t.where && r.reference) text += format_place(*t.where, r.lenslet_mm, middle_of(*r.reference));
    }
    return text;
}

}  // namespace

std::string format_recipe(const NumberedRecipe& recipe) { return format(recipe, recipe.reference_file.string()); }

std::string format_recipe_in(const std::filesystem::path& folder, const NumberedRecipe& recipe) {
    const auto inside = recipe.reference_file.lexically_relative(std::filesystem::absolute(folder));
    const bool is_inside = !inside.empty() && *inside.begin() != "..";
    return format(recipe, (is_inside ? inside : recipe.reference_file).string());
}

std::uint32_t crc32_of(const NumberedRecipe& recipe) {
    const auto& reference = recipe.recipe.reference;
    return common::crc32(
        format(recipe, reference ? fmt::format("crc32 {:08X}", crc32_of(reference)) : recipe.reference_file.string()));
}

}  // namespace hord::firmware
