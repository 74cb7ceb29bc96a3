#include "lab/tradeoff/tradeoff_whole_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <functional>
#include <map>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "algo/good_parts/false_rejects.h"
#include "lab/report/statistics.h"
#include "lab/report/tables.h"

namespace hord::lab {
namespace {

// Of a Pi 5: four Cortex-A76 at 2.4 GHz. Instructions a cycle: a range, since none was measured.
constexpr double kArmHertz = 2.4e9, kMinACycle = 1, kMaxACycle = 2;

double sum_of(const std::vector<double>& values) { return std::accumulate(values.begin(), values.end(), 0.0); }

// One number for all seeds, in brackets that of each.
std::string by_seed(int all, const std::vector<int>& seeds) {
    if (seeds.size() == 1) return std::to_string(all);
    std::string text;
    for (const int one : seeds) text += (text.empty() ? "" : ", ") + std::to_string(one);
    return fmt::format("{} ({})", all, text);
}

// What all seeds of a recipe and a number of lenslets found.
struct Pooled {
    WholeRecipe recipe;
    std::vector<double> ms;
    struct Kind {
        std::vector<DetectionTrial> trials;
        std::vector<int> missed;  // by seed
        int tried = 0;
    };
    std::map<std::string, Kind> kinds;

    void add(const Json& found) {
        WholeSeed seed{found["good"].get<int>(), found["rejected"].get<int>(), 0, 0, 0};
        const auto times = found["ms"].get<std::vector<double>>();
        seed.mean_ms = sum_of(times) / static_cast<double>(times.size());
        ms.insert(ms.end(), times.begin(), times.end());
        for (const WholeLadder& ladder : kWholeLadders) {
            const std::string name(WantedDefect{ladder.kind, 0}.name());
            Kind& kind = kinds[name];
            int missed = 0;
            for (const Json& row : found[name]) {
                const int tried = row[2].get<int>();
                for (int k = 0; k < tried; ++k) kind.trials.push_back({row[0].get<double>(), k >= row[1].get<int>()});
                missed += row[1].get<int>(), kind.tried += tried, seed.bad += tried;
            }
            kind.missed.push_back(missed);
            seed.missed += missed;
        }
        recipe.seeds.push_back(seed);
    }
    [[nodiscard]] double mean_ms() const { return sum_of(ms) / static_cast<double>(ms.size()); }
};

std::map<int, std::vector<Pooled>> pool(const std::vector<JudgedWhole>& judged) {
    std::map<int, std::vector<Pooled>> by_lenslets;
    for (const JudgedWhole& cell : judged) {
        auto& recipes = by_lenslets[cell.point.lenslets];
        for (const auto& [name, found] : cell.values.items()) {
            auto at = std::ranges::find(recipes, name, [](const Pooled& p) { return p.recipe.name; });
            if (at == recipes.end()) {
                recipes.emplace_back().recipe.name = name;
                at = recipes.end() - 1;
            }
            at->add(found);
        }
    }
    return by_lenslets;
}

Table table_of(const std::vector<Pooled>& recipes) {
    Table table{{"judged by", "good parts rejected", "bad parts missed"}, {}};
    for (const WholeLadder& ladder : kWholeLadders)
        table.header.push_back(std::string(WantedDefect{ladder.kind, 0}.name()) + ": missed; a90, mm");
    for (const char* more : {"parts a minute a core", "mean, ms", "p99, ms"}) table.header.emplace_back(more);
    for (const Pooled& p : recipes) {
        int good = 0, rejected = 0, bad = 0, missed = 0;
        std::vector<int> rejected_by, missed_by;
        for (const WholeSeed& seed : p.recipe.seeds) {
            good += seed.good, rejected += seed.rejected, bad += seed.bad, missed += seed.missed;
            rejected_by.push_back(seed.rejected), missed_by.push_back(seed.missed);
        }
        std::vector<std::string> row{
            p.recipe.name,
            fmt::format("{} of {}, at most {:.0f} %", by_seed(rejected, rejected_by), good,
                        100 * algo::most_rejected(static_cast<std::size_t>(rejected), static_cast<std::size_t>(good))),
            fmt::format("{} of {}", by_seed(missed, missed_by), bad)};
        for (const WholeLadder& ladder : kWholeLadders) {
            const Pooled::Kind& kind = p.kinds.at(std::string(WantedDefect{ladder.kind, 0}.name()));
            const auto a90 = pod_curve(kind.trials).a90;
            const double smallest = ladder.sizes_mm.front(), largest = ladder.sizes_mm.back();
            const bool all_found = std::ranges::all_of(kind.trials, &DetectionTrial::found);
            const std::string size = all_found ? fmt::format("<= {:g}", smallest)
                : a90 && *a90 <= largest       ? fmt::format("{:.2g}", *a90)
                                               : fmt::format("> {:g}", largest);
            row.push_back(fmt::format(
                "{}; {}", by_seed(std::accumulate(kind.missed.begin(), kind.missed.end(), 0), kind.missed), size));
        }
        row.push_back(fmt::format("{:.0f}", 60e3 / p.mean_ms()));
        row.push_back(fmt::format("{:.2f}", p.mean_ms()));
        row.push_back(fmt::format("{:.2f}", quantile(p.ms, 0.99)));
        table.rows.push_back(std::move(row));
    }
    return table;
}

// Instructions of a recipe's verdict on a good and a bad part at kCountedLenslets.
struct Counted {
    std::string name;
    double good = 0, bad = 0;
    [[nodiscard]] double most() const { return std::max(good, bad); }
};
// Empty without the file.
std::vector<Counted> read_instructions(const std::filesystem::path& file) {
    std::ifstream stream(file);
    std::vector<Counted> all;
    for (std::string line; std::getline(stream, line);) {  // frame;instructions;recipe
        const auto first = line.find(';'), second = line.find(';', first + 1);
        if (second == std::string::npos) continue;
        const std::string name = line.substr(second + 1);
        auto at = std::ranges::find(all, name, &Counted::name);
        if (at == all.end()) at = all.insert(all.end(), Counted{name});
        (line.starts_with("good") ? at->good : at->bad) = std::stod(line.substr(first + 1, second - first - 1));
    }
    return all;
}

std::string arm64_text(const std::vector<Counted>& counted) {
    if (counted.empty()) return {};
    Table table{{"judged by", "instructions, million: good part", "bad part"}, {}};
    constexpr std::array kSizes = {111, 222, 555};
    for (const int lenslets : kSizes) table.header.push_back(fmt::format("{0}x{0}: ms a part", lenslets));
    table.header.emplace_back("555x555: parts a minute a core");
    for (const Counted& of : counted) {
        std::vector<std::string> row{of.name, fmt::format("{:.1f}", 1e-6 * of.good),
                                     fmt::format("{:.1f}", 1e-6 * of.bad)};
        const auto ms = [&](int lenslets, double a_cycle) {
            const double more = std::pow(static_cast<double>(lenslets) / kCountedLenslets, 2);
            return 1e3 * more * of.most() / a_cycle / kArmHertz;
        };
        const auto text = [](double v) { return v < 9.95 ? fmt::format("{:.1f}", v) : fmt::format("{:.0f}", v); };
        for (const int lenslets : kSizes)
            row.push_back(text(ms(lenslets, kMaxACycle)) + " to " + text(ms(lenslets, kMinACycle)));
        row.push_back(fmt::format("{:.0f} to {:.0f}", 60e3 / ms(555, kMinACycle), 60e3 / ms(555, kMaxACycle)));
        table.rows.push_back(std::move(row));
    }
    return to_markdown(table);
}

template <class Cost>
const WholeRecipe* choose(const std::vector<const WholeRecipe*>& recipes, const Cost& cost) {
    const auto missed = [](const WholeRecipe& recipe) {
        int all = 0;
        for (const WholeSeed& seed : recipe.seeds) all += seed.missed;
        return all;
    };
    double least = cost(*recipes.front());
    for (const WholeRecipe* recipe : recipes) least = std::min(least, cost(*recipe));
    const WholeRecipe* best = nullptr;
    for (const WholeRecipe* recipe : recipes) {
        if (cost(*recipe) > (1 + kSameTime) * least) continue;
        if (best == nullptr || std::pair(missed(*recipe), cost(*recipe)) < std::pair(missed(*best), cost(*best)))
            best = recipe;
    }
    return best;
}

}  // namespace

const WholeRecipe* advised(const std::vector<WholeRecipe>& recipes) {
    std::vector<const WholeRecipe*> good, counted;
    for (const WholeRecipe& recipe : recipes) {
        bool is_good = true;
        for (std::size_t s = 0; s < recipe.seeds.size(); ++s) {
            int rejected = recipe.seeds[s].rejected, missed = recipe.seeds[s].missed;  // the least of all recipes
            for (const WholeRecipe& other : recipes)
                rejected = std::min(rejected, other.seeds[s].rejected),
                missed = std::min(missed, other.seeds[s].missed);
            is_good = is_good && recipe.seeds[s].rejected <= rejected + 1 && recipe.seeds[s].missed <= missed + 1;
        }
        if (!is_good) continue;
        good.push_back(&recipe);
        if (recipe.arm64_instructions > 0) counted.push_back(&recipe);
    }
    if (good.empty()) return nullptr;
    const WholeRecipe* best = choose(good, [](const WholeRecipe& r) { return r.seeds.front().mean_ms; });
    for (std::size_t s = 1; s < best->seeds.size(); ++s) {
        if (choose(good, [s](const WholeRecipe& r) { return r.seeds[s].mean_ms; }) != best) return nullptr;
    }
    if (best->arm64_instructions > 0 && choose(counted, std::mem_fn(&WholeRecipe::arm64_instructions)) != best)
        return nullptr;
    return best;
}

void add_wholes(TemplateFields& fields, const std::vector<JudgedWhole>& judged,
                const std::filesystem::path& instructions) {
    std::string advice, tables;
    const std::vector<Counted> counted = read_instructions(instructions);
    for (const auto& [lenslets, pooled] : pool(judged)) {
        std::vector<WholeRecipe> recipes;
        for (const Pooled& p : pooled) {
            recipes.push_back(p.recipe);
            const auto at = std::ranges::find(counted, p.recipe.name, &Counted::name);
            if (at != counted.end()) recipes.back().arm64_instructions = at->most();
        }
        const WholeRecipe* best = advised(recipes);
        if (const std::size_t seeds = recipes.front().seeds.size(); seeds < kWholeSeeds) {
            advice += fmt::format("- **{0}x{0} lenslets: no advice yet**: {1} of {2} seeds were judged.\n", lenslets,
                                  seeds, kWholeSeeds);
        } else if (best == nullptr) {
            advice += fmt::format(
                "- **{0}x{0} lenslets: no advice.** No recipe is the best in every seed and on every machine.\n",
                lenslets);
        } else {
            const Pooled& p = *std::ranges::find(pooled, best->name, [](const Pooled& q) { return q.recipe.name; });
            advice +=
                fmt::format("- **{0}x{0} lenslets: judge by {1}.** {2:.0f} parts a minute and core, p99 {3:.2g} ms.\n",
                            lenslets, best->name, 60e3 / p.mean_ms(), quantile(p.ms, 0.99));
        }
        tables += fmt::format("{}### {}x{} lenslets\n\n", tables.empty() ? "" : "\n", lenslets, lenslets) +
            to_markdown(table_of(pooled));
    }
    std::string ladders;
    for (const WholeLadder& ladder : kWholeLadders)
        ladders += fmt::format("{}{} {}", ladders.empty() ? "" : "; ", WantedDefect{ladder.kind, 0}.name(),
                               fmt::join(ladder.sizes_mm, ", "));
    std::vector<std::uint64_t> seeds;
    for (const JudgedWhole& cell : judged) {
        if (std::ranges::find(seeds, cell.point.seed) == seeds.end()) seeds.push_back(cell.point.seed);
    }
    fields["same_time"] = fmt::format("{:g}", 100 * kSameTime);
    fields["poses"] = std::to_string(WholeEffort{}.poses);
    fields["seeds"] = fmt::format("{} {}", seeds.size() == 1 ? "seed" : "seeds", fmt::join(seeds, ", "));
    fields["counted"] = std::to_string(kCountedLenslets);
    fields["ladders"] = ladders;
    fields["whole_advice"] = advice;
    fields["whole_tables"] = tables;
    fields["arm64"] = arm64_text(counted);
}

}  // namespace hord::lab
