#include "firmware/recipe_file.h"

#include <array>

#include "common/toml_fields.h"

namespace hord::firmware {
namespace {

using common::TomlProblems;
using common::TomlTable;

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

Result<algo::Recipe> read(TomlTable root, TomlProblems& found) {
    algo::Recipe recipe;
    root.text("name", recipe.name);
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
    root.integer("rim_margin", recipe.rim_margin, -1, 1000);
    for (TomlTable& zone : root.tables("zone")) recipe.zones.push_back(read_zone(zone));
    root.refuse_unknown_keys();
    if (!found.empty()) return found.as_error();
    return recipe;
}

}  // namespace

Result<algo::Recipe> load_recipe(const std::filesystem::path& file) {
    TomlProblems found;
    TomlTable root = TomlTable::parse_file(file, found);
    if (!found.empty()) return found.as_error();
    return read(std::move(root), found);
}

Result<algo::Recipe> parse_recipe(std::string_view text, std::string_view name) {
    TomlProblems found;
    TomlTable root = TomlTable::parse_text(text, name, found);
    if (!found.empty()) return found.as_error();
    return read(std::move(root), found);
}

}  // namespace hord::firmware
