// Reads a recipe's file. It is written in recipe_format.cpp.
#include "firmware/recipes/recipe_file.h"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "common/file_kind.h"
#include "common/file_writing.h"
#include "common/name_bytes.h"
#include "common/toml_fields.h"
#include "common/utf8.h"
#include "firmware/recipes/recipe_words.h"
#include "firmware/recipes/reference_file.h"

namespace hord::firmware {
namespace {

using common::TomlProblems;
using common::TomlTable;

constexpr double kFar = 100'000;  // lenslets; larger than any light field

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

std::string feature_names() {
    std::string names;
    for (const algo::Feature feature : algo::kJudgedGradients) names += fmt::format("{}, ", name_of(feature));
    return fmt::format("{}{}, {}", names, kSlopes, kLight);
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

}  // namespace

Result<algo::Recipe> parse_recipe(std::string_view text, std::string_view name) {
    return parse_numbered_recipe(text, name).map([](NumberedRecipe&& numbered) { return std::move(numbered.recipe); });
}

Result<NumberedRecipe> load_numbered_recipe(const std::filesystem::path& file) {
    if (auto right = common::require_kind(file, common::FileKind::recipe); !right) return tl::unexpected(right.error());
    const auto text = common::read_file(file, common::kMaxText);
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
