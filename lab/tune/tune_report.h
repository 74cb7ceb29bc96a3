// The result of tuning as tables, text, JSON and plot, and the recipe of the chosen feature set.
#pragma once

#include <filesystem>
#include <string>

#include <nlohmann/json.hpp>

#include "lab/report/tables.h"
#include "lab/tune/tune.h"

namespace hord::lab {

// One row a feature set, from the fastest to the slowest.
Table table_of(const Tuned& tuned);
// The same with every number that was measured.
Table numbers_of(const Tuned& tuned);
nlohmann::ordered_json to_json(const Tuned& tuned);

// docs/results/templates/tune.md, filled: what was measured, how certain it is, which set was chosen and why. One
// sentence a line.
std::string describe(const Tuned& tuned);

// The recipe of the chosen set, with describe() as comments. `made`: one line, such as the date and the folders.
std::string recipe_text(const Tuned& tuned, const std::string& made);

// Writes the recipe of the chosen set to `out` (RECIPE.toml), and its measurements beside it: RECIPE.tune.md and .csv,
// and the plot if gnuplot works. A reference beside the recipe is named without its folder, so that both can be
// moved. Returns the files. Fails with io.
Result<std::vector<std::filesystem::path>> write_report(Tuned& tuned, const std::filesystem::path& out,
                                                        const std::string& made);

// Plots detection against time: every set, the Pareto front, the budget and the chosen set. Fails as plot().
Result<std::vector<std::filesystem::path>> plot_tuned(const Tuned& tuned, const std::filesystem::path& folder,
                                                      const std::string& name);

}  // namespace hord::lab
