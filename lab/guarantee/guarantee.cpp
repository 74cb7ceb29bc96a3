#include "lab/guarantee/guarantee.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <thread>

#include <fmt/format.h>

#include "algo/good_parts/false_rejects.h"
#include "algo/good_parts/pod_curve.h"
#include "algo/good_parts/reference_check.h"
#include "lab/experiment/result_cache.h"
#include "lab/guarantee/judged_family.h"
#include "lab/report/statistics.h"
#include "lab/report/tables.h"
#include "lab/report/template.h"

namespace hord::lab {
namespace {

constexpr int kSeeds = 100, kQuickSeeds = 2, kTested = 200, kFlawed = 20;
constexpr double kHeld = 0.95, kFound = 0.95, kBubble = 0.5;  // shares; radius, lenslets

std::vector<double> rounded(std::vector<double> scores) {
    for (double& score : scores) score = std::round(1e4 * score) / 1e4;
    return scores;
}

Json to_json(const JudgedFamily& j) {
    Json flawed = Json::object();
    for (std::size_t flaw = 0; flaw < kDrawnFlaws.size(); ++flaw) {
        std::vector<double> values;  // size, score, size, score ...
        for (const auto& part : j.flawed[flaw]) values.insert(values.end(), {part.size, part.score});
        flawed[std::string(kDrawnFlaws[flaw])] = rounded(std::move(values));
    }
    return {{"learn_bound", j.learn_bound},      {"counted", j.counted},
            {"to_tune", rounded(j.to_tune)},     {"limit", j.limit},
            {"pooled_limit", j.pooled_limit},    {"tune_bound", j.tune_bound},
            {"by_recipe", rounded(j.by_recipe)}, {"by_tuned", rounded(j.by_tuned)},
            {"flawed", std::move(flawed)}};
}

// The results of a family over the seeds.
struct FamilyResults {
    struct Told {
        std::vector<double> bounds;
        double rejected = 0, parts = 0;
        int held = 0;
        void add(double bound, const std::vector<double>& scores) {
            const auto above = static_cast<double>(std::ranges::count_if(scores, [](double s) { return s >= 1; })),
                       count = static_cast<double>(scores.size());
            bounds.push_back(bound);
            rejected += above, parts += count;
            held += above <= bound * count ? 1 : 0;
        }
        [[nodiscard]] double share() const { return rejected / parts; }
        [[nodiscard]] bool holds() const { return held >= kHeld * static_cast<double>(bounds.size()); }
        void to(std::vector<std::string>& row) const {
            row.push_back(fmt::format("{:.2f} %", 100 * quantile(bounds, 0.5)));
            row.push_back(fmt::format("{:.3f} %", 100 * share()));
            row.push_back(fmt::format("{} of {}", held, bounds.size()));
        }
    };
    Told learned, tuned;
    std::vector<double> counted, limits, pooled_limits;
    double unfit = 0;  // of the good parts tested
    std::array<std::vector<DetectionTrial>, kDrawnFlaws.size()> flawed;

    void add(const Json& j) {
        const auto by_tuned = j.at("by_tuned").get<std::vector<double>>();
        learned.add(j.at("learn_bound").get<double>(), j.at("by_recipe").get<std::vector<double>>());
        tuned.add(j.at("tune_bound").get<double>(), by_tuned);
        unfit += static_cast<double>(std::ranges::count(by_tuned, algo::ReferenceCheck::kUnfit));
        counted.push_back(j.at("counted").get<double>());
        limits.push_back(j.at("limit").get<double>());
        pooled_limits.push_back(j.at("pooled_limit").get<double>());
        for (std::size_t flaw = 0; flaw < kDrawnFlaws.size(); ++flaw) {
            const auto values = j.at("flawed").at(std::string(kDrawnFlaws[flaw])).get<std::vector<double>>();
            for (std::size_t k = 0; k + 1 < values.size(); k += 2)
                flawed[flaw].push_back({values[k], values[k + 1] >= 1});
        }
    }
    [[nodiscard]] double found(std::size_t flaw) const {
        return static_cast<double>(std::ranges::count_if(flawed[flaw], &DetectionTrial::found)) /
            static_cast<double>(flawed[flaw].size());
    }
};

Table table_of_false_rejects(const std::vector<FamilyResults>& all) {
    Table table{{"parts", "learn: at most (median)", "rejected", "holds with", "tune: at most (median)", "rejected",
                 "of that unfit", "holds with", "limit (median)", "pooled_score (median)",
                 fmt::format("of {} parts to tune on, told apart (median)", kTunedParts)},
                {}};
    for (std::size_t family = 0; family < all.size(); ++family) {
        const FamilyResults& r = all[family];
        std::vector<std::string> row{std::string(drawn_families()[family])};
        r.learned.to(row), r.tuned.to(row);
        row.insert(row.end() - 1, fmt::format("{:.3f} %", 100 * r.unfit / r.tuned.parts));
        row.push_back(fmt::format("{:.2f}", quantile(r.limits, 0.5)));
        row.push_back(fmt::format("{:.1f}", quantile(r.pooled_limits, 0.5)));
        row.push_back(fmt::format("{:.0f}", quantile(r.counted, 0.5)));
        table.rows.push_back(std::move(row));
    }
    return table;
}

std::string lenslets(const std::optional<double>& radius) { return radius ? fmt::format("{:.2f}", *radius) : "none"; }
bool bubbles_found(const FamilyResults& r) {
    const PodCurve curve = pod_curve(r.flawed[static_cast<std::size_t>(DrawnFlaw::bubble)]);
    return curve.a90_95 && *curve.a90_95 <= kBubble;
}

Table table_of_flaws(const std::vector<FamilyResults>& all) {
    Table table{{"parts", "bubbles: a90", "a90/95"}, {}};
    for (std::size_t flaw = 1; flaw < kDrawnFlaws.size(); ++flaw) table.header.emplace_back(kDrawnFlaws[flaw]);
    for (std::size_t family = 0; family < all.size(); ++family) {
        const FamilyResults& r = all[family];
        const PodCurve curve = pod_curve(r.flawed[static_cast<std::size_t>(DrawnFlaw::bubble)]);
        std::vector<std::string> row{std::string(drawn_families()[family]), lenslets(curve.a90),
                                     lenslets(curve.a90_95) + (bubbles_found(r) ? "" : " **no**")};
        for (std::size_t flaw = 1; flaw < kDrawnFlaws.size(); ++flaw)
            row.push_back(fmt::format("{:.1f} %{}", 100 * r.found(flaw), r.found(flaw) >= kFound ? "" : " **no**"));
        table.rows.push_back(std::move(row));
    }
    return table;
}

void add_claims(const std::vector<FamilyResults>& all, std::vector<Claim>& claims) {
    for (std::size_t family = 0; family < all.size(); ++family) {
        const FamilyResults& r = all[family];
        const std::string_view name = drawn_families()[family];
        for (const auto& [command, told] : {std::pair("learn", &r.learned), std::pair("tune", &r.tuned)}) {
            claims.push_back({fmt::format("{}: the bound that {} tells holds in 95 of 100 seeds", name, command),
                              told->holds(), fmt::format("{} of {}", told->held, told->bounds.size())});
        }
        claims.push_back({fmt::format("{}: at most {:g} % of good parts are rejected at limits from {} parts", name,
                                      100 * algo::kGoalFalseRejects, kTunedParts),
                          r.tuned.share() <= algo::kGoalFalseRejects,
                          fmt::format("{:.3f} % of {}", 100 * r.tuned.share(), r.tuned.parts)});
    }
    // At these limits.
    const auto add = [&](const std::string& text, const auto& reached) {
        std::string missed;
        for (std::size_t family = 0; family < all.size(); ++family) {
            if (!reached(all[family]))
                missed += fmt::format("{}{}", missed.empty() ? "not: " : ", ", drawn_families()[family]);
        }
        const bool holds = missed.empty();
        claims.push_back({text, holds, holds ? "all" : missed});
    };
    add(fmt::format("every family: a90/95 of bubbles is at most {} lenslet", kBubble), bubbles_found);
    for (std::size_t flaw = 1; flaw < kDrawnFlaws.size(); ++flaw) {
        add(fmt::format("every family: {:g} % of parts with {} are found", 100 * kFound, kDrawnFlaws[flaw]),
            [&](const FamilyResults& r) { return r.found(flaw) >= kFound; });
    }
}

Result<ExperimentReport> run_or_report(const ExperimentOptions& options, bool only_finished) {
    auto cells =
        ResultCache::open(options.out / "cells.jsonl",
                          {{"experiment", "guarantee"}, {"seed", options.seed}, {"tested", kTested}, {"form", 3}});
    if (!cells) return tl::unexpected(cells.error());
    const int wanted = options.quick ? kQuickSeeds : kSeeds;
    const auto families = drawn_families();
    const int threads =
        options.threads > 0 ? options.threads : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
    const auto key = [&](std::size_t family, int k) {
        return fmt::format("{} {}", families[family], options.seed + static_cast<std::uint64_t>(k));
    };
    int finished = 0;
    const auto is_finished = [&](int k) {
        for (std::size_t family = 0; family < families.size(); ++family) {
            if (cells->find(key(family, k)) == nullptr) return false;
        }
        return true;
    };
    while (finished < wanted && is_finished(finished)) ++finished;
    if (only_finished && finished == 0)
        return fail(ErrorCode::invalid_argument, "no seed is finished", "let the experiment run on");
    const int seeds = only_finished ? finished : wanted;
    std::vector<FamilyResults> all(families.size());
    for (int first = 0; first < seeds; first += threads) {
        for (std::size_t family = 0; family < families.size(); ++family) {
            options.progress(static_cast<double>(first) / seeds, std::string(families[family]));
            const int count = std::min(threads, seeds - first);
            std::vector<Result<JudgedFamily>> judged(static_cast<std::size_t>(count));
            {
                std::vector<std::jthread> helpers;
                for (int k = 0; k < count; ++k) {
                    if (cells->find(key(family, first + k)) != nullptr) continue;
                    helpers.emplace_back([&, k] {
                        judged[static_cast<std::size_t>(k)] = judge_family(
                            family, options.seed + static_cast<std::uint64_t>(first + k), kTested, kFlawed);
                    });
                }
            }
            for (int k = 0; k < count; ++k) {
                const auto cell = cells->value(key(family, first + k), [&]() -> Result<Json> {
                    const auto& one = judged[static_cast<std::size_t>(k)];
                    if (!one) return tl::unexpected(one.error());
                    return to_json(*one);
                });
                if (!cell) return tl::unexpected(cell.error());
                all[family].add(*cell);
            }
        }
    }
    ExperimentReport report;
    const Table table = table_of_false_rejects(all), found = table_of_flaws(all);
    add_claims(all, report.claims);
    report.text = fill_report("guarantee",
                              {{"arguments", options.arguments()},
                               {"seeds", std::to_string(seeds)},
                               {"tested", std::to_string(kTested)},
                               {"learned", std::to_string(kLearnedParts)},
                               {"tuned", std::to_string(kTunedParts)},
                               {"again", std::to_string(kTunedAgain)},
                               {"quick", options.quick ? "yes" : ""},
                               {"unfinished", seeds < wanted ? fmt::format("{} of {}", seeds, wanted) : ""},
                               {"flawed", std::to_string(kFlawed * seeds)},
                               {"table", to_markdown(table)},
                               {"found", to_markdown(found)},
                               {"claims", describe(report.claims)}});
    options.progress(1, "");
    for (const auto& [name, one] : {std::pair("guarantee.csv", &table), std::pair("flaws.csv", &found)}) {
        if (auto written = write_csv(options.out / name, *one); !written) return tl::unexpected(written.error());
        report.files.push_back(options.out / name);
    }
    return report;
}

}  // namespace

Result<ExperimentReport> run_guarantee(const ExperimentOptions& options) { return run_or_report(options, false); }
Result<ExperimentReport> report_finished_guarantee(const ExperimentOptions& options) {
    return run_or_report(options, true);
}

}  // namespace hord::lab
