#include "lab/guarantee/guarantee.h"

#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <thread>

#include <fmt/format.h>

#include "algo/good_parts/distinct_parts.h"
#include "algo/good_parts/reference_check.h"
#include "algo/inspection/pipeline.h"
#include "algo/reference/read_noise.h"
#include "algo/reference/reference_learner.h"
#include "lab/experiment/result_cache.h"
#include "lab/guarantee/drawn_families.h"
#include "lab/report/statistics.h"
#include "lab/report/tables.h"
#include "lab/report/template.h"

namespace hord::lab {
namespace {

constexpr int kSeeds = 100, kQuickSeeds = 4, kTested = 200;
constexpr double kHeld = 0.95, kTuneShare = 1e-3;
enum : std::uint32_t { kLearn = 1, kTune = 2, kTest = 3 };

// The recipe that a user gets, for parts that fill the field.
algo::Recipe filling_recipe() {
    algo::Recipe recipe;
    recipe.part_required = false;
    return recipe;
}

}  // namespace

Result<ToldBounds> bounds_of(std::size_t family, std::uint64_t seed, int tested) {
    ToldBounds told;
    const algo::Extents& e = kFamilyExtents;
    std::vector<Frame> frames;  // drawn once: learning reads each some fifty times
    for (std::uint32_t k = 0; k < kLearnedParts; ++k) frames.push_back(draw_good_part(family, seed, kLearn, k));
    const algo::FrameOfPart frame_of = [&](std::size_t k) -> Result<Frame> { return frames[k]; };
    // As hordctl learn does.
    algo::Recipe recipe = filling_recipe();
    algo::CheckOptions checking;
    checking.recipe = recipe;
    checking.trials = 0;
    algo::LearnOptions& learning = checking.learning;
    learning.levels = algo::light_levels(recipe, kFamilyBits);
    learning.dark_from_noise = true;
    const auto read_dn = algo::read_noise_of(e, learning.levels, kLearnedParts, frame_of);
    if (!read_dn) return tl::unexpected(read_dn.error());
    learning.read_dn = *read_dn;
    auto learned = algo::learn_reference(e, kFamilyBits, kLearnedParts, frame_of, learning);
    if (!learned) return tl::unexpected(learned.error());
    learning.electrons_per_dn = learned->reference.sensor.electrons_per_dn;
    std::vector<std::size_t> numbers;
    for (std::size_t k = 0; k < kLearnedParts; ++k) numbers.push_back(k);
    std::vector<bool> used(kLearnedParts, true);
    for (const algo::LeftOut& out : learned->left_out) used[out.part] = false;
    const auto check = algo::check_reference(e, kFamilyBits, kLearnedParts, frame_of, numbers, used, checking);
    if (!check) return tl::unexpected(check.error());
    told.learned.bound = check->not_checked.empty() ? check->false_rejects.bound() : 1;

    const std::uint32_t dark = learned->reference.levels.dark;
    recipe.reference = std::make_shared<const algo::Reference>(std::move(learned->reference));
    auto pipeline = algo::Pipeline::create(e, kFamilyBits, recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    const auto score_of = [&](const Frame& frame) -> Result<double> {
        const auto seen = pipeline->inspect(frame.view());
        if (!seen) return tl::unexpected(seen.error());
        return seen->verdict == algo::Verdict::unfit ? algo::ReferenceCheck::kUnfit : static_cast<double>(seen->score);
    };
    // As hordctl tune does with that reference: the worst score of each distinct part sets a factor on all limits.
    algo::DistinctParts distinct(e, dark);
    std::vector<double> scores;
    for (int k = 0; k < kTunedParts + kTunedAgain; ++k) {
        const bool again = k >= kTunedParts;
        const Frame frame =
            draw_good_part(family, seed, kTune, static_cast<std::uint32_t>(k % kTunedParts), again ? 1 : 0);
        distinct.add(frame.view());
        const auto score = score_of(frame);
        if (!score) return tl::unexpected(score.error());
        scores.push_back(*score);
    }
    const auto groups = distinct.groups();
    told.counted = groups.at_least;
    std::vector<double> worst(groups.parts, 0);
    for (std::size_t k = 0; k < scores.size(); ++k)
        worst[groups.part_of[k]] = std::max(worst[groups.part_of[k]], scores[k]);
    const double factor = std::max(gumbel_limit(worst, kTuneShare), 1.01 * *std::ranges::max_element(worst));
    told.tuned.bound = algo::false_rejects_at(worst, factor, groups.at_least).bound();

    int by_recipe = 0, by_tuned = 0;
    for (int k = 0; k < tested; ++k) {
        const auto score = score_of(draw_good_part(family, seed, kTest, static_cast<std::uint32_t>(k)));
        if (!score) return tl::unexpected(score.error());
        by_recipe += *score >= 1 ? 1 : 0;
        by_tuned += *score >= factor ? 1 : 0;
    }
    told.learned.measured = static_cast<double>(by_recipe) / tested;
    told.tuned.measured = static_cast<double>(by_tuned) / tested;
    return told;
}

namespace {

Json to_json(const ToldBounds& t) {
    return {t.learned.bound, t.learned.measured, t.tuned.bound, t.tuned.measured, t.counted};
}
ToldBounds from_json(const Json& j) {
    return {
        {j[0].get<double>(), j[1].get<double>()}, {j[2].get<double>(), j[3].get<double>()}, j[4].get<std::size_t>()};
}

// What was told and measured over the seeds, as cells of a row.
struct Summary {
    std::vector<double> bounds;
    double measured = 0;
    int held = 0;
    void add(const ToldBounds::Told& told) {
        bounds.push_back(told.bound);
        measured += told.measured;
        held += told.holds() ? 1 : 0;
    }
    void to(std::vector<std::string>& row) const {
        row.push_back(fmt::format("{:.2f} %", 100 * quantile(bounds, 0.5)));
        row.push_back(fmt::format("{:.3f} %", 100 * share()));
        row.push_back(fmt::format("{} of {}", held, bounds.size()));
    }
    [[nodiscard]] double share() const { return measured / static_cast<double>(bounds.size()); }
    [[nodiscard]] bool holds() const { return held >= kHeld * static_cast<double>(bounds.size()); }
};

Result<ExperimentReport> run_or_report(const ExperimentOptions& options, bool only_finished) {
    auto cells =
        ResultCache::open(options.out / "cells.jsonl",
                          {{"experiment", "guarantee"}, {"seed", options.seed}, {"tested", kTested}, {"form", 1}});
    if (!cells) return tl::unexpected(cells.error());
    const int wanted = options.quick ? kQuickSeeds : kSeeds;
    const auto families = drawn_families();
    const int threads =
        options.threads > 0 ? options.threads : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
    ExperimentReport report;
    Table table{{"parts", "learn: at most (median)", "rejected", "holds with", "tune: at most (median)", "rejected",
                 "holds with", fmt::format("of {} parts to tune on, told apart (median)", kTunedParts)},
                {}};
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
    std::map<std::size_t, std::pair<Summary, Summary>> all;
    std::map<std::size_t, std::vector<double>> counted;
    for (int first = 0; first < seeds; first += threads) {
        for (std::size_t family = 0; family < families.size(); ++family) {
            options.progress(static_cast<double>(first) / seeds, std::string(families[family]));
            const int count = std::min(threads, seeds - first);
            std::vector<Result<ToldBounds>> told(static_cast<std::size_t>(count));
            {
                std::vector<std::jthread> helpers;
                for (int k = 0; k < count; ++k) {
                    if (cells->find(key(family, first + k)) != nullptr) continue;
                    helpers.emplace_back([&, k] {
                        told[static_cast<std::size_t>(k)] =
                            bounds_of(family, options.seed + static_cast<std::uint64_t>(first + k), kTested);
                    });
                }
            }
            for (int k = 0; k < count; ++k) {
                const auto cell = cells->value(key(family, first + k), [&]() -> Result<Json> {
                    const auto& one = told[static_cast<std::size_t>(k)];
                    if (!one) return tl::unexpected(one.error());
                    return to_json(*one);
                });
                if (!cell) return tl::unexpected(cell.error());
                const ToldBounds one = from_json(*cell);
                all[family].first.add(one.learned);
                all[family].second.add(one.tuned);
                counted[family].push_back(static_cast<double>(one.counted));
            }
        }
    }
    for (std::size_t family = 0; family < families.size(); ++family) {
        std::vector<std::string> row{std::string(families[family])};
        const auto& [learned, tuned] = all[family];
        learned.to(row), tuned.to(row);
        row.push_back(fmt::format("{:.0f}", quantile(counted[family], 0.5)));
        table.rows.push_back(std::move(row));
        report.claims.push_back(
            {fmt::format("{}: the bound that learn tells holds in 95 of 100 seeds", families[family]), learned.holds(),
             fmt::format("{} of {}", learned.held, learned.bounds.size())});
        report.claims.push_back(
            {fmt::format("{}: the bound that tune tells holds in 95 of 100 seeds", families[family]), tuned.holds(),
             fmt::format("{} of {}", tuned.held, tuned.bounds.size())});
        report.claims.push_back(
            {fmt::format("{}: at most {:g} % of good parts are rejected at limits from {} parts", families[family],
                         100 * algo::kGoalFalseRejects, kTunedParts),
             tuned.share() <= algo::kGoalFalseRejects,
             fmt::format("{:.3f} % of {}", 100 * tuned.share(), kTested * static_cast<int>(tuned.bounds.size()))});
    }
    report.text = fill_report("guarantee",
                              {{"arguments", options.arguments()},
                               {"seeds", std::to_string(seeds)},
                               {"tested", std::to_string(kTested)},
                               {"learned", std::to_string(kLearnedParts)},
                               {"tuned", std::to_string(kTunedParts)},
                               {"again", std::to_string(kTunedAgain)},
                               {"quick", options.quick ? "yes" : ""},
                               {"unfinished", seeds < wanted ? fmt::format("{} of {}", seeds, wanted) : ""},
                               {"table", to_markdown(table)},
                               {"claims", describe(report.claims)}});
    options.progress(1, "");
    if (auto written = write_csv(options.out / "guarantee.csv", table); !written)
        return tl::unexpected(written.error());
    report.files.push_back(options.out / "guarantee.csv");
    return report;
}

}  // namespace

Result<ExperimentReport> run_guarantee(const ExperimentOptions& options) { return run_or_report(options, false); }
Result<ExperimentReport> report_finished_guarantee(const ExperimentOptions& options) {
    return run_or_report(options, true);
}

}  // namespace hord::lab
