#include "lab/tradeoff/tradeoff.h"

#include <algorithm>
#include <optional>

#include <fmt/format.h>

#include "lab/tradeoff/tradeoff_scores.h"
#include "lab/tradeoff/tradeoff_times.h"

namespace hord::lab {
namespace {

constexpr TradeoffPoint kCentre{};

// Nine bins of this pitch, mrad, and a source of the usual 0.61 bins.
TradeoffPoint of_pitch(double mrad) { return {9, 0.15, 2000, 1, 1, 9 * mrad, 0.61 * mrad}; }

// Ordered so that points with the same parts (bins, slope and stride) follow one another.
std::vector<TradeoffPoint> points(bool quick) {
    if (quick) return {kCentre, {9, 0.15, 200, 1, 1}, {9, 1.0, 2000, 1, 1}, of_pitch(60)};
    std::vector<TradeoffPoint> all;
    for (const double slope : {0.05, 0.15, 0.5, 1.0, 1.5}) {
        for (const int photons : {200, 600, 2000, 6000, 20000}) {
            if (slope == kCentre.slope || photons == 200 || photons == 2000 || photons == 20000)
                all.push_back({9, slope, photons, 1, 1});
        }
        if (slope == 0.15) {
            for (const int frames : {4, 16}) all.push_back({9, slope, 200, frames, 1});
            all.push_back({9, slope, 2000, 4, 1});
        }
    }
    for (const int bins : {3, 5, 13}) {
        for (const int photons : {200, 2000, 20000}) all.push_back({bins, 0.15, photons, 1, 1});
    }
    for (const int stride : {2, 3}) all.push_back({9, 0.15, 2000, 1, stride});
    for (const double pitch : {5, 10, 30, 60, 200}) all.push_back(of_pitch(pitch));
    for (const double source_bins : {0.3, 1.2, 2.4}) all.push_back({9, 0.15, 2000, 1, 1, 135, 15 * source_bins});
    return all;
}

std::vector<TradeoffPoint> timed_points(bool quick) {
    if (quick) return {kCentre};
    std::vector<TradeoffPoint> all;
    for (const int bins : {9, 3, 5, 13}) {
        for (const int photons : {200, 2000, 20000}) all.push_back({bins, kCentre.slope, photons, 1, 1});
    }
    for (const int stride : {2, 3}) all.push_back({9, kCentre.slope, 2000, 1, stride});
    return all;
}

bool same_parts(TradeoffPoint a, const TradeoffPoint& b) {
    a.photons = b.photons, a.frames = b.frames;
    return a == b;
}

}  // namespace

const Json* TradeoffResults::scores_at(const TradeoffPoint& point) const {
    const auto found = std::ranges::find(scores, point, &Cell::point);
    return found == scores.end() ? nullptr : &found->values;
}
const Json* TradeoffResults::times_at(TradeoffPoint point) const {
    point.slope = kCentre.slope;
    point.frames = 1;
    point.range_mrad = kCentre.range_mrad, point.source_mrad = kCentre.source_mrad;
    const auto found = std::ranges::find(times, point, &Cell::point);
    return found == times.end() ? nullptr : &found->values;
}

Result<ExperimentReport> run_tradeoff(const ExperimentOptions& options) {
    auto cells =
        ResultCache::open(options.out / "cells.jsonl",
                          {{"experiment", "tradeoff"}, {"quick", options.quick}, {"seed", options.seed}, {"form", 2}});
    if (!cells) return tl::unexpected(cells.error());
    TradeoffResults results;
    results.counts = options.quick ? PartCounts{6, 6} : PartCounts{};
    ScoreOptions scoring;
    scoring.seed = options.seed;
    scoring.threads = options.threads;
    if (options.quick) scoring.bad_exposures = 1, scoring.repeats = 50;
    results.good_patches = 20 * results.counts.good * scoring.good_exposures;
    results.defects_of_a_family = 4 * results.counts.bad_of_a_family * scoring.bad_exposures;

    const auto scored = points(options.quick), timed = timed_points(options.quick);
    const auto cell_axes = cell_points(options.quick);
    const int seeds = options.quick ? 1 : kTradeoffSeeds;
    const auto total = static_cast<double>(scored.size() + timed.size() + cell_axes.size());
    double done = 0;
    std::optional<TradeoffParts> parts;
    std::optional<TradeoffPoint> parts_of;
    for (const TradeoffPoint& point : scored) {
        const auto note = [&](double part) { options.progress((done + part) / total, point.key()); };
        note(0);
        auto cell = cells->value("score " + point.key(), [&]() -> Result<Json> {
            if (!parts_of || !same_parts(*parts_of, point)) {
                auto traced = trace_parts(point, results.counts, options.seed, options.threads,
                                          [&](double share) { note(0.3 * share); });
                if (!traced) return tl::unexpected(traced.error());
                parts = std::move(*traced);
                parts_of = point;
            }
            return score_features(*parts, point, scoring);
        });
        if (!cell) return tl::unexpected(cell.error());
        results.scores.push_back({point, std::move(*cell)});
        done += 1;
    }
    for (const TradeoffPoint& point : timed) {
        options.progress(done / total, "times of " + point.key());
        auto cell = cells->value("time " + point.key(),
                                 [&] { return time_features(point, options.seed, options.threads, options.quick); });
        if (!cell) return tl::unexpected(cell.error());
        results.times.push_back({point, std::move(*cell)});
        done += 1;
    }
    for (const CellPoint& point : cell_axes) {
        TriedCell tried{point, {}};
        for (int k = 0; k < seeds; ++k) {
            options.progress((done + static_cast<double>(k) / seeds) / total, point.axis + ": " + point.label);
            const std::uint64_t seed = options.seed + static_cast<std::uint64_t>(k);
            auto cell = cells->value(fmt::format("cell {}, {}, seed {}", point.axis, point.label, seed),
                                     [&] { return try_cell_point(point, seed, options.quick, options.threads); });
            if (!cell) return tl::unexpected(cell.error());
            tried.found.push_back(std::move(*cell));
        }
        results.cells.push_back(std::move(tried));
        done += 1;
    }
    auto approximations =
        cells->value("approximations", [&] { return approximations_of_emd(kCentre, options.seed, options.threads); });
    if (!approximations) return tl::unexpected(approximations.error());
    results.approximations = std::move(*approximations);
    options.progress(1, "");
    return report_tradeoff(results, options);
}

}  // namespace hord::lab
