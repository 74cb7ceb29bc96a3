// `hord-lab experiment tradeoff`: the parts have their stated values, scores do not depend on threads, the quick form's
// claims come out as docs/results/tradeoff.md has them, and a run that was killed continues.
#include "lab/tradeoff/tradeoff.h"

#include <algorithm>
#include <csignal>
#include <fstream>
#include <iterator>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "algo/maps/feature_map.h"
#include "lab/tradeoff/tradeoff_rating.h"
#include "lab/tradeoff/tradeoff_scores.h"
#include "lab/tradeoff/tradeoff_whole_report.h"
#include "tests/system/cli/program.h"

namespace hord::lab {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

const auto kUnheard = [](double) {};

double median_of_interior(std::span<const float> values) {
    std::vector<double> inside;
    for (int n = 1; n < kRows - 1; ++n) {
        for (int m = 1; m < kColumns - 1; ++m)
            inside.push_back(static_cast<double>(values[static_cast<std::size_t>(n * kColumns + m)]));
    }
    return quantile(inside, 0.5);
}

TEST(TradeoffParts, bend_light_by_the_slope_they_are_named_after_whatever_the_bins) {
    for (const TradeoffPoint& point : {TradeoffPoint{9, 0.15, 2000, 1, 1}, TradeoffPoint{9, 1.0, 2000, 1, 1},
                                       TradeoffPoint{13, 0.5, 2000, 1, 1}, TradeoffPoint{9, 0.15, 2000, 1, 2}}) {
        SCOPED_TRACE(point.key());
        const auto parts = trace_parts(point, {0, 0}, 1, 2, kUnheard);
        ASSERT_TRUE(parts) << parts.error().message();
        const algo::Extents& e = parts->nominal[0].extents;
        ASSERT_EQ(e, (algo::Extents{kColumns, kRows, point.bins, point.bins}));
        auto mapper = algo::FeatureMapper::create(e, 16, kExactLevels, algo::Feature::centroid);
        ASSERT_TRUE(mapper);
        const Frame frame = expose_exactly(*parts, parts->nominal[0]);
        const auto map = mapper->over_neighbours(frame.view());
        ASSERT_TRUE(map);
        // Neighbours are `stride` lenslets apart, and the bin is 9 / bins of the nine-bin camera's. Bins of finite
        // width make the mean ripple about the truth (algo/recipe/recipe.h): the median over all phases is within a
        // tenth.
        const double slope = point.slope * point.stride * point.bins / 9.0;
        EXPECT_NEAR(median_of_interior(map->values), slope, 0.1 * slope);
    }
}

TEST(TradeoffParts, hold_the_light_and_the_noise_that_are_asked_for) {
    const TradeoffPoint point;
    const auto parts = trace_parts(point, {1, 0}, 1, 2, kUnheard);
    ASSERT_TRUE(parts);
    double sum = 0, squares = 0, count = 0;
    for (std::uint64_t exposure = 0; exposure < 10; ++exposure) {
        const Frame frame = expose_part(*parts, parts->good[0].light, point, 1, exposure);
        for (int n = 0; n < kRows; ++n) {
            for (int m = 0; m < kColumns; ++m) {
                double light = 0;
                for (int k = 0; k < 81; ++k) light += frame.view().sample(m * 9 + k % 9, n * 9 + k / 9);
                sum += light, squares += light * light, count += 1;
            }
        }
    }
    const double mean = sum / count, variance = squares / count - mean * mean;
    // Read noise below zero is cut off: about 0.8 electrons in each of some seventy dark bins, with a variance of
    // about 1.4 each.
    EXPECT_NEAR(mean, point.photons + 0.8 * 70, 0.02 * point.photons);
    EXPECT_NEAR(variance, point.photons + 1.4 * 70 + 4 * 10, 0.15 * point.photons);
}

TEST(TradeoffScores, do_not_depend_on_the_number_of_threads) {
    const TradeoffPoint point;
    std::vector<std::string> said;
    for (const int threads : {1, 3}) {
        const auto parts = trace_parts(point, {2, 1}, 5, threads, kUnheard);
        ASSERT_TRUE(parts);
        ScoreOptions options;
        options.good_exposures = options.bad_exposures = 1;
        options.repeats = 5;
        options.threads = threads;
        const auto scores = score_features(*parts, point, options);
        ASSERT_TRUE(scores) << scores.error().message();
        EXPECT_EQ(scores->size(), 27U);
        said.push_back(scores->dump());
    }
    EXPECT_EQ(said[0], said[1]);
}

Rated rated(const std::string& name, Kind kind, double ms, double found) {
    Rated r;
    r.name = name;
    r.kind = kind;
    r.median_ms = ms;
    for (Estimate& t : r.tpr) t = {found, found - 0.05, found + 0.05};
    return r;
}

TEST(TradeoffRating, names_what_is_dominated_and_what_is_as_good_but_faster) {
    const std::vector<Rated> all = {rated("good", Kind::neighbours, 100, 0.8),
                                    rated("slow", Kind::neighbours, 200, 0.8), rated("poor", Kind::neighbours, 50, 0.5),
                                    rated("nearly", Kind::neighbours, 80, 0.77),
                                    rated("other", Kind::reference, 90, 0.9)};
    EXPECT_EQ(dominator(all, all[1], true)->name, "good");
    EXPECT_EQ(dominator(all, all[1], false)->name, "other");
    EXPECT_EQ(dominator(all, all[2], false), nullptr);
    EXPECT_EQ(dominator(all, all[0], true), nullptr);
    EXPECT_EQ(dominator(all, all[0], false)->name, "other");
    const Rated* best = best_of(all, Kind::neighbours);
    EXPECT_EQ(best->name, "good");
    EXPECT_EQ(fastest_as_good(all, *best)->name, "nearly");
    EXPECT_FALSE(dominates(all[0], all[0]));
}

// Two seeds: good parts, rejected, bad parts, missed, ms.
WholeRecipe whole(const std::string& name, double ms, int rejected, int missed, int missed_by_other_seed) {
    return {name, {{16, rejected, 48, missed, ms}, {16, 0, 48, missed_by_other_seed, ms}}};
}

TEST(WholeTrade, advises_the_fastest_recipe_that_is_among_the_best_in_every_seed) {
    const auto best = whole("best", 10, 0, 5, 5), near = whole("near", 4, 1, 6, 6),
               misses = whole("misses in one seed", 1, 0, 5, 7), rejects = whole("rejects", 2, 2, 5, 5);
    EXPECT_EQ(advised({best, near, misses, rejects})->name, "near");
    EXPECT_EQ(advised({best, misses, rejects})->name, "best");
    // Each is beaten by more than one part in one of the seeds.
    EXPECT_EQ(advised({whole("a", 1, 0, 5, 9), whole("b", 1, 0, 9, 5)}), nullptr);
}

TEST(WholeTrade, of_equally_fast_recipes_advises_the_one_that_misses_least) {
    EXPECT_EQ(advised({whole("fast", 10, 0, 6, 5), whole("as fast", 10.5, 0, 5, 5)})->name, "as fast");
    EXPECT_EQ(advised({whole("fast", 10, 0, 6, 5), whole("slower", 12, 0, 5, 5)})->name, "fast");
}

TEST(WholeTrade, advises_nothing_where_seeds_or_machines_choose_differently) {
    WholeRecipe a = whole("a", 10, 0, 5, 5), b = whole("b", 12, 0, 5, 5);
    EXPECT_EQ(advised({a, b})->name, "a");
    a.arm64_instructions = 3e6, b.arm64_instructions = 2e6;  // there b is the faster one
    EXPECT_EQ(advised({a, b}), nullptr);
    b.arm64_instructions = 4e6;
    EXPECT_EQ(advised({a, b})->name, "a");
    std::swap(a.seeds[1].mean_ms, b.seeds[1].mean_ms);
    EXPECT_EQ(advised({a, b}), nullptr);
}

TEST(WholeTrade, finds_large_defects_passes_good_parts_and_does_not_depend_on_threads) {
    const std::function<void(double)> unheard = [](double) {};
    std::vector<Json> found;
    for (const int threads : {1, 2}) {
        auto all = judge_whole_parts({45, 7}, {8, 8, 1, 1}, threads, {}, unheard);
        ASSERT_TRUE(all) << all.error().message();
        ASSERT_EQ(all->size(), 8U);
        for (auto& [name, recipe] : all->items()) {
            EXPECT_EQ(recipe["good"], 8) << name;
            EXPECT_EQ(recipe["ms"].size(), 8U + 16U) << name;
            recipe.erase("ms");
        }
        found.push_back(std::move(*all));
    }
    EXPECT_EQ(found[0], found[1]);
    const Json& emd = found[0]["emd, jacobian-frobenius, transmission"];
    const Json& largest = emd["bubble"].back();  // [size, missed, tried]: half a lenslet wide, it takes its light
    EXPECT_EQ(largest[1], 0) << emd.dump();
    EXPECT_EQ(largest[2], 1);
    EXPECT_EQ(emd["scratch"].front()[1], 1) << emd.dump();  // of a hundredth of a lenslet
}

std::string text_of(const std::string& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(TradeoffExperiment, killed_and_started_again_it_continues_and_its_claims_come_out_as_written_down) {
    const test::TemporaryFolder folder;
    const std::vector<std::string> arguments = {"experiment", "tradeoff", "--quick", "--out", folder.path().string()};
    {
        test::Running running("hord-lab", arguments);
        ASSERT_TRUE(running.says("photons 200 ", std::chrono::seconds(250)))
            << running.so_far().err;  // the first cell is finished
        running.stop(SIGKILL);
    }
    const std::string cells = folder / "cells.jsonl", before = text_of(cells);
    EXPECT_THAT(before, HasSubstr("score bins 9 slope 0.15 photons 2000"));
    EXPECT_THAT(before, ::testing::Not(HasSubstr("slope 1 ")));
    const test::Said said = test::run("hord-lab", arguments, std::chrono::seconds(280));
    EXPECT_EQ(said.status, 0) << said.err
                              << said.out.substr(std::min(said.out.size(), said.out.find("## Claims")), 4000);
    EXPECT_THAT(text_of(cells), StartsWith(before.substr(0, before.rfind('\n') + 1)));
    for (const char* file : {"tradeoff.md", "tradeoff.csv", "tradeoff-pareto.svg", "tradeoff-pareto.png",
                             "tradeoff-pod.png", "tradeoff-error.png", "tradeoff-axes.png"}) {
        EXPECT_TRUE(std::filesystem::exists(folder / file)) << file;
    }
}

}  // namespace
}  // namespace hord::lab
