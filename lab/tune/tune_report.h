// What tuning found, for people and programs; and the recipe that it leads to.
#pragma once

#include <filesystem>
#include <string>

#include <nlohmann/json.hpp>

#include "lab/report/tables.h"
#include "lab/tune/tune.h"

namespace hord::lab {

// A rung a row, from the fastest to the slowest.
Table table_of(const Tuned& tuned);
// The same with every number that was measured.
Table numbers_of(const Tuned& tuned);
nlohmann::ordered_json to_json(const Tuned& tuned);

// What was measured, on what, how sure that is, which rung was chosen and why: a sentence a line.
std::string describe(const Tuned& tuned);

// The recipe of the chosen rung, with how it came about. `made`: one line, say, on what date and from which folders.
std::string recipe_text(const Tuned& tuned, const std::string& made);

// Detection against time: every rung, those that nothing beats in both, the budget, and the chosen one. Fails as plot()
// does.
Result<std::vector<std::filesystem::path>> plot_tuned(const Tuned& tuned, const std::filesystem::path& folder,
                                                      const std::string& name);

}  // namespace hord::lab
