// A recipe as TOML. deploy/recipes/default.toml documents every key.
#pragma once

#include <filesystem>
#include <string_view>

#include "algo/recipe.h"
#include "algo/result.h"

namespace hord::firmware {

// Fails with invalid_argument; every problem of the file at once, a line each with line number and cure. Whether the
// zones lie on the light field is known only with its extents: algo::problems(recipe, extents).
Result<algo::Recipe> load_recipe(const std::filesystem::path& file);
Result<algo::Recipe> parse_recipe(std::string_view text, std::string_view name);

}  // namespace hord::firmware
