#include "firmware/recipe_file.h"

#include <array>

#include <fmt/format.h>

#include "common/crc32.h"
#include "common/toml_fields.h"

namespace hord::firmware {
namespace {

using common::TomlProblems;
using common::TomlTable;

constexpr int kRecipeSchema = 1;
constexpr double kFar = 100'000;  // lenslets; beyond any light field

algo::Zone read_zone(TomlTable& table) {
    constexpr std::array<std::string_view, 2> shapes{"circle", "polygon"};
    constexpr std::array<std::string_view, 2> uses{"inspect", "ignore"};
    algo::Zone zone;
    if (!table.has("shape")) table.problem("shape", "is missing", "use circle or polygon");
    const auto shape = table.choice("shape", shapes);
    if (const auto use = table.choice("use", uses)) zone.use = static_cast<algo::Zone::Use>(*use);
    std::vector<double> centre, corners;
    table.numbers("centre", centre, 2, 2);
    table.number("radius", zone.radius, 0.5, kFar);
    table.numbers("corners", corners, 6, 2000);
    if (!shape) return zone;
    zone.shape = static_cast<algo::Zone::Shape>(*shape);
    if (zone.shape == algo::Zone::Shape::circle) {
        if (centre.empty()) table.problem("centre", "is missing", "write centre = [m, n], in lenslets");
        if (!table.has("radius")) table.problem("radius", "is missing", "give it in lenslets");
        if (!corners.empty()) table.problem("corners", "belongs to a polygon", "remove it");
        if (centre.size() == 2) zone.centre = {static_cast<float>(centre[0]), static_cast<float>(centre[1])};
    } else {
        if (!table.has("corners")) table.problem("corners", "is missing", "write corners = [m, n, m, n, m, n], in lenslets");
        if (corners.size() % 2 != 0) table.problem("corners", "has a number too many or too few", "give m and n of each corner");
        if (!centre.empty()) table.problem("centre", "belongs to a circle", "remove it");
        for (std::size_t k = 0; k + 1 < corners.size(); k += 2) {
            zone.corners.push_back({static_cast<float>(corners[k]), static_cast<float>(corners[k + 1])});
        }
    }
    return zone;
}

// A text in quotes, as TOML's basic strings have it.
std::string in_quotes(std::string_view text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') (out += '\\') += c;
        else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) out += fmt::format("\\u{:04X}", static_cast<int>(c));
        else out += c;
    }
    return out + '"';
}

Result<NumberedRecipe> read(TomlTable root, TomlProblems& found) {
    NumberedRecipe numbered;
    algo::Recipe& recipe = numbered.recipe;
    int schema = kRecipeSchema;
    root.integer("schema", schema, kRecipeSchema, kRecipeSchema);
    std::string seal;
    root.text("crc32", seal);
    root.text("name", recipe.name);
    root.integer("number", numbered.number, 0, 65534);
    root.integer("version", numbered.version, 1, 0x7FFFFFFF);
    TomlTable light = root.table("light");
    light.integer("dark_dn", recipe.dark_dn, 0, 65535);
    light.integer("min_sum_dn", recipe.min_sum_dn, 0, 0xFFFFFF);
    light.integer("saturated_dn", recipe.saturated_dn, 0, 65535);
    light.number("max_saturated_share", recipe.max_saturated_share, 0, 1);
    light.number("min_lit_share", recipe.min_lit_share, 0, 1);
    TomlTable limits = root.table("limits");
    limits.number("emd_bins", recipe.emd_limit_bins, 1e-3, 30);
    limits.number("frobenius_bins", recipe.frobenius_limit_bins, 1e-3, 30);
    limits.number("transmission", recipe.transmission_limit, 0, 0.999);
    limits.integer("min_area", recipe.min_area, 1, 1'000'000);
    if (recipe.dark_dn != 0 && recipe.saturated_dn != 0 && recipe.dark_dn >= recipe.saturated_dn) {
        light.problem("dark_dn", "is not below saturated_dn", "lower it, or raise saturated_dn");
    }
    root.integer("rim_margin", recipe.rim_margin, -1, 1000);
    for (TomlTable& zone : root.tables("zone")) recipe.zones.push_back(read_zone(zone));
    root.refuse_unknown_keys();
    const std::string sum = fmt::format("{:08X}", crc32_of(numbered));
    if (found.empty() && !seal.empty() && seal != sum) {
        root.problem("crc32", "is " + seal + ", what the recipe says has " + sum,
                     "somebody changed it after it was sealed: check it, then write the new value (hordctl recipe seal)");
    }
    if (!found.empty()) return found.as_error();
    return numbered;
}

Result<algo::Recipe> without_number(Result<NumberedRecipe> numbered) {
    if (!numbered) return tl::unexpected(numbered.error());
    return std::move(numbered->recipe);
}

}  // namespace

std::string format_recipe(const NumberedRecipe& numbered) {
    const algo::Recipe& r = numbered.recipe;
    std::string text = fmt::format("schema = {}\nname = {}\nnumber = {}\nversion = {}\nrim_margin = {}\n\n", kRecipeSchema, in_quotes(r.name),
                                   numbered.number, numbered.version, r.rim_margin);
    text += fmt::format("[light]\ndark_dn = {}\nmin_sum_dn = {}\nsaturated_dn = {}\nmax_saturated_share = {}\nmin_lit_share = {}\n\n", r.dark_dn,
                        r.min_sum_dn, r.saturated_dn, r.max_saturated_share, r.min_lit_share);
    text += fmt::format("[limits]\nemd_bins = {}\nfrobenius_bins = {}\ntransmission = {}\nmin_area = {}\n", r.emd_limit_bins,
                        r.frobenius_limit_bins, r.transmission_limit, r.min_area);
    for (const algo::Zone& zone : r.zones) {
        text += fmt::format("\n[[zone]]\nuse = \"{}\"\n", zone.use == algo::Zone::Use::inspect ? "inspect" : "ignore");
        if (zone.shape == algo::Zone::Shape::circle) {
            text += fmt::format("shape = \"circle\"\ncentre = [{}, {}]\nradius = {}\n", zone.centre.m, zone.centre.n, zone.radius);
            continue;
        }
        text += "shape = \"polygon\"\ncorners = [";
        for (std::size_t k = 0; k < zone.corners.size(); ++k) {
            text += fmt::format("{}{}, {}", k == 0 ? "" : ", ", zone.corners[k].m, zone.corners[k].n);
        }
        text += "]\n";
    }
    return text;
}

std::uint32_t crc32_of(const NumberedRecipe& recipe) { return common::crc32(format_recipe(recipe)); }

Result<algo::Recipe> load_recipe(const std::filesystem::path& file) { return without_number(load_numbered_recipe(file)); }
Result<algo::Recipe> parse_recipe(std::string_view text, std::string_view name) { return without_number(parse_numbered_recipe(text, name)); }

Result<NumberedRecipe> load_numbered_recipe(const std::filesystem::path& file) {
    TomlProblems found;
    TomlTable root = TomlTable::parse_file(file, found);
    if (!found.empty()) return found.as_error();
    return read(std::move(root), found);
}

Result<NumberedRecipe> parse_numbered_recipe(std::string_view text, std::string_view name) {
    TomlProblems found;
    TomlTable root = TomlTable::parse_text(text, name, found);
    if (!found.empty()) return found.as_error();
    return read(std::move(root), found);
}

}  // namespace hord::firmware
