#include "lab/kinds/kinds.h"

#include <algorithm>
#include <map>
#include <set>

#include <fmt/format.h>

#include "algo/recipe/recipe.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/experiment/result_cache.h"
#include "lab/kinds/kind_contrast.h"
#include "lab/report/statistics.h"
#include "lab/report/tables.h"
#include "lab/report/template.h"

namespace hord::lab {
namespace {

constexpr std::uint64_t kSeeds = 12, kSeedsQuick = 2;

// Every part of one kind.
struct Kind {
    sim::PartClass made_as;
    std::vector<SeenPart> parts;

    [[nodiscard]] std::size_t rejected() const {
        return static_cast<std::size_t>(
            std::ranges::count(parts, algo::Verdict::reject, [](const SeenPart& part) { return part.verdict; }));
    }
    [[nodiscard]] std::size_t seen_by(LineView view) const {
        return static_cast<std::size_t>(std::ranges::count_if(
            parts, [&](const SeenPart& part) { return part.contrast[static_cast<std::size_t>(view)] >= kVisible; }));
    }
    [[nodiscard]] std::vector<double> contrasts(LineView view) const {
        std::vector<double> all;
        for (const SeenPart& part : parts) all.push_back(part.contrast[static_cast<std::size_t>(view)]);
        std::ranges::sort(all);
        return all;
    }
};

bool is_of_hords(algo::Reason reason) {
    return reason == algo::Reason::neighbours_disagree || reason == algo::Reason::deflection_gradient;
}

// "12 of 12; 14 (9.1 to 21)": seen in how many parts; median, smallest and largest contrast.
std::string describe_contrasts(const Kind& kind, LineView view) {
    const auto all = kind.contrasts(view);
    return fmt::format("{} of {}; {:.2g} ({:.2g} to {:.2g})", kind.seen_by(view), all.size(), all[all.size() / 2],
                       all.front(), all.back());
}

std::string describe_reasons(const Kind& kind) {
    std::map<algo::Reason, int> counts;
    for (const SeenPart& part : kind.parts) ++counts[part.reason];
    std::string text;
    for (const auto& [reason, count] : counts) {
        if (reason != algo::Reason::none)
            text += fmt::format("{}{} {}", text.empty() ? "" : ", ", name_of(reason), count);
    }
    return text.empty() ? "-" : text;
}

Table table_of(const std::vector<Kind>& kinds) {
    Table table{{"kind", "rejected", "reasons"}, {}};
    table.header.insert(table.header.end(), kLineViewNames.begin(), kLineViewNames.end());
    for (const Kind& kind : kinds) {
        std::vector<std::string> row{std::string(name_of(kind.made_as)),
                                     fmt::format("{} of {}", kind.rejected(), kind.parts.size()),
                                     describe_reasons(kind)};
        for (std::size_t view = 0; view < kLineViewNames.size(); ++view) {
            row.push_back(kind.made_as == sim::PartClass::good ? "-"
                                                               : describe_contrasts(kind, static_cast<LineView>(view)));
        }
        table.rows.push_back(std::move(row));
    }
    return table;
}

std::vector<Claim> claims_of(const std::vector<Kind>& kinds) {
    std::size_t good = 0, passed = 0, takers = 0, takers_rejected = 0, clear_kinds = 0, rejected_by_hords = 0;
    std::size_t seen_telecentric = 0, deflectors = 0, seen_transmission = 0;
    double missing = 0, missing_at_deflectors = 0;
    std::set<algo::Reason> reasons;
    for (const Kind& kind : kinds) {
        const std::size_t count = kind.parts.size();
        if (kind.made_as == sim::PartClass::good) {
            good += count, passed += count - kind.rejected();
            continue;
        }
        for (const SeenPart& part : kind.parts) reasons.insert(part.reason);
        const bool deflects = std::ranges::find(sim::kDeflectors, kind.made_as) != sim::kDeflectors.end();
        if (!deflects && kind.made_as != sim::PartClass::haze) {
            takers += count, takers_rejected += kind.rejected();
            continue;
        }
        clear_kinds += count;
        seen_telecentric += kind.seen_by(LineView::telecentric);
        if (deflects) deflectors += count, seen_transmission += kind.seen_by(LineView::transmission);
        for (const SeenPart& part : kind.parts) {
            missing = std::max(missing, part.missing_light);
            if (deflects) missing_at_deflectors = std::max(missing_at_deflectors, part.missing_light);
        }
        rejected_by_hords += static_cast<std::size_t>(std::ranges::count_if(kind.parts, [](const SeenPart& part) {
            return part.verdict == algo::Verdict::reject && is_of_hords(part.reason);
        }));
    }
    reasons.erase(algo::Reason::none);
    const double rejecting = 1 - static_cast<double>(algo::Recipe{}.transmission_limit);
    std::string list;
    for (const algo::Reason reason : reasons) list += (list.empty() ? "" : ", ") + std::string(name_of(reason));
    return {
        {"The default recipe passes every good part", passed == good, fmt::format("{} of {}", passed, good)},
        {"It rejects every bubble, cut, speck and scratch", takers_rejected == takers,
         fmt::format("{} of {}", takers_rejected, takers)},
        {"It rejects every dimple, stria, inclusion and haze, because neighbours disagree or the deflection changes "
         "too fast",
         rejected_by_hords == clear_kinds, fmt::format("{} of {}", rejected_by_hords, clear_kinds)},
        {"The telecentric camera sees none of these four kinds", seen_telecentric == 0,
         fmt::format("it sees {} of {}", seen_telecentric, clear_kinds)},
        {"The transmission shows no dimple, stria or inclusion", seen_transmission == 0,
         fmt::format("it shows {} of {}", seen_transmission, deflectors)},
        {"At each of them it misses less than half of what rejects a part", missing_at_deflectors < 0.5 * rejecting,
         fmt::format("at most {:.0f} % of the light; {:.0f} % rejects", 100 * missing_at_deflectors, 100 * rejecting)},
        {"The transmission alone would pass all four kinds", missing < rejecting,
         fmt::format("it misses at most {:.0f} % of the light; {:.0f} % rejects", 100 * missing, 100 * rejecting)},
        {"Parts are rejected for at least three reasons", reasons.size() >= 3, list},
    };
}

Json to_json(const SeenPart& part) {
    return {{"kind", name_of(part.made_as)},           {"verdict", static_cast<int>(part.verdict)},
            {"reason", static_cast<int>(part.reason)}, {"score", part.score},
            {"missing", part.missing_light},           {"contrast", part.contrast}};
}
SeenPart part_of(const Json& json, sim::PartClass made_as) {
    SeenPart part{.made_as = made_as,
                  .verdict = static_cast<algo::Verdict>(json["verdict"].get<int>()),
                  .reason = static_cast<algo::Reason>(json["reason"].get<int>()),
                  .score = json["score"].get<float>(),
                  .missing_light = json["missing"].get<double>()};
    for (std::size_t view = 0; view < part.contrast.size(); ++view)
        part.contrast[view] = json["contrast"][view].get<double>();
    return part;
}

}  // namespace

Result<ExperimentReport> run_kinds(const ExperimentOptions& options) {
    auto cells =
        ResultCache::open(options.out / "cells.jsonl", {{"experiment", "kinds"}, {"seed", options.seed}, {"form", 3}});
    if (!cells) return tl::unexpected(cells.error());
    const std::vector<sim::PartClass> defects{sim::kAllDefects.begin(), sim::kAllDefects.end()};
    std::vector<Kind> kinds{{sim::PartClass::good, {}}};
    for (const sim::PartClass made_as : defects) kinds.push_back({made_as, {}});

    const std::uint64_t seeds = options.quick ? kSeedsQuick : kSeeds;
    for (std::uint64_t k = 0; k < seeds; ++k) {
        const std::uint64_t seed = options.seed + k;
        options.progress(static_cast<double>(k) / static_cast<double>(seeds), fmt::format("seed {}", seed));
        const auto cell = cells->value(fmt::format("seed {}", seed), [&]() -> Result<Json> {
            const auto parts = see_parts(defects, seed, options.threads);
            if (!parts) return tl::unexpected(parts.error());
            Json all = Json::array();
            for (const SeenPart& part : *parts) all.push_back(to_json(part));
            return all;
        });
        if (!cell) return tl::unexpected(cell.error());
        for (std::size_t kind = 0; kind < kinds.size(); ++kind)
            kinds[kind].parts.push_back(part_of((*cell)[kind], kinds[kind].made_as));
    }
    options.progress(1, "");

    ExperimentReport report;
    report.claims = claims_of(kinds);
    const Table table = table_of(kinds);
    if (auto written = write_csv(options.out / "kinds.csv", table); !written) return tl::unexpected(written.error());
    report.files.push_back(options.out / "kinds.csv");
    report.text = fill_report("kinds",
                              {{"quick", options.quick ? "yes" : ""},
                               {"seed", std::to_string(options.seed)},
                               {"last_seed", std::to_string(options.seed + seeds - 1)},
                               {"seeds", std::to_string(seeds)},
                               {"visible", fmt::format("{:g}", kVisible)},
                               {"claims", describe(report.claims)},
                               {"kinds", to_markdown(table)}});
    return report;
}

}  // namespace hord::lab
