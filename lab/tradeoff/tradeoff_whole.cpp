#include "lab/tradeoff/tradeoff_whole.h"

#include <algorithm>
#include <cmath>
#include <fstream>

#include <fmt/format.h>

#include "hal_sim/optics/trace/trace.h"
#include "hal_sim/world/random.h"
#include "lab/design/whole_parts.h"
#include "lab/detection/detection_parts.h"
#include "lab/experiment/scenes.h"
#include "lab/report/cpu_time.h"
#include "lab/report/statistics.h"
#include "lab/report/template.h"
#include "lab/tradeoff/tradeoff_whole_report.h"

namespace hord::lab {
namespace {

constexpr CellChoice kCell{9, 0.015, 1, 0.61, 1};
constexpr double kFalseRejects = 1e-3, kMargin = 1.05;  // as lab/design/whole_parts.cpp
constexpr std::uint64_t kOtherSeed = 1000;
enum Draw : std::uint64_t { kLimits = 0x3A1, kGood = 0x3A2, kBad = 0x3A3 };

// Fewer of the largest parts, which take most time.
WholeEffort effort_of(const WholePoint& point) {
    if (point.lenslets < kCountedLenslets) return {8, 8, 1, 1};
    return point.lenslets > 222 ? WholeEffort{8, 2, 2, 1} : WholeEffort{8, 8, 2, 3};
}

struct NamedRecipe {
    std::string name;
    algo::Recipe recipe;
};
struct Judge {
    std::string name;
    algo::Pipeline pipeline;
    Json found;
};

class WholeTrade {
  public:
    WholeTrade(const WholePoint& point, const WholeEffort& effort, int threads,
               const std::function<void(double)>& progress)
        : point_(point), effort_(effort), progress_(progress) {
        task_.part = lens_scene(point.lenslets);
        task_.camera.pixels = std::pow(point.lenslets * kCell.bins, 2);
        task_.seed = point.seed;
        task_.threads = threads;
        steps_ = effort.poses + effort.judged_poses + static_cast<double>(kWholeLadders.size() * 4) * effort.places;
    }

    Result<Json> run(const std::filesystem::path& frames) {
        auto survey = PartSurvey::of(task_.part);
        if (!survey) return tl::unexpected(survey.error());
        survey_ = std::move(*survey);
        auto recipes = recipes_of_good_parts();
        if (!recipes) return tl::unexpected(recipes.error());
        const sim::Scene scene = good(task_.seed, 0);
        for (const NamedRecipe& r : *recipes) {
            auto pipeline = algo::Pipeline::create(scene.camera.extents, scene.camera.bits, r.recipe);
            if (!pipeline) return tl::unexpected(pipeline.error());
            judges_.push_back({r.name, std::move(*pipeline), {{"good", 0}, {"rejected", 0}, {"ms", Json::array()}}});
        }
        if (auto done = judge_parts(); !done) return tl::unexpected(done.error());
        if (!frames.empty()) {
            if (auto done = write_frames(frames, *recipes); !done) return tl::unexpected(done.error());
        }
        Json all;
        for (Judge& judge : judges_) all[judge.name] = std::move(judge.found);
        return all;
    }

  private:
    void step() { progress_(std::min(1.0, ++done_ / steps_)); }

    [[nodiscard]] sim::Scene good(std::uint64_t seed, int k) const {
        sim::Scene scene = good_part(kCell, task_, seed, k);
        scene.camera.extents.m = scene.camera.extents.n = point_.lenslets;  // even numbers, too
        return scene;
    }
    [[nodiscard]] std::uint64_t noise(Draw stream, int part, int exposure) const {
        return sim::random_bits(task_.seed, stream + (static_cast<std::uint64_t>(part) << 16U),
                                static_cast<std::uint64_t>(exposure));
    }

    Result<std::vector<NamedRecipe>> recipes_of_good_parts() {
        std::vector<Frame> frames;
        std::array<std::vector<double>, kPartValues> values;
        const sim::Scene first = good(task_.seed, 0);
        auto measure = FrameValues::create(first.camera.extents, first.camera.bits, task_.base);
        if (!measure) return tl::unexpected(measure.error());
        for (int k = 0; k < effort_.poses; ++k, step()) {
            const sim::Scene scene = good(task_.seed, k);
            const auto field = sim::render(scene, {task_.threads, {}});
            if (!field) return tl::unexpected(field.error());
            for (int x = 0; x < effort_.exposures; ++x) {
                frames.push_back(sim::expose(*field, scene, noise(kLimits, k, x)));
                const auto of = measure->of(frames.back().view());
                if (!of) return tl::unexpected(of.error());
                for (std::size_t v = 0; v < kPartValues; ++v) values[v].push_back((*of)[v]);
            }
        }
        PartValues limits{};
        for (std::size_t v = 0; v < kPartValues; ++v) {
            const double largest = *std::ranges::max_element(values[v]);
            limits[v] = std::max({gumbel_limit(values[v], kFalseRejects), kMargin * largest, 1e-3});
        }
        std::vector<NamedRecipe> recipes;
        for (const JudgedSet& set : judged_sets()) recipes.push_back({set.name(), recipe_of(set, limits, task_.base)});
        auto reference = learn_as_a_user(first.camera, frames);
        if (!reference) return tl::unexpected(reference.error());
        algo::Recipe against = task_.base;
        against.reference = std::move(*reference);
        recipes.push_back({"reference, with emd", against});
        against.gradient.reset();
        recipes.push_back({"reference", against});
        return recipes;
    }

    // The verdict of every recipe on one frame. Another recipe is the first for each frame: it finds the frame cold.
    Result<std::vector<algo::Verdict>> verdicts_on(const Frame& frame) {
        std::vector<algo::Verdict> verdicts(judges_.size());
        ++judged_;
        for (std::size_t k = 0; k < judges_.size(); ++k) {
            const std::size_t j = (judged_ + k) % judges_.size();
            Judge& judge = judges_[j];
            if (judge.found["ms"].empty()) {  // the first one warms up
                if (const auto warm = judge.pipeline.inspect(frame.view()); !warm) return tl::unexpected(warm.error());
            }
            const auto start = thread_cpu_time();
            const auto found = judge.pipeline.inspect(frame.view());
            const auto took = thread_cpu_time() - start;
            if (!found) return tl::unexpected(found.error());
            judge.found["ms"].push_back(std::chrono::duration<double, std::milli>(took).count());
            verdicts[j] = found->verdict;
        }
        return verdicts;
    }

    struct BadPart {
        WholeLadder ladder;
        double size_mm = 0;
        Place place;
        int number = 0;
    };
    Result<std::vector<BadPart>> bad_parts() {
        std::vector<BadPart> bad;
        const double pitch = task_.part.camera.field_mm / point_.lenslets;
        for (const WholeLadder& ladder : kWholeLadders) {
            for (const double size : ladder.sizes_mm) {
                const auto places =
                    draw_places(survey_, task_.part, reach_mm(ladder.kind, size) + 6 * pitch,
                                static_cast<std::size_t>(effort_.places), task_.seed + kOtherSeed + bad.size());
                if (!places) return tl::unexpected(places.error());
                for (const Place& place : *places) bad.push_back({ladder, size, place, static_cast<int>(bad.size())});
            }
        }
        return bad;
    }

    Result<void> judge_parts() {
        const auto bad = bad_parts();
        if (!bad) return tl::unexpected(bad.error());
        for (int k = 0; k < effort_.judged_poses; ++k, step()) {
            const sim::Scene scene = good(task_.seed + kOtherSeed, k);
            const auto field = sim::render(scene, {task_.threads, {}});
            if (!field) return tl::unexpected(field.error());
            for (int x = 0; x < effort_.exposures; ++x) {
                const Frame frame = sim::expose(*field, scene, noise(kGood, k, x));
                const auto verdicts = verdicts_on(frame);
                if (!verdicts) return tl::unexpected(verdicts.error());
                for (std::size_t j = 0; j < judges_.size(); ++j) {
                    Json& found = judges_[j].found;
                    found["good"] = found["good"].get<int>() + 1;
                    if ((*verdicts)[j] != algo::Verdict::pass) found["rejected"] = found["rejected"].get<int>() + 1;
                }
                if (!good_frame_) good_frame_ = frame;
            }
            for (const BadPart& part : *bad) {
                if (part.number % effort_.judged_poses != k) continue;
                if (auto done = judge_bad(part, scene, *field); !done) return done;
                step();
            }
        }
        return {};
    }

    Result<void> judge_bad(const BadPart& part, const sim::Scene& scene, const sim::LightField& field) {
        const algo::Extents& e = scene.camera.extents;
        const double pitch = scene.camera.field_mm / e.m;
        auto defect = make_defect(part.ladder.kind, part.size_mm, scene, survey_.body, part.place.x_mm, part.place.y_mm,
                                  part.place.turn_rad);
        if (!defect) return tl::unexpected(defect.error());
        const sim::Landing landing = sim::shine(survey_.body, part.place.x_mm, part.place.y_mm);
        const int m = static_cast<int>(std::lround((landing.x + scene.pose.x_mm) / pitch + 0.5 * (e.m - 1))),
                  n = static_cast<int>(std::lround((landing.y + scene.pose.y_mm) / pitch + 0.5 * (e.n - 1)));
        const int half = static_cast<int>(std::ceil(1.25 * reach_mm(part.ladder.kind, part.size_mm) / pitch)) + 4;
        sim::Scene window = window_of(scene, m, n, 2 * half + 1);
        window.defects = {*defect};
        const auto light = sim::render(window, {task_.threads, {}});
        if (!light) return tl::unexpected(light.error());
        sim::LightField whole = field;
        paste(whole, *light, m, n);
        Frame frame = sim::expose(whole, scene, noise(kBad, part.number, 0));
        const auto verdicts = verdicts_on(frame);
        if (!verdicts) return tl::unexpected(verdicts.error());
        for (std::size_t j = 0; j < judges_.size(); ++j) {
            Json& rows = judges_[j].found[std::string(WantedDefect{part.ladder.kind, 0}.name())];
            if (rows.empty() || rows.back()[0].get<double>() != part.size_mm) rows.push_back({part.size_mm, 0, 0});
            Json& row = rows.back();
            row[1] = row[1].get<int>() + ((*verdicts)[j] == algo::Verdict::pass ? 1 : 0);
            row[2] = row[2].get<int>() + 1;
        }
        bad_frame_ = std::move(frame);
        return {};
    }

    // NAME.raw: 16-bit samples, row by row. recipes.txt: one a line, see tests/bench/arm64/inspect_frames.cpp.
    Result<void> write_frames(const std::filesystem::path& folder, const std::vector<NamedRecipe>& recipes) {
        std::error_code error;
        std::filesystem::create_directories(folder, error);
        for (const auto& [name, frame] : {std::pair("good.raw", &good_frame_), std::pair("bad.raw", &bad_frame_)}) {
            const auto bytes = (*frame)->bytes();
            std::ofstream stream(folder / name, std::ios::binary);
            stream.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
            if (!stream.flush())
                return fail(ErrorCode::io, (folder / name).string() + " cannot be written", "check the folder");
        }
        std::ofstream stream(folder / "recipes.txt");
        for (const NamedRecipe& r : recipes) {
            if (r.recipe.reference) continue;
            stream << fmt::format(
                "{} {} {} {} {} {} {} {}\n", r.recipe.gradient ? std::string(name_of(*r.recipe.gradient)) : "none",
                r.recipe.emd_limit_bins, r.recipe.gradient_limit, r.recipe.slopes ? 1 : 0,
                r.recipe.frobenius_limit_bins, r.recipe.light ? 1 : 0, r.recipe.transmission_limit, r.name);
        }
        if (stream.flush()) return {};
        return fail(ErrorCode::io, (folder / "recipes.txt").string() + " cannot be written", "check the folder");
    }

    WholePoint point_;
    WholeEffort effort_;
    const std::function<void(double)>& progress_;
    DesignTask task_;
    PartSurvey survey_;
    std::vector<Judge> judges_;
    std::size_t judged_ = 0;  // frames
    std::optional<Frame> good_frame_, bad_frame_;
    double steps_ = 1, done_ = 0;
};

}  // namespace

namespace {

Result<ExperimentReport> whole_trade(const ExperimentOptions& options, bool finished_only) {
    auto cells =
        ResultCache::open(options.out / "cells.jsonl",
                          {{"experiment", "whole"}, {"quick", options.quick}, {"seed", options.seed}, {"form", 1}});
    if (!cells) return tl::unexpected(cells.error());
    std::vector<WholePoint> points;
    if (options.quick) points = {{55, options.seed}};
    else {
        for (const int lenslets : {111, 222, 555}) {
            for (std::uint64_t k = 0; k < kWholeSeeds; ++k) points.push_back({lenslets, options.seed + k});
        }
    }
    std::vector<JudgedWhole> judged;
    std::string missing;
    for (const WholePoint& point : points) {
        if (finished_only && cells->find(point.key()) == nullptr) {
            missing += (missing.empty() ? "" : "; ") + point.key();
            continue;
        }
        const std::function<void(double)> note = [&](double part) {
            options.progress((static_cast<double>(judged.size()) + part) / static_cast<double>(points.size()),
                             point.key());
        };
        auto cell = cells->value(point.key(), [&] {
            const bool is_counted = point.lenslets == kCountedLenslets && point.seed == options.seed;
            return judge_whole_parts(point, effort_of(point), options.threads,
                                     is_counted ? options.out / "arm64" : std::filesystem::path(), note);
        });
        if (!cell) return tl::unexpected(cell.error());
        judged.push_back({point, std::move(*cell)});
    }
    ExperimentReport report;
    TemplateFields fields{
        {"quick", options.quick ? "yes" : ""}, {"seed", std::to_string(options.seed)}, {"missing", missing}};
    add_wholes(fields, judged, options.out / "arm64" / "instructions.csv");
    report.text = fill_report("whole", fields);
    options.progress(1, "");
    return report;
}

}  // namespace

Result<ExperimentReport> run_whole(const ExperimentOptions& options) { return whole_trade(options, false); }
Result<ExperimentReport> report_finished_whole(const ExperimentOptions& options) { return whole_trade(options, true); }

std::string WholePoint::key() const { return fmt::format("whole {} lenslets, seed {}", lenslets, seed); }

Result<Json> judge_whole_parts(const WholePoint& point, const WholeEffort& effort, int threads,
                               const std::filesystem::path& frames, const std::function<void(double)>& progress) {
    return WholeTrade(point, effort, threads, progress).run(frames);
}

}  // namespace hord::lab
