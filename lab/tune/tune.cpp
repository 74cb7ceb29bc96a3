#include "lab/tune/tune.h"

#include <algorithm>
#include <chrono>
#include <deque>

#include <fmt/format.h>

#include "algo/frame/decode.h"
#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "lab/report/cpu_time.h"
#include "lab/tune/measured_part.h"
#include "lab/tune/set_limits.h"
#include "lab/tune/worst_value.h"

namespace hord::lab {

using namespace firmware;

namespace {

constexpr int kRounds = 25;              // timed inspections of each set
constexpr std::size_t kTimedFrames = 5;  // good frames, kept for the timing
constexpr double kUnregistered = 1000;   // score of a part in which the reference is not found: above any other

double wall_ms() {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class Tuner {
  public:
    explicit Tuner(const TuneOptions& options) : options_(options) {
        tuned_.budget_ms = options.budget_ms;
        tuned_.false_rejects = options.false_rejects;
        tuned_.threads = options.threads;
    }
    Result<Tuned> run(const std::vector<std::string>& good, const std::vector<std::string>& bad);

  private:
    Result<void> open_pipelines(const std::string& first);
    Result<Frame> read(const std::string& file) const;
    Result<void> measure_frame(const std::string& file, bool bad);
    Result<void> number_parts();
    void set_limits();
    Result<void> measure_times();
    void choose();
    Result<void> judge_with_choice();

    const TuneOptions& options_;
    std::string first_;
    std::vector<algo::Pipeline> plain_pipelines_, reference_pipelines_;  // the first give maps, the others scores
    std::optional<WorstValue> worst_;
    std::optional<algo::DistinctParts> distinct_good_, distinct_bad_;  // of the frames measured
    std::vector<MeasuredPart> parts_;
    std::vector<Frame> timed_;
    std::vector<std::vector<ScoredPlace>> scored_;  // by feature set
    Tuned tuned_;
};

Result<Frame> Tuner::read(const std::string& file) const {
    auto frame = options_.read(file);
    if (!frame || first_.empty()) return frame;
    if (frame->width_px() != tuned_.extents.width_px() || frame->height_px() != tuned_.extents.height_px() ||
        frame->bits() != tuned_.bits) {
        return fail(ErrorCode::invalid_argument, file + " is not of the size and depth of " + first_,
                    "give frames of one camera");
    }
    return frame;
}

Result<void> Tuner::open_pipelines(const std::string& first) {
    const auto frame = read(first);
    if (!frame) return tl::unexpected(frame.error());
    const auto extents =
        algo::extents_of_frame(frame->width_px(), frame->height_px(), options_.bins.first, options_.bins.second);
    if (!extents) return fail(extents.error().code, first + ": " + extents.error().what, extents.error().cure);
    first_ = first;
    tuned_.extents = *extents;
    tuned_.bits = frame->bits();
    worst_.emplace(*extents, options_.base.recipe);
    for (auto* distinct : {&distinct_good_, &distinct_bad_})
        distinct->emplace(*extents, algo::light_levels(options_.base.recipe, tuned_.bits).dark);
    const auto add = [&](const FeatureSet& set, std::vector<algo::Pipeline>& to) -> Result<void> {
        auto pipeline = algo::Pipeline::create(*extents, tuned_.bits, recipe_of(set, options_.base.recipe),
                                               options_.threads, algo::MapSet::exact);
        if (!pipeline) return tl::unexpected(pipeline.error());
        to.push_back(std::move(*pipeline));
        return {};
    };
    for (const algo::Feature gradient : algo::kJudgedGradients) {
        const bool others = gradient == algo::Feature::emd;  // its pipeline gives the maps of slopes and light, too
        if (auto done = add({gradient, others, others, false}, plain_pipelines_); !done) return done;
    }
    for (const FeatureSet& set : feature_sets(options_.base.recipe.reference != nullptr)) {
        tuned_.feature_sets.push_back({.set = set});
        if (!set.reference) continue;
        if (auto done = add(set, reference_pipelines_); !done) return done;
    }
    return {};
}

Result<void> Tuner::measure_frame(const std::string& file, bool bad) {
    auto frame = read(file);
    if (!frame) return tl::unexpected(frame.error());
    const auto named = [&](const Error& error) {
        return tl::unexpected(Error{error.code, file + ": " + error.what, error.cure});
    };
    MeasuredPart part;
    part.file = file;
    part.bad = bad;
    for (std::size_t g = 0; g < kGradients; ++g) {
        const auto inspection = plain_pipelines_[g].inspect(frame->view());
        if (!inspection) return named(inspection.error());
        if (inspection->verdict == algo::Verdict::unfit) {
            tuned_.left_out.push_back({file, fmt::format("not judged: {}", name_of(inspection->reason))});
            return {};
        }
        const auto worst = worst_->of_gradient(inspection->gradient, inspection->mask);
        if (!worst) return named(worst.error());
        part.values[g] = *worst;
        if (g != 0) continue;
        const auto slopes = worst_->of_gradient(inspection->frobenius, inspection->mask),
                   light = worst_->of_light(inspection->transmission, inspection->mask);
        if (!slopes) return named(slopes.error());
        if (!light) return named(light.error());
        part.values[kSlopes] = *slopes;
        part.values[kLight] = *light;
    }
    bool registered = true;
    for (algo::Pipeline& pipeline : reference_pipelines_) {
        const auto inspection = pipeline.inspect(frame->view());
        if (!inspection) return named(inspection.error());
        const bool found = inspection->verdict != algo::Verdict::unfit;
        part.by_lenslets.push_back(found ? static_cast<double>(inspection->by_lenslets) : kUnregistered);
        part.together.push_back(found ? static_cast<double>(inspection->together) : kUnregistered);
        part.registered.push_back(found);
        registered = registered && found;
    }
    (bad ? distinct_bad_ : distinct_good_)->add(frame->view());
    if (!bad && !registered) ++tuned_.unregistered;
    if (!bad && timed_.size() < kTimedFrames) timed_.push_back(std::move(*frame));
    ++(bad ? tuned_.bad : tuned_.good);
    parts_.push_back(std::move(part));
    return {};
}

// Numbers the parts: copies and repeated exposures of one have its number. Fails if the frames show too few.
Result<void> Tuner::number_parts() {
    tuned_.parts = distinct_good_->groups();
    tuned_.bad_parts = distinct_bad_->groups();
    std::size_t good = 0, bad = 0;
    for (MeasuredPart& part : parts_) {
        part.number = static_cast<std::uint32_t>(part.bad ? tuned_.parts.parts + tuned_.bad_parts.part_of[bad++]
                                                          : tuned_.parts.part_of[good++]);
    }
    for (const bool of_bad : {false, true}) {
        const auto& groups = of_bad ? tuned_.bad_parts : tuned_.parts;
        const std::size_t least = of_bad ? kMinBad : kMinGood;
        if (groups.parts >= least) continue;
        const char* what = of_bad ? "bad" : "good";
        return fail(ErrorCode::invalid_argument,
                    fmt::format("of the {} parts, {} At least {} distinct {} parts are needed", what, describe(groups),
                                least, what),
                    fmt::format("give frames of at least {} more, each of another part or of one that was placed anew",
                                least - groups.parts));
    }
    return {};
}

void Tuner::set_limits() {
    const LimitSetter setter(options_, parts_, tuned_.parts.at_least);
    std::size_t reference_index = 0;
    for (MeasuredFeatureSet& measured : tuned_.feature_sets) {
        scored_.push_back(setter.set(measured, reference_index));
        reference_index += measured.set.reference ? 1U : 0U;
    }
}

Result<void> Tuner::measure_times() {
    plain_pipelines_.clear(), reference_pipelines_.clear();
    std::deque<algo::Pipeline> pipelines;
    for (const MeasuredFeatureSet& measured : tuned_.feature_sets) {
        // Limits do not change the time: sets without limits are timed with those of the base recipe.
        auto pipeline = algo::Pipeline::create(
            tuned_.extents, tuned_.bits,
            measured.no_limit.empty() ? measured.recipe.recipe : recipe_of(measured.set, options_.base.recipe),
            options_.threads);
        if (!pipeline) return tl::unexpected(pipeline.error());
        pipelines.push_back(std::move(*pipeline));
    }
    std::vector<std::vector<double>> wall(pipelines.size()), processor(pipelines.size());
    for (int round = -1; round < kRounds; ++round) {  // round -1 warms up
        options_.progress(0.6 + 0.2 * (round + 1) / (kRounds + 1), "timing");
        const FrameView frame = timed_[static_cast<std::size_t>(round + 1) % timed_.size()].view();
        for (std::size_t k = 0; k < pipelines.size(); ++k) {
            const double processor_before = process_cpu_ms(), wall_before = wall_ms();
            const auto inspection = pipelines[k].inspect(frame);
            const double wall_after = wall_ms(), processor_after = process_cpu_ms();
            if (!inspection) return tl::unexpected(inspection.error());
            if (round < 0) continue;
            wall[k].push_back(wall_after - wall_before);
            processor[k].push_back(processor_after - processor_before);
        }
    }
    for (std::size_t k = 0; k < pipelines.size(); ++k) {
        MeasuredFeatureSet& measured = tuned_.feature_sets[k];
        measured.wall_ms = quantile(wall[k], 0.5);
        measured.processor_ms = quantile(processor[k], 0.5);
        measured.fits = measured.no_limit.empty() && measured.wall_ms <= options_.budget_ms;
    }
    return {};
}

void Tuner::choose() {
    auto& all = tuned_.feature_sets;
    for (std::size_t k = 0; k < all.size(); ++k) {
        if (!all[k].fits) continue;
        const auto better = [&](const MeasuredFeatureSet& than) {  // of two equal ones the faster
            return all[k].auc.value != than.auc.value ? all[k].auc.value > than.auc.value
                                                      : all[k].wall_ms < than.wall_ms;
        };
        if (!tuned_.best || better(all[*tuned_.best])) tuned_.best = k;
    }
    if (!tuned_.best) return;
    // 1e-9: a difference of exactly kAsGood counts as within it, in spite of rounding.
    const auto as_good = [&](const MeasuredFeatureSet& m) {
        return m.fits && all[*tuned_.best].auc.value - m.auc.value <= kAsGood + 1e-9;
    };
    double fastest = all[*tuned_.best].wall_ms;
    for (std::size_t k = 0; k < all.size(); ++k) {
        all[k].behind = auc_difference(scored_[*tuned_.best], scored_[k], kBootstraps, kBootstrapSeed);
        if (as_good(all[k])) fastest = std::min(fastest, all[k].wall_ms);
    }
    if (all[*tuned_.best].auc.value <= kGuessing) return;
    const auto simpler = [&](const MeasuredFeatureSet& a, const MeasuredFeatureSet& b) {
        return std::pair(a.set.features(), a.wall_ms) < std::pair(b.set.features(), b.wall_ms);
    };
    for (std::size_t k = 0; k < all.size(); ++k) {
        if (!as_good(all[k]) || all[k].wall_ms > (1 + kAsFast) * fastest) continue;
        if (!tuned_.chosen || simpler(all[k], all[*tuned_.chosen])) tuned_.chosen = k;
    }
}

// Judges every frame with the chosen recipe as a station will read it, for the counts of the report.
Result<void> Tuner::judge_with_choice() {
    if (!tuned_.chosen) return {};
    MeasuredFeatureSet& chosen = tuned_.feature_sets[*tuned_.chosen];
    const auto recipe = parse_numbered_recipe(format_recipe(chosen.recipe), "the recipe");
    if (!recipe) return tl::unexpected(recipe.error());
    auto pipeline = algo::Pipeline::create(tuned_.extents, tuned_.bits, recipe->recipe, options_.threads);
    if (!pipeline) return tl::unexpected(pipeline.error());
    chosen.found = chosen.rejected = 0;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        options_.progress(0.8 + 0.2 * static_cast<double>(k) / static_cast<double>(parts_.size()), "judging again");
        const auto frame = read(parts_[k].file);
        if (!frame) return tl::unexpected(frame.error());
        const auto inspection = pipeline->inspect(frame->view());
        if (!inspection) return tl::unexpected(inspection.error());
        if (inspection->verdict != algo::Verdict::pass) ++(parts_[k].bad ? chosen.found : chosen.rejected);
    }
    return {};
}

Result<Tuned> Tuner::run(const std::vector<std::string>& good, const std::vector<std::string>& bad) {
    const auto enough = [](std::size_t count, std::size_t least, const char* what) -> Result<void> {
        if (count >= least) return {};
        return fail(ErrorCode::invalid_argument,
                    fmt::format("{} frame{} of {} parts", count, count == 1 ? "" : "s", what),
                    fmt::format("give at least {}, of as many parts", least));
    };
    for (const bool of_bad : {false, true}) {
        if (auto fine = enough(of_bad ? bad.size() : good.size(), of_bad ? kMinBad : kMinGood, of_bad ? "bad" : "good");
            !fine)
            return tl::unexpected(fine.error());
    }
    if (auto ready = open_pipelines(good.front()); !ready) return tl::unexpected(ready.error());
    const double total = static_cast<double>(good.size() + bad.size());
    std::size_t done = 0;
    for (const bool of_bad : {false, true}) {
        for (const std::string& file : of_bad ? bad : good) {
            options_.progress(0.6 * static_cast<double>(done++) / total, file);
            if (auto measured = measure_frame(file, of_bad); !measured) return tl::unexpected(measured.error());
        }
    }
    for (const bool of_bad : {false, true}) {
        if (auto fine = enough(of_bad ? tuned_.bad : tuned_.good, of_bad ? kMinBad : kMinGood, of_bad ? "bad" : "good");
            !fine) {
            const LeftOut& one = tuned_.left_out.front();
            return fail(ErrorCode::invalid_argument,
                        fmt::format("{} that can be judged ({}: {})", fine.error().what, one.file, one.why),
                        fine.error().cure);
        }
    }
    if (auto enough_parts = number_parts(); !enough_parts) return tl::unexpected(enough_parts.error());
    set_limits();
    if (auto timed = measure_times(); !timed) return tl::unexpected(timed.error());
    choose();
    if (auto judged = judge_with_choice(); !judged) return tl::unexpected(judged.error());
    return std::move(tuned_);
}

}  // namespace

std::string FeatureSet::name() const {
    std::string text;
    const auto add = [&](std::string_view feature) { text += fmt::format("{}{}", text.empty() ? "" : " + ", feature); };
    if (reference) add("reference");
    if (gradient) add(name_of(*gradient));
    if (slopes) add(name_of(algo::Feature::jacobian_frobenius));
    if (light) add(name_of(algo::Feature::transmission));
    return text;
}

std::vector<FeatureSet> feature_sets(bool with_reference) {
    std::vector<FeatureSet> all = {{{}, false, true, false}, {{}, true, false, false}, {{}, true, true, false}};
    for (const algo::Feature gradient : algo::kJudgedGradients) {
        all.push_back({gradient, false, false, false});
        all.push_back({gradient, true, true, false});
    }
    if (!with_reference) return all;
    all.push_back({{}, false, false, true});
    all.push_back({{}, true, false, true});
    all.push_back({algo::Feature::emd, true, false, true});
    return all;
}

Result<Tuned> tune(const std::vector<std::string>& good, const std::vector<std::string>& bad,
                   const TuneOptions& options) {
    return Tuner(options).run(good, bad);
}

}  // namespace hord::lab
