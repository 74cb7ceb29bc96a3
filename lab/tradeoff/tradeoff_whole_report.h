// The tables of the trade on whole parts (tradeoff_whole.h).
#pragma once

#include <filesystem>
#include <string>

#include "lab/report/template.h"
#include "lab/tradeoff/tradeoff_whole.h"

namespace hord::lab {

// The fields whole_advice, whole_tables and arm64 of docs/results/templates/whole.md. `instructions`: the file of
// count_instructions.sh; without it arm64 is empty.
void add_wholes(TemplateFields& fields, const std::vector<JudgedWhole>& judged,
                const std::filesystem::path& instructions);

// Of one recipe at one number of lenslets: what each seed found.
struct WholeSeed {
    int good = 0, rejected = 0, bad = 0, missed = 0;
    double mean_ms = 0;
};
struct WholeRecipe {
    std::string name;
    std::vector<WholeSeed> seeds;
    double arm64_instructions = 0;  // of a verdict; 0: not counted
};
// The recipe to take: of those that, in every seed, reject at most one good part more than the least and miss at most
// one bad part more than the least, the fastest. Of several whose times differ by less than kSameTime, the one that
// misses least, then the fastest. Null where there is none, or where the times of the seeds, or the instructions on
// arm64 (of those counted), would choose different ones.
const WholeRecipe* advised(const std::vector<WholeRecipe>& recipes);
constexpr double kSameTime = 0.1;  // relative: times of equal work vary so

}  // namespace hord::lab
