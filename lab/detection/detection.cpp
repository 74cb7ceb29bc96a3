#include "lab/detection/detection.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <thread>

#include <fmt/format.h>

#include "lab/detection/detection_parts.h"

namespace hord::lab {
namespace {

constexpr int kChunk = 100;  // parts of a cached cell
constexpr double kLedLoss = 0.7;
constexpr int kTuneExposures = 2;  // of every traced part
constexpr double kHazeRadius = 1.2, kSpeckRadius = 1;
constexpr double kDeepElectronsPerDn = 0.3;  // 16 bits that 20,000 electrons a lenslet nearly fill

struct Sizes {
    int learn, tune, good, poses, bubbles, bubble_exposures, flaws, flaw_exposures, slope_poses, slope_exposures;
};
constexpr Sizes kFull{32, 4000, 2000, 200, 1000, 2, 500, 4, 100, 20}, kQuick{12, 24, 30, 15, 20, 1, 10, 2, 8, 3};

// A figure: its parts and their flaw.
struct Figure {
    std::string name;
    Flaw flaw = Flaw::none;
    double size = 0, wobble = 1, led = 1;
    int parts = 0;
    Stream stream = Stream::test;
    int poses = 0;      // traced poses, exposed in turn; 0: every part has its own
    int exposures = 1;  // consecutive exposures of every traced part, if poses is 0
    [[nodiscard]] int pose_of(int number) const { return poses > 0 ? number % poses : number / exposures; }
};

class Production {
  public:
    Production(sim::Scene scene, std::shared_ptr<const algo::Reference> reference, double factor, std::uint64_t seed)
        : scene_(std::move(scene)), recipe_(production_recipe()), seed_(seed) {
        recipe_.reference = std::move(reference);
        recipe_.reject_score *= static_cast<float>(factor);
        recipe_.cluster_score *= static_cast<float>(factor);
    }

    // Judges parts first .. first + count - 1 of a figure on several threads; the result does not depend on them.
    Result<Json> judge(const Figure& figure, int first, int count, int threads);

  private:
    Result<JudgedPart> judge_one(algo::Pipeline& pipeline, const Figure& figure, int number,
                                 std::optional<ProductionPart>& traced, int& traced_number);
    sim::Scene scene_;
    algo::Recipe recipe_;
    std::uint64_t seed_;
    std::mutex traced_mutex_;
    std::map<int, ProductionPart> traced_;  // good parts of the test stream, by pose
};

Json to_json(const JudgedPart& p) {
    return {p.score, p.unfit ? 1 : 0, p.hit ? 1 : 0, p.kind, p.size, p.from_rim, p.defects};
}
JudgedPart from_json(const Json& j) {
    return {j[0].get<double>(), j[1].get<int>() != 0, j[2].get<int>() != 0, j[3].get<int>(),
            j[4].get<double>(), j[5].get<double>(),   j[6].get<int>()};
}

Result<JudgedPart> Production::judge_one(algo::Pipeline& pipeline, const Figure& f, int number,
                                         std::optional<ProductionPart>& traced, int& traced_number) {
    const int pose = f.pose_of(number);
    const bool painted = f.flaw == Flaw::speck || f.flaw == Flaw::haze;
    const bool often = f.poses > 1 && f.stream == Stream::test;  // several figures use this pose
    if (!traced || traced_number != pose) {
        const std::lock_guard lock(traced_mutex_);
        const auto kept = traced_.find(pose);
        traced_number = often && kept != traced_.end() ? pose : -1;
        if (traced_number == pose) traced = kept->second;
    }
    if (!traced || traced_number != pose) {
        auto part = make_part(scene_, painted ? Flaw::none : f.flaw, f.size, f.wobble, seed_, f.stream,
                              static_cast<std::uint32_t>(pose));
        if (!part) return tl::unexpected(part.error());
        traced = std::move(*part);
        traced_number = pose;
        const std::lock_guard lock(traced_mutex_);
        if (often) traced_.emplace(pose, *traced);
    }
    ProductionPart part = *traced;
    if (painted) add_flaw(part, f.flaw, f.size, seed_, f.stream, static_cast<std::uint32_t>(number));
    const auto turn = static_cast<std::uint64_t>(number) + (static_cast<std::uint64_t>(f.stream) << 32U) +
        (static_cast<std::uint64_t>(f.flaw) << 56U) + (static_cast<std::uint64_t>(f.led * 1000) << 40U);
    const auto found = pipeline.inspect(expose_part(part.light, scene_, seed_, turn, f.led).view());
    if (!found) return tl::unexpected(found.error());
    JudgedPart judged;
    judged.unfit = found->verdict == algo::Verdict::unfit;
    judged.score = judged.unfit ? 100 : static_cast<double>(found->score);
    judged.defects = static_cast<int>(found->defects.size());
    judged.size = part.flaw.size;
    const algo::Extents& e = scene_.camera.extents;
    judged.from_rim = 9.5 - std::hypot(part.flaw.m - 0.5 * (e.m - 1), part.flaw.n - 0.5 * (e.n - 1));
    for (const algo::Defect& d : found->defects) {
        if (std::hypot(static_cast<double>(d.m) - part.flaw.m, static_cast<double>(d.n) - part.flaw.n) >
            part.flaw.size + 2)
            continue;
        judged.hit = f.flaw != Flaw::none;
        judged.kind = static_cast<int>(d.kind);
        break;
    }
    return judged;
}

Result<Json> Production::judge(const Figure& figure, int first, int count, int threads) {
    std::vector<Result<JudgedPart>> judged(static_cast<std::size_t>(count));
    const int crew = threads > 0 ? threads : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
    // Exposures of one pose follow one another on one thread.
    std::vector<int> order;
    for (int k = first; k < first + count; ++k) order.push_back(k);
    if (figure.poses > 0) std::ranges::stable_sort(order, {}, [&](int k) { return k % figure.poses; });
    std::atomic<std::size_t> next = 0;
    std::optional<Error> refused;
    const auto work = [&](algo::Pipeline& pipeline) {
        std::optional<ProductionPart> traced;
        int traced_number = -1;
        for (std::size_t from = next.fetch_add(8); from < order.size(); from = next.fetch_add(8)) {
            for (std::size_t k = from; k < std::min(order.size(), from + 8); ++k) {
                judged[static_cast<std::size_t>(order[k] - first)] =
                    judge_one(pipeline, figure, order[k], traced, traced_number);
            }
        }
    };
    std::vector<algo::Pipeline> pipelines;
    for (int k = 0; k < crew; ++k) {
        auto pipeline = algo::Pipeline::create(scene_.camera.extents, scene_.camera.bits, recipe_);
        if (!pipeline) return tl::unexpected(pipeline.error());
        pipelines.push_back(std::move(*pipeline));
    }
    {
        std::vector<std::jthread> helpers;
        for (std::size_t k = 1; k < pipelines.size(); ++k) helpers.emplace_back([&, k] { work(pipelines[k]); });
        work(pipelines[0]);
    }
    Json all = Json::array();
    for (const auto& one : judged) {
        if (!one) return tl::unexpected(one.error());
        all.push_back(to_json(*one));
    }
    return all;
}

// The factor on the limits that rejects a share kGoodShare of good parts, from the tail of the tuning scores.
double factor_for(const std::vector<JudgedPart>& tuning) {
    std::vector<double> scores;
    for (const JudgedPart& p : tuning) {
        if (!p.unfit) scores.push_back(p.score);
    }
    return tail_limit(std::move(scores), kGoodShare);
}

class Run {
  public:
    Run(const ExperimentOptions& options, ResultCache& cells, bool only_finished)
        : options_(options), cells_(cells), sizes_(options.quick ? kQuick : kFull), only_finished_(only_finished) {}
    Result<DetectionResults> run();

  private:
    Result<void> judge(Production& production, const Figure& figure);
    // The round part at every light level, with the same limits, one reference and a camera of 16 bits whose full scale
    // the brightest light nearly fills.
    Result<void> judge_light_levels();
    Result<void> judge_strips();
    Result<void> measure_contrasts();
    Result<void> tune_limits(const sim::Scene& round, const std::shared_ptr<const algo::Reference>& reference);
    // Flaws that are traced part by part, which takes longest. The figures take turns, so that an interrupted run has
    // some parts of each.
    Result<void> judge_traced(Production& production);
    Result<void> judge_chunk(Production& production, const Figure& figure, int first);
    Result<std::shared_ptr<const algo::Reference>> learn(const sim::Scene& scene, const std::string& what,
                                                         double led = 1);
    Result<Json> value(const std::string& key, const std::function<Result<Json>()>& compute);
    void note(const std::string& what) { options_.progress(std::min(0.99, done_ / total_), what); }

    const ExperimentOptions& options_;
    ResultCache& cells_;
    Sizes sizes_;
    bool only_finished_;  // computes nothing: cells that are not cached stay out of the results
    DetectionResults results_;
    double done_ = 0, total_ = 1;
};

Result<Json> Run::value(const std::string& key, const std::function<Result<Json>()>& compute) {
    if (!only_finished_) return cells_.value(key, compute);
    const Json* kept = cells_.find(key);
    return kept != nullptr ? *kept : Json();
}

Result<void> Run::judge_chunk(Production& production, const Figure& figure, int first) {
    note(figure.name);
    results_.wanted[figure.name] = static_cast<std::size_t>(figure.parts);
    const int count = std::min(kChunk, figure.parts - first);
    auto cell = value(fmt::format("{} {}", figure.name, first),
                      [&] { return production.judge(figure, first, count, options_.threads); });
    if (!cell) return tl::unexpected(cell.error());
    for (const Json& one : *cell) results_.parts[figure.name].push_back(from_json(one));
    done_ += count;
    return {};
}

Result<void> Run::judge(Production& production, const Figure& figure) {
    for (int first = 0; first < figure.parts; first += kChunk) {
        if (auto done = judge_chunk(production, figure, first); !done) return done;
    }
    return {};
}

Result<std::shared_ptr<const algo::Reference>> Run::learn(const sim::Scene& scene, const std::string& what,
                                                          double led) {
    note(what);
    if (only_finished_) return std::shared_ptr<const algo::Reference>();
    return learn_production(scene, sizes_.learn, 1, options_.seed, led);
}

Result<void> Run::judge_light_levels() {
    sim::Scene deep = round_part();
    deep.camera.bits = 16;
    deep.camera.full_bin_dn *= deep.noise.electrons_per_dn / kDeepElectronsPerDn;
    deep.noise.electrons_per_dn = kDeepElectronsPerDn;
    auto learned =
        learn(deep, "learning for the light levels", *std::ranges::max_element(kLightLevels) / kProductionElectrons);
    if (!learned) return tl::unexpected(learned.error());
    Production levels(deep, *learned, results_.factor, options_.seed);
    for (const double electrons : kLightLevels) {
        const double led = electrons / kProductionElectrons;
        if (auto done = judge(levels,
                              {.name = fmt::format("{:g} electrons good", electrons),
                               .led = led,
                               .parts = sizes_.good,
                               .poses = sizes_.poses});
            !done)
            return done;
        if (auto done = judge(levels,
                              {.name = fmt::format("{:g} electrons haze", electrons),
                               .flaw = Flaw::haze,
                               .size = kHazeRadius,
                               .led = led,
                               .parts = sizes_.good,
                               .poses = sizes_.poses});
            !done) {
            return done;
        }
    }
    return {};
}

Result<void> Run::judge_strips() {
    for (const double slope : results_.slopes) {
        const sim::Scene scene = strip(slope);
        auto learned = learn(scene, fmt::format("learning slope {:g}", slope));
        if (!learned) return tl::unexpected(learned.error());
        Production strips(scene, *learned, results_.factor, options_.seed);
        const int parts = sizes_.slope_poses * sizes_.slope_exposures;
        if (auto done = judge(
                strips, {.name = fmt::format("slope {:g} good", slope), .parts = parts, .poses = sizes_.slope_poses});
            !done)
            return done;
        // The poses come from the tuning stream, which strips do not use otherwise, so they differ from the good ones.
        if (auto done = judge(strips,
                              {.name = fmt::format("slope {:g} haze", slope),
                               .flaw = Flaw::haze,
                               .size = kHazeRadius,
                               .parts = parts,
                               .stream = Stream::tune,
                               .poses = sizes_.slope_poses});
            !done) {
            return done;
        }
    }
    return {};
}

Result<void> Run::judge_traced(Production& production) {
    const Figure traced[] = {
        {.name = "bubble",
         .flaw = Flaw::bubble,
         .parts = sizes_.bubbles * sizes_.bubble_exposures,
         .exposures = sizes_.bubble_exposures},
        {.name = "dimple",
         .flaw = Flaw::dimple,
         .size = 1.5,
         .parts = sizes_.flaws * sizes_.flaw_exposures,
         .exposures = sizes_.flaw_exposures},
        {.name = "scratch",
         .flaw = Flaw::scratch,
         .size = 4,
         .parts = sizes_.flaws * sizes_.flaw_exposures,
         .exposures = sizes_.flaw_exposures},
    };
    for (int first = 0, left = 1; left > 0; first += kChunk) {
        left = 0;
        for (const Figure& figure : traced) {
            if (first >= figure.parts) continue;
            if (auto done = judge_chunk(production, figure, first); !done) return done;
            ++left;
        }
    }
    return {};
}

Result<void> Run::tune_limits(const sim::Scene& round, const std::shared_ptr<const algo::Reference>& reference) {
    Production tuning(round, reference, 1, options_.seed);
    const int parts = sizes_.tune;
    if (auto done =
            judge(tuning, {.name = "tune", .parts = parts, .stream = Stream::tune, .exposures = kTuneExposures});
        !done)
        return done;
    if (static_cast<int>(results_.parts["tune"].size()) < parts)
        return fail(ErrorCode::invalid_argument, "the limits are not tuned yet: no figure is finished",
                    "let the experiment run on");
    results_.factor = factor_for(results_.parts["tune"]);
    results_.tuned_on = parts;
    return {};
}

Result<void> Run::measure_contrasts() {
    Json all = Json::array();
    for (std::uint64_t k = 0; k < kContrastSeeds; ++k) {
        const std::uint64_t seed = options_.seed + k;
        note(fmt::format("contrast on the paper's scenes, seed {}", seed));
        auto contrast =
            value(fmt::format("contrast {}", seed), [&] { return measure_contrast(options_, seed, k == 0); });
        if (!contrast) return tl::unexpected(contrast.error());
        if (contrast->is_null()) return {};
        for (Json& scene : *contrast) all.push_back(std::move(scene));
    }
    results_.contrast = std::move(all);
    return {};
}

Result<DetectionResults> Run::run() {
    const Sizes& s = sizes_;
    results_.seed = options_.seed;
    results_.slopes = options_.quick ? std::vector<double>{0.15, 1.0} : std::vector<double>{0.05, 0.15, 0.5, 1.0, 1.5};
    results_.poses = s.poses;
    results_.slope_poses = s.slope_poses;
    results_.bubble_exposures = s.bubble_exposures;
    results_.flaw_exposures = s.flaw_exposures;
    total_ = (options_.tuned_limits ? s.tune : 0) + 11.0 * s.good + s.bubbles * s.bubble_exposures +
        2.0 * s.flaws * s.flaw_exposures +
        2.0 * static_cast<double>(results_.slopes.size()) * s.slope_poses * s.slope_exposures;

    const sim::Scene round = round_part();
    auto reference = learn(round, "learning the round part");
    if (!reference) return tl::unexpected(reference.error());

    if (options_.tuned_limits) {
        if (auto done = tune_limits(round, *reference); !done) return tl::unexpected(done.error());
    }

    Production production(round, *reference, results_.factor, options_.seed);
    const Figure figures[] = {
        {.name = "still", .wobble = 0, .parts = s.good, .poses = 1},
        {.name = "wobble", .parts = s.good, .poses = s.poses},
        {.name = "wobble, LED 70 %", .led = kLedLoss, .parts = s.good, .poses = s.poses},
        {.name = "speck", .flaw = Flaw::speck, .size = kSpeckRadius, .parts = s.good, .poses = s.poses},
        {.name = "haze", .flaw = Flaw::haze, .size = kHazeRadius, .parts = s.good, .poses = s.poses},
    };
    for (const Figure& figure : figures) {
        if (auto done = judge(production, figure); !done) return tl::unexpected(done.error());
    }
    if (auto done = judge_light_levels(); !done) return tl::unexpected(done.error());
    if (auto done = judge_strips(); !done) return tl::unexpected(done.error());
    if (auto done = measure_contrasts(); !done) return tl::unexpected(done.error());
    note("time at the paper's size");
    auto times = value("times", [&] { return measure_times(options_); });
    if (!times) return tl::unexpected(times.error());
    results_.times = *times;
    if (auto done = judge_traced(production); !done) return tl::unexpected(done.error());
    if (only_finished_ && std::ranges::all_of(results_.parts, [](const auto& figure) { return figure.second.empty(); }))
        return fail(ErrorCode::invalid_argument, "no figure is finished", "let the experiment run on");
    options_.progress(1, "");
    return std::move(results_);
}

Result<ExperimentReport> run_or_report(const ExperimentOptions& options, bool only_finished) {
    auto cells = ResultCache::open(options.out / "cells.jsonl",
                                   {{"experiment", "detection"},
                                    {"quick", options.quick},
                                    {"seed", options.seed},
                                    {"tuned_limits", options.tuned_limits},
                                    {"form", 6}});
    if (!cells) return tl::unexpected(cells.error());
    auto results = Run(options, *cells, only_finished).run();
    if (!results) return tl::unexpected(results.error());
    return report_detection(*results, options);
}

}  // namespace

Result<ExperimentReport> run_detection(const ExperimentOptions& options) { return run_or_report(options, false); }
Result<ExperimentReport> report_finished_detection(const ExperimentOptions& options) {
    return run_or_report(options, true);
}

}  // namespace hord::lab
