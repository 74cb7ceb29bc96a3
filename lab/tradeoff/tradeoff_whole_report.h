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
};
// The fastest recipe that, in every seed, rejects at most one good part more than the least and misses at most one bad
// part more than the least. Null where there is none.
const WholeRecipe* advised(const std::vector<WholeRecipe>& recipes);

}  // namespace hord::lab
