#include "firmware/recipes/recipe_file.h"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "common/crc32.h"
#include "common/file_kind.h"
#include "common/file_writing.h"
#include "common/name_bytes.h"
#include "common/toml_fields.h"
#include "common/utf8.h"
#include "firmware/recipes/reference_file.h"

namespace hord::firmware {
namespace {

using common::TomlProblems;
using common::TomlTable;

constexpr int kRecipeSchema = 1;
constexpr double kFar = 100'000;  // lenslets; larger than any light field
constexpr unsigned kDefectKinds = 5;
constexpr std::array<std::string_view, 4> kPartForms{"round", "tube", "plate", "web"};  // as algo::PartForm
constexpr std::array<std::string_view, 2> kPartPresence{"required", "unchecked"};
constexpr std::array<std::string_view, 2> kOutlines{"symmetric", "any"};
constexpr std::array<std::string_view, 2> kChecked{"checked", "unchecked"};

// A zone in its own unit. Keys without `_mm` are in `plain`: lenslets for a zone, mm for a tolerance.
algo::Zone read_zone(TomlTable& table, algo::Zone::Unit plain) {
    constexpr std::array<std::string_view, 2> shapes{"circle", "polygon"};
    constexpr std::array<std::string_view, 2> uses{"inspect", "ignore"};
    algo::Zone zone;
    if (!table.has("shape")) table.problem("shape", "is missing", "use circle or polygon");
    const auto shape = table.choice("shape", shapes);
    if (const auto use = table.choice("use", uses)) zone.use = static_cast<algo::Zone::Use>(*use);
    const auto has = [&](std::string_view key) { return table.has(key); };
    constexpr std::array<std::string_view, 3> place{"centre", "radius", "corners"},
        place_mm{"centre_mm", "radius_mm", "corners_mm"};
    const auto said_mm = std::ranges::find_if(place_mm, has);
    if (said_mm != place_mm.end() && std::ranges::any_of(place, has))
        table.problem(*said_mm, "stands beside a place without _mm", "use one unit for the whole zone");
    const auto [centre_key, radius_key, corners_key] = said_mm != place_mm.end() ? place_mm : place;
    zone.unit = said_mm != place_mm.end() ? algo::Zone::Unit::mm : plain;
    const bool in_mm = zone.unit == algo::Zone::Unit::mm;
    const std::string axes = in_mm ? "x, y" : "m, n", unit = in_mm ? "mm from the field's middle" : "lenslets";
    std::vector<double> centre, corners;
    table.numbers(centre_key, centre, 2, 2);
    table.number(radius_key, zone.radius, in_mm ? 1e-6 : 0.5, kFar);
    table.numbers(corners_key, corners, 6, 2000);
    if (!shape) return zone;
    zone.shape = static_cast<algo::Zone::Shape>(*shape);
    if (zone.shape == algo::Zone::Shape::circle) {
        if (!table.has(centre_key))
            table.problem(centre_key, "is missing", fmt::format("write {} = [{}], in {}", centre_key, axes, unit));
        if (!table.has(radius_key))
            table.problem(radius_key, "is missing", in_mm ? "give it in mm" : "give it in lenslets");
        if (!corners.empty()) table.problem(corners_key, "belongs to a polygon", "remove it");
        if (centre.size() == 2) zone.centre = {static_cast<float>(centre[0]), static_cast<float>(centre[1])};
    } else {
        if (!table.has(corners_key))
            table.problem(corners_key, "is missing",
                          fmt::format("write {} = [{}, {}, {}], in {}", corners_key, axes, axes, axes, unit));
        if (corners.size() % 2 != 0)
            table.problem(corners_key, "has a number too many or too few",
                          in_mm ? "give x and y of each corner" : "give m and n of each corner");
        if (!centre.empty()) table.problem(centre_key, "belongs to a circle", "remove it");
        for (std::size_t k = 0; k + 1 < corners.size(); k += 2) {
            zone.corners.push_back({static_cast<float>(corners[k]), static_cast<float>(corners[k + 1])});
        }
    }
    return zone;
}

// The recipe's zones: in lenslets, or all in mm.
void read_zones(TomlTable& root, algo::Recipe& recipe) {
    for (TomlTable& table : root.tables("zone")) {
        algo::Zone zone = read_zone(table, algo::Zone::Unit::lenslets);
        if (zone.unit == algo::Zone::Unit::mm && recipe.lenslet_mm == 0)
            table.problem("shape", "is in mm, and the size of a lenslet is not known", "give [scale] lenslet_mm");
        if (!recipe.zones.empty() && recipe.zones.front().unit != zone.unit) {
            table.problem("shape", "has another unit than the zones before it",
                          "use one unit for all zones: centre, radius, corners in lenslets, or with _mm in mm");
        }
        recipe.zones.push_back(std::move(zone));
    }
}

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

// The middle of the reference's field, where places in mm have their origin, in lenslets.
algo::Point middle_of(const algo::Reference& reference) {
    return {0.5F * static_cast<float>(reference.extents.m - 1), 0.5F * static_cast<float>(reference.extents.n - 1)};
}

algo::Tolerance read_tolerance(TomlTable& table) {
    algo::Tolerance t;
    std::vector<std::string> kinds;
    table.texts("kinds", kinds);
    if (!kinds.empty()) t.kinds = 0;
    for (const std::string& kind : kinds) {
        unsigned k = 0;
        while (k < kDefectKinds && name_of(static_cast<algo::DefectKind>(k)) != kind) ++k;
        if (k < kDefectKinds) t.kinds |= 1U << k;
        else
            table.problem("kinds", "has " + kind + ", which is none",
                          "use scattering, absorbing, surface, scratch, unknown");
    }
    if (!table.has("largest_mm")) table.problem("largest_mm", "is missing", "say how large a defect may be");
    table.number("largest_mm", t.largest_mm, 1e-6, 1e4);
    table.number("deepest_rad", t.deepest_rad, 1e-9, 3);
    table.integer("number", t.number, 1, 10'000);
    if (table.has("shape")) t.where = read_zone(table, algo::Zone::Unit::mm);
    return t;
}

// The tolerances, with places in lenslets where the recipe has a reference and the size of a lenslet.
void read_tolerances(TomlTable& root, algo::Recipe& recipe, bool has_reference) {
    for (TomlTable& table : root.tables("tolerate")) {
        algo::Tolerance tolerance = read_tolerance(table);
        if (!has_reference)
            table.problem("largest_mm", "needs a reference to tell sizes and kinds", "name one in [reference] file");
        if (recipe.lenslet_mm == 0)
            table.problem("largest_mm", "is in mm, and the size of a lenslet is not known", "give [scale] lenslet_mm");
        if (tolerance.deepest_rad > 0 && recipe.bin_rad == 0)
            table.problem("deepest_rad", "is in radians, and the size of a bin is not known", "give [scale] bin_rad");
        if (tolerance.where && recipe.lenslet_mm > 0 && recipe.reference) {
            algo::Zone& zone = *tolerance.where;
            const algo::Point middle = middle_of(*recipe.reference);
            const auto place = [&](algo::Point p) {
                return algo::Point{p.m / recipe.lenslet_mm + middle.m, p.n / recipe.lenslet_mm + middle.n};
            };
            zone.unit = algo::Zone::Unit::lenslets;
            zone.centre = place(zone.centre);
            zone.radius /= recipe.lenslet_mm;
            for (algo::Point& corner : zone.corners) corner = place(corner);
        }
        recipe.tolerances.push_back(std::move(tolerance));
    }
}

// The features that a recipe can name: the gradients, then these two.
constexpr std::string_view kSlopes = name_of(algo::Feature::jacobian_frobenius),
                           kLight = name_of(algo::Feature::transmission);

std::string feature_names() {
    std::string names;
    for (const algo::Feature feature : algo::kJudgedGradients) names += fmt::format("{}, ", name_of(feature));
    return fmt::format("{}{}, {}", names, kSlopes, kLight);
}

// The keys of [limits] for the gradients.
constexpr std::string_view limit_key(algo::Feature gradient) {
    switch (gradient) {
        case algo::Feature::emd: return "emd_bins";
        case algo::Feature::marginal: return "marginal_bins";
        default: return name_of(gradient);
    }
}
constexpr double largest_limit(algo::Feature gradient) { return algo::unit_of(gradient).empty() ? 3 : 30; }

void read_features(TomlTable& root, algo::Recipe& recipe) {
    if (!root.has("features")) return;
    std::vector<std::string> names;
    root.texts("features", names);
    recipe.gradient.reset();
    recipe.slopes = recipe.light = false;
    for (auto name = names.begin(); name != names.end(); ++name) {
        const auto choice = algo::feature_named(*name);
        if (std::find(names.begin(), name, *name) != name) {
            root.problem("features", "has " + *name + " twice", "name it once");
        } else if (!choice) {
            root.problem("features", "has " + *name + ", which is none", "use " + feature_names());
        } else if (*name == kSlopes) {
            recipe.slopes = true;
        } else if (*name == kLight) {
            recipe.light = true;
        } else if (choice->against_reference || !algo::is_judged_gradient(choice->feature)) {
            root.problem("features", "has " + *name + ", by which no part is judged", "use " + feature_names());
        } else if (recipe.gradient) {
            root.problem("features", fmt::format("has {} beside {}", *name, name_of(*recipe.gradient)),
                         "compare neighbours by one distance");
        } else {
            recipe.gradient = choice->feature;
        }
    }
}

// A limit for a feature that is off is a problem. Returns the keys of limits for features that are on and not set.
std::vector<std::string> read_limits(TomlTable& limits, algo::Recipe& recipe, std::uint32_t max_area) {
    std::vector<std::string> unset;
    const auto limit = [&](bool on, std::string_view key, float& value, double low, double high,
                           std::string_view feature) {
        if (!on && limits.has(key))
            limits.problem(key, fmt::format("is a limit of {}, which is not among the features", feature),
                           "remove it, or add that to features");
        limits.number(key, value, low, high);
        if (on && !limits.has(key)) unset.emplace_back(key);
    };
    for (const algo::Feature gradient : algo::kJudgedGradients) {
        const bool on = recipe.gradient == gradient;
        float unused = 1;
        float& value = gradient == algo::Feature::emd ? recipe.emd_limit_bins : on ? recipe.gradient_limit : unused;
        limit(on, limit_key(gradient), value, 1e-3, largest_limit(gradient), name_of(gradient));
        if (on && gradient != algo::Feature::emd && !limits.has(limit_key(gradient))) {
            limits.problem(limit_key(gradient), "is missing", "give a limit: good parts tell which (hordctl tune)");
        }
    }
    limit(recipe.slopes, "frobenius_bins", recipe.frobenius_limit_bins, 1e-3, 30, kSlopes);
    limit(recipe.light, "transmission", recipe.transmission_limit, 0, 0.999, kLight);
    limits.integer("min_area", recipe.min_area, 1, max_area);
    return unset;
}

Result<NumberedRecipe> read(TomlTable root, TomlProblems& found, const std::filesystem::path& folder,
                            std::uint32_t max_area = kMaxArea) {
    NumberedRecipe numbered;
    algo::Recipe& recipe = numbered.recipe;
    int schema = kRecipeSchema;
    root.integer("schema", schema, kRecipeSchema, kRecipeSchema);
    std::string seal;
    root.text("crc32", seal);
    root.name("name", recipe.name);
    root.integer("number", numbered.number, 0, 65534);
    root.integer("version", numbered.version, 1, 0x7FFFFFFF);
    TomlTable light = root.table("light");
    light.integer("dark_dn", recipe.dark_dn, 0, 65535);
    light.integer("min_sum_dn", recipe.min_sum_dn, 0, 0xFFFFFF);
    light.integer("saturated_dn", recipe.saturated_dn, 0, 65535);
    light.number("max_saturated_share", recipe.max_saturated_share, 0, 1);
    light.number("min_lit_share", recipe.min_lit_share, 0, 1);
    light.integer("max_dark_rise_dn", recipe.max_dark_rise_dn, 0, 65535);
    light.number("max_offset_bins", recipe.max_offset_bins, 0, 7);
    light.number("max_spot_bins", recipe.max_spot_bins, 0, 7);
    light.number("max_second_share", recipe.max_second_share, 0, 1);
    if (const auto period = light.choice("period", kChecked)) recipe.check_period = *period == 0;
    TomlTable limits = root.table("limits");
    read_features(root, recipe);
    numbered.unset_limits = read_limits(limits, recipe, max_area);
    if (recipe.dark_dn != 0 && recipe.saturated_dn != 0 && recipe.dark_dn >= recipe.saturated_dn) {
        light.problem("dark_dn", "is not below saturated_dn", "lower it, or raise saturated_dn");
    }
    root.integer("rim_margin", recipe.rim_margin, -1, 1000);
    TomlTable part = root.table("part");
    if (const auto form = part.choice("form", kPartForms)) recipe.form = static_cast<algo::PartForm>(*form);
    if (recipe.form == algo::PartForm::web) recipe.part_required = false;
    if (const auto outline = part.choice("outline", kOutlines)) recipe.symmetric_outline = *outline == 0;
    if (const auto present = part.choice("present", kPartPresence)) recipe.part_required = *present == 0;
    if (recipe.form == algo::PartForm::web && recipe.part_required)
        part.problem("present", "is \"required\", and a web has no outline by which a frame could show it",
                     "write \"unchecked\", or leave it out");
    TomlTable scale = root.table("scale");
    scale.number("lenslet_mm", recipe.lenslet_mm, 1e-6, 1e3);
    scale.number("bin_rad", recipe.bin_rad, 1e-9, 1);
    read_zones(root, recipe);
    TomlTable reference = root.table("reference");
    std::string file;
    reference.text("file", file);
    reference.number("reject_score", recipe.reject_score, 1, 1000);
    reference.number("grow_score", recipe.grow_score, 0.5, 1000);
    reference.number("cluster_score", recipe.cluster_score, 1, 1000);
    reference.number("pooled_score", recipe.pooled_score, 0, 1000);
    if (recipe.grow_score > recipe.reject_score) reference.problem("grow_score", "is above reject_score", "lower it");
    recipe.lacks_reference_file = file.empty() && root.has("reference");
    if (!file.empty()) {
        numbered.reference_file = reference_path(file, folder);
        auto learned = read_reference(numbered.reference_file);
        if (learned) recipe.reference = std::move(*learned);
        else reference.problem("file", "cannot be used: " + learned.error().what, learned.error().cure);
        if (recipe.gradient && *recipe.gradient != algo::Feature::emd) {
            root.problem(
                "features",
                fmt::format("has {}, and a reference knows of good parts' emd alone", name_of(*recipe.gradient)),
                "use emd, or leave the distance out");
        }
    } else if (!recipe.gradient && !recipe.slopes && !(recipe.light && recipe.transmission_limit > 0)) {
        root.problem("features", "leaves nothing to judge parts by",
                     "use " + feature_names() + ", or give a reference");
    }
    read_tolerances(root, recipe, !file.empty());
    root.refuse_unknown_keys();
    const std::string sum = fmt::format("{:08X}", crc32_of(numbered));
    if (found.empty() && !seal.empty() && seal != sum) {
        root.problem(
            "crc32", "is " + seal + ", what the recipe says has " + sum,
            "somebody changed it after it was sealed: check it, then write the new value (hordctl recipe seal)");
    }
    if (!found.empty()) return found.as_error();
    return numbered;
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

Result<algo::Recipe> parse_recipe(std::string_view text, std::string_view name) {
    return parse_numbered_recipe(text, name).map([](NumberedRecipe&& numbered) { return std::move(numbered.recipe); });
}

Result<NumberedRecipe> load_numbered_recipe(const std::filesystem::path& file) {
    if (auto right = common::require_kind(file, common::FileKind::recipe); !right) return tl::unexpected(right.error());
    const auto text = common::read_file(file);
    if (!text) return tl::unexpected(common::cannot_read(file));
    return parse_recipe_file(*text, file);
}

Result<NumberedRecipe> parse_recipe_file(std::string_view text, const std::filesystem::path& file) {
    if (auto fine = common::refuse_blank(text, file); !fine) return tl::unexpected(fine.error());
    TomlProblems found;
    TomlTable root = TomlTable::parse_text(text, file.string(), found);
    if (!text.ends_with('\n')) {
        found.add(fmt::format("{}:{}: the last line has no line end, so the file may have lost its end", file.string(),
                              1 + std::ranges::count(text, '\n')),
                  "end it with a line end, or copy the file again");
    }
    if (!found.empty()) return found.as_error();
    if (!root.has("schema"))
        root.problem("schema", "is missing", fmt::format("write schema = {} above the first section", kRecipeSchema));
    return read(std::move(root), found, std::filesystem::absolute(file).parent_path());
}

std::vector<std::string> notes(const NumberedRecipe& numbered) {
    std::vector<std::string> messages = algo::notes(numbered.recipe);
    if (!numbered.unset_limits.empty()) {
        std::string counts;
        for (const std::string& key : numbered.unset_limits) {
            const algo::Recipe& r = numbered.recipe;
            const float value = key == kLight ? r.transmission_limit
                : key == "frobenius_bins"     ? r.frobenius_limit_bins
                                              : r.emd_limit_bins;
            counts += fmt::format("{}{} = {}", counts.empty() ? "" : ", ", key, value);
        }
        messages.push_back(
            fmt::format("[limits] does not set {}: the defaults count ({}); a file that lost its end "
                        "looks like this: set them, or compare it with its original",
                        fmt::join(numbered.unset_limits, ", "), counts));
    }
    if (const std::string& name = numbered.recipe.name; name.size() > common::kNameBytes) {
        messages.push_back(fmt::format("name has {} bytes, and registers hold {} of them (\"{}\"): shorten it",
                                       name.size(), common::kNameBytes, common::utf8_prefix(name, common::kNameBytes)));
    }
    return messages;
}

std::filesystem::path reference_path(const std::filesystem::path& named, const std::filesystem::path& folder) {
    return named.is_absolute() || folder.empty() ? named : folder / named;
}

Result<NumberedRecipe> recipe_or_default(const std::filesystem::path& file) {
    return file.empty() ? NumberedRecipe{} : load_numbered_recipe(file);
}

Result<NumberedRecipe> parse_numbered_recipe(std::string_view text, std::string_view name, std::uint32_t max_area,
                                             const std::filesystem::path& folder) {
    TomlProblems found;
    TomlTable root = TomlTable::parse_text(text, name, found);
    if (!found.empty()) return found.as_error();
    return read(std::move(root), found, folder, max_area);
}

}  // namespace hord::firmware
