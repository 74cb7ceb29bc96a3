#include "lab/tune/tune.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <ctime>
#include <deque>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "algo/inspection/defects.h"
#include "algo/inspection/pipeline.h"

namespace hord::lab {
namespace {

constexpr int kRepeats = 1000;
constexpr std::uint64_t kSeed = 1;
constexpr int kTimed = 25;               // judgements of a frame that are timed, each rung
constexpr std::size_t kTimedFrames = 5;  // good ones, kept for that
constexpr double kUnregistered = 1000;  // score of a part that the reference does not find: worse than any that it does

// What a limit is set for: the gradients, then the others.
constexpr std::size_t kGradients = algo::kJudgedGradients.size(), kSlopes = kGradients, kLight = kGradients + 1,
                      kValues = kGradients + 2;
using Values = std::array<double, kValues>;

std::size_t place_of(algo::Feature gradient) {
    return static_cast<std::size_t>(std::ranges::find(algo::kJudgedGradients, gradient) -
                                    algo::kJudgedGradients.begin());
}

// Up, to three digits: a limit that people can read.
double rounded_up(double value) {
    const double unit = std::pow(10.0, std::floor(std::log10(value)) - 2);
    return std::ceil(value / unit - 1e-9) * unit;
}

double processor_ms() {
    timespec now{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}
double wall_ms() {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// The base recipe with a rung's features; limits are set later.
algo::Recipe recipe_of(const Rung& rung, const algo::Recipe& base) {
    const algo::Recipe usual;
    algo::Recipe recipe = base;
    recipe.gradient = rung.gradient;
    recipe.slopes = rung.slopes;
    recipe.light = rung.light;
    recipe.gradient_limit = rung.gradient && *rung.gradient != algo::Feature::emd ? 1.0F : 0.0F;
    if (rung.gradient != algo::Feature::emd || !rung.reference) recipe.emd_limit_bins = usual.emd_limit_bins;
    if (!rung.slopes || !rung.reference) recipe.frobenius_limit_bins = usual.frobenius_limit_bins;
    recipe.transmission_limit = usual.transmission_limit;
    if (!rung.reference) {
        recipe.reference.reset();
        recipe.tolerances.clear();
        recipe.reject_score = usual.reject_score, recipe.grow_score = usual.grow_score,
        recipe.cluster_score = usual.cluster_score;
    }
    return recipe;
}

// The worst value of a map: the limit at which the part would just be rejected. With a smallest area, that of a region
// as large.
class WorstValue {
  public:
    WorstValue(const algo::Extents& extents, const algo::Recipe& base) : extents_(extents), min_area_(base.min_area) {}

    Result<double> of_gradient(algo::Map map, std::span<const std::uint8_t> mask) {
        double worst = 0;
        for (std::size_t k = 0; k < map.size(); ++k) {
            if ((mask[k] & (algo::kNotJudged | algo::kNoGradient)) == 0)
                worst = std::max(worst, static_cast<double>(map[k]));
        }
        return of_a_region(worst, [&](algo::Recipe& recipe, float limit) {
            recipe.light = false;
            recipe.emd_limit_bins = limit;
            return algo::Features{map, {}, {}, mask};
        });
    }
    Result<double> of_light(algo::Map transmission, std::span<const std::uint8_t> mask) {
        double worst = 0;
        for (std::size_t k = 0; k < transmission.size(); ++k) {
            if ((mask[k] & (algo::kNotJudged | algo::kSaturated)) == 0)
                worst = std::max(worst, 1 - static_cast<double>(transmission[k]));
        }
        return of_a_region(worst, [&](algo::Recipe& recipe, float limit) {
            recipe.transmission_limit = 1 - limit;
            return algo::Features{{}, {}, transmission, mask};
        });
    }

  private:
    template <class With>
    Result<double> of_a_region(double worst, With with) {
        if (min_area_ <= 1 || worst <= 0) return worst;
        double low = 0, high = worst;  // regions shrink as the limit grows
        for (int step = 0; step < 12; ++step) {
            const double middle = (low + high) / 2;
            algo::Recipe recipe;
            recipe.min_area = min_area_;
            const algo::Features features = with(recipe, static_cast<float>(middle));
            const auto found = algo::DefectFinder(extents_, recipe).find(features);
            if (!found) return tl::unexpected(found.error());
            (found->defects.empty() ? high : low) = middle;
        }
        return high;
    }
    algo::Extents extents_;
    std::uint32_t min_area_;
};

// What was measured of a part.
struct Part {
    std::string file;
    bool bad = false;
    Values values{};
    std::vector<double> scores;  // of the rungs with a reference, in their order
    std::vector<bool> registered;
};

class Tuner {
  public:
    explicit Tuner(const TuneOptions& options) : options_(options) {
        tuned_.budget_ms = options.budget_ms;
        tuned_.false_rejects = options.false_rejects;
        tuned_.threads = options.threads;
    }
    Result<Tuned> run(const std::vector<std::string>& good, const std::vector<std::string>& bad);

  private:
    Result<void> set_up(const std::string& first);
    Result<Frame> read(const std::string& file) const;
    Result<void> look_at(const std::string& file, bool bad);
    [[nodiscard]] Values limits() const;
    void set_limits(RungMeasured& measured, const Values& limits, std::size_t of_reference);
    Result<void> time_them();
    void choose();
    Result<void> judge_again();

    const TuneOptions& options_;
    std::string first_;
    std::vector<algo::Pipeline> without_, with_;  // whose maps, and whose scores, are looked at
    std::optional<WorstValue> worst_;
    std::vector<Part> parts_;
    std::vector<Frame> timed_;
    std::vector<std::vector<Scored>> scored_;  // of every rung
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

Result<void> Tuner::set_up(const std::string& first) {
    const auto frame = read(first);
    if (!frame) return tl::unexpected(frame.error());
    const auto extents =
        algo::extents_of_frame(frame->width_px(), frame->height_px(), options_.bins.first, options_.bins.second);
    if (!extents) return fail(extents.error().code, first + ": " + extents.error().what, extents.error().cure);
    first_ = first;
    tuned_.extents = *extents;
    tuned_.bits = frame->bits();
    worst_.emplace(*extents, options_.base.recipe);
    const auto add = [&](const Rung& rung, std::vector<algo::Pipeline>& to) -> Result<void> {
        auto pipeline =
            algo::Pipeline::create(*extents, tuned_.bits, recipe_of(rung, options_.base.recipe), options_.threads);
        if (!pipeline) return tl::unexpected(pipeline.error());
        to.push_back(std::move(*pipeline));
        return {};
    };
    for (const algo::Feature gradient : algo::kJudgedGradients) {
        const bool others = gradient == algo::Feature::emd;  // the others' maps come with it
        if (auto done = add({gradient, others, others, false}, without_); !done) return done;
    }
    for (const Rung& rung : rungs(options_.base.recipe.reference != nullptr)) {
        tuned_.rungs.push_back({.rung = rung});
        if (!rung.reference) continue;
        if (auto done = add(rung, with_); !done) return done;
    }
    return {};
}

Result<void> Tuner::look_at(const std::string& file, bool bad) {
    auto frame = read(file);
    if (!frame) return tl::unexpected(frame.error());
    const auto named = [&](const Error& error) {
        return tl::unexpected(Error{error.code, file + ": " + error.what, error.cure});
    };
    Part part;
    part.file = file;
    part.bad = bad;
    for (std::size_t g = 0; g < kGradients; ++g) {
        const auto seen = without_[g].inspect(frame->view());
        if (!seen) return named(seen.error());
        if (seen->verdict == algo::Verdict::unfit) {
            tuned_.left_out.push_back({file, fmt::format("not judged: {}", name_of(seen->reason))});
            return {};
        }
        const auto worst = worst_->of_gradient(seen->gradient, seen->mask);
        if (!worst) return named(worst.error());
        part.values[g] = *worst;
        if (g != 0) continue;
        const auto slopes = worst_->of_gradient(seen->frobenius, seen->mask),
                   light = worst_->of_light(seen->transmission, seen->mask);
        if (!slopes) return named(slopes.error());
        if (!light) return named(light.error());
        part.values[kSlopes] = *slopes;
        part.values[kLight] = *light;
    }
    bool registered = true;
    for (algo::Pipeline& pipeline : with_) {
        const auto seen = pipeline.inspect(frame->view());
        if (!seen) return named(seen.error());
        const bool found = seen->verdict != algo::Verdict::unfit;
        part.scores.push_back(found ? static_cast<double>(seen->score) : kUnregistered);
        part.registered.push_back(found);
        registered = registered && found;
    }
    if (!bad && !registered) ++tuned_.unregistered;
    if (!bad && timed_.size() < kTimedFrames) timed_.push_back(std::move(*frame));
    ++(bad ? tuned_.bad : tuned_.good);
    parts_.push_back(std::move(part));
    return {};
}

// Of each feature, from the good parts.
Values Tuner::limits() const {
    Values limits{};
    for (std::size_t v = 0; v < kValues; ++v) {
        std::vector<double> good;
        for (const Part& part : parts_) {
            if (!part.bad) good.push_back(part.values[v]);
        }
        const double highest = *std::ranges::max_element(good);
        limits[v] = rounded_up(std::max({gumbel_limit(good, options_.false_rejects), (1 + kMargin) * highest, 1e-3}));
    }
    return limits;
}

// The recipe of a rung with its limits; or why it has none.
void Tuner::set_limits(RungMeasured& measured, const Values& limits, std::size_t of_reference) {
    const Rung& rung = measured.rung;
    measured.recipe = options_.base;
    measured.recipe.recipe = recipe_of(rung, options_.base.recipe);
    algo::Recipe& recipe = measured.recipe.recipe;
    double factor = 1;
    if (rung.reference) {
        std::vector<double> good;
        for (const Part& part : parts_) {
            if (!part.bad && part.registered[of_reference]) good.push_back(part.scores[of_reference]);
        }
        if (good.size() < kMinGood) {
            measured.no_limit = fmt::format("the reference finds only {} of the good parts", good.size());
        } else {
            factor = rounded_up(std::max(
                {gumbel_limit(good, options_.false_rejects), (1 + kMargin) * *std::ranges::max_element(good), 1e-3}));
        }
        const auto scale = [&](float& limit) { limit = static_cast<float>(static_cast<double>(limit) * factor); };
        scale(recipe.reject_score), scale(recipe.grow_score), scale(recipe.cluster_score);
        if (rung.gradient) scale(recipe.emd_limit_bins);
        if (rung.slopes) scale(recipe.frobenius_limit_bins);
    } else {
        measured.recipe.reference_file.clear();
        if (rung.gradient)
            (*rung.gradient == algo::Feature::emd ? recipe.emd_limit_bins : recipe.gradient_limit) =
                static_cast<float>(limits[place_of(*rung.gradient)]);
        if (rung.slopes) recipe.frobenius_limit_bins = static_cast<float>(limits[kSlopes]);
        if (rung.light) {
            recipe.transmission_limit = static_cast<float>(std::max(0.0, 1 - limits[kLight]));
            if (limits[kLight] >= 0.999)
                measured.no_limit =
                    "good parts have places without light, or nearly: no limit of the transmission lets them pass";
        }
    }
    if (measured.no_limit.empty()) {
        if (auto readable = parse_numbered_recipe(format_recipe(measured.recipe), "limit"); !readable)
            measured.no_limit = readable.error().what;
    }
    // Scores and what they come to at the limits.
    std::vector<Scored> scored;
    for (const Part& part : parts_) {
        double score = 0;
        if (rung.reference) {
            score = part.scores[of_reference] / factor;
        } else {
            if (rung.gradient) score = part.values[place_of(*rung.gradient)] / limits[place_of(*rung.gradient)];
            if (rung.slopes) score = std::max(score, part.values[kSlopes] / limits[kSlopes]);
            if (rung.light) score = std::max(score, part.values[kLight] / limits[kLight]);
        }
        scored.push_back({static_cast<float>(score), static_cast<std::uint32_t>(scored.size()), part.bad});
        if (score >= 1) ++(part.bad ? measured.found : measured.rejected);
    }
    measured.auc = detection_of(scored, 0, kRepeats, kSeed).auc;
    scored_.push_back(std::move(scored));
}

Result<void> Tuner::time_them() {
    without_.clear(), with_.clear();
    std::deque<algo::Pipeline> pipelines;
    for (const RungMeasured& measured : tuned_.rungs) {
        // Limits do not change the time; those without are timed with the base recipe's.
        auto pipeline = algo::Pipeline::create(
            tuned_.extents, tuned_.bits,
            measured.no_limit.empty() ? measured.recipe.recipe : recipe_of(measured.rung, options_.base.recipe),
            options_.threads);
        if (!pipeline) return tl::unexpected(pipeline.error());
        pipelines.push_back(std::move(*pipeline));
    }
    std::vector<std::vector<double>> wall(pipelines.size()), processor(pipelines.size());
    for (int round = -1; round < kTimed; ++round) {  // the first warms up
        options_.progress(0.6 + 0.2 * (round + 1) / (kTimed + 1), "timing");
        const FrameView frame = timed_[static_cast<std::size_t>(round + 1) % timed_.size()].view();
        for (std::size_t k = 0; k < pipelines.size(); ++k) {
            const double processor_before = processor_ms(), wall_before = wall_ms();
            const auto seen = pipelines[k].inspect(frame);
            const double wall_after = wall_ms(), processor_after = processor_ms();
            if (!seen) return tl::unexpected(seen.error());
            if (round < 0) continue;
            wall[k].push_back(wall_after - wall_before);
            processor[k].push_back(processor_after - processor_before);
        }
    }
    for (std::size_t k = 0; k < pipelines.size(); ++k) {
        RungMeasured& measured = tuned_.rungs[k];
        measured.wall_ms = quantile(wall[k], 0.5);
        measured.processor_ms = quantile(processor[k], 0.5);
        measured.fits = measured.no_limit.empty() && measured.wall_ms <= options_.budget_ms;
    }
    return {};
}

void Tuner::choose() {
    auto& all = tuned_.rungs;
    for (std::size_t k = 0; k < all.size(); ++k) {
        if (!all[k].fits) continue;
        const auto better = [&](const RungMeasured& than) {  // of two alike, the faster
            return all[k].auc.value != than.auc.value ? all[k].auc.value > than.auc.value
                                                      : all[k].wall_ms < than.wall_ms;
        };
        if (!tuned_.best || better(all[*tuned_.best])) tuned_.best = k;
    }
    if (!tuned_.best) return;
    // A difference of exactly kAsGood is within it, however the areas were rounded.
    const auto as_good = [&](const RungMeasured& m) {
        return m.fits && all[*tuned_.best].auc.value - m.auc.value <= kAsGood + 1e-9;
    };
    double fastest = all[*tuned_.best].wall_ms;
    for (std::size_t k = 0; k < all.size(); ++k) {
        all[k].behind = auc_difference(scored_[*tuned_.best], scored_[k], kRepeats, kSeed);
        if (as_good(all[k])) fastest = std::min(fastest, all[k].wall_ms);
    }
    const auto simpler = [&](const RungMeasured& a, const RungMeasured& b) {
        return std::pair(a.rung.features(), a.wall_ms) < std::pair(b.rung.features(), b.wall_ms);
    };
    for (std::size_t k = 0; k < all.size(); ++k) {
        if (!as_good(all[k]) || all[k].wall_ms > (1 + kAsFast) * fastest) continue;
        if (!tuned_.chosen || simpler(all[k], all[*tuned_.chosen])) tuned_.chosen = k;
    }
}

// Every frame with the recipe of the choice, as a station will read it: what is said of it is what it does.
Result<void> Tuner::judge_again() {
    if (!tuned_.chosen) return {};
    RungMeasured& chosen = tuned_.rungs[*tuned_.chosen];
    const auto recipe = parse_numbered_recipe(format_recipe(chosen.recipe), "the recipe");
    if (!recipe) return tl::unexpected(recipe.error());
    auto pipeline = algo::Pipeline::create(tuned_.extents, tuned_.bits, recipe->recipe, options_.threads);
    if (!pipeline) return tl::unexpected(pipeline.error());
    chosen.found = chosen.rejected = 0;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        options_.progress(0.8 + 0.2 * static_cast<double>(k) / static_cast<double>(parts_.size()), "judging again");
        const auto frame = read(parts_[k].file);
        if (!frame) return tl::unexpected(frame.error());
        const auto seen = pipeline->inspect(frame->view());
        if (!seen) return tl::unexpected(seen.error());
        if (seen->verdict != algo::Verdict::pass) ++(parts_[k].bad ? chosen.found : chosen.rejected);
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
    if (auto ready = set_up(good.front()); !ready) return tl::unexpected(ready.error());
    const double total = static_cast<double>(good.size() + bad.size());
    std::size_t done = 0;
    for (const bool of_bad : {false, true}) {
        for (const std::string& file : of_bad ? bad : good) {
            options_.progress(0.6 * static_cast<double>(done++) / total, file);
            if (auto seen = look_at(file, of_bad); !seen) return tl::unexpected(seen.error());
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
    const Values set = limits();
    std::size_t of_reference = 0;
    for (RungMeasured& measured : tuned_.rungs) {
        set_limits(measured, set, of_reference);
        of_reference += measured.rung.reference ? 1U : 0U;
    }
    if (auto timed = time_them(); !timed) return tl::unexpected(timed.error());
    choose();
    if (auto judged = judge_again(); !judged) return tl::unexpected(judged.error());
    return std::move(tuned_);
}

}  // namespace

std::string Rung::name() const {
    std::string text;
    const auto add = [&](std::string_view feature) { text += fmt::format("{}{}", text.empty() ? "" : " + ", feature); };
    if (reference) add("reference");
    if (gradient) add(name_of(*gradient));
    if (slopes) add(name_of(algo::Feature::jacobian_frobenius));
    if (light) add(name_of(algo::Feature::transmission));
    return text;
}

std::vector<Rung> rungs(bool with_reference) {
    std::vector<Rung> all = {{{}, false, true, false}, {{}, true, false, false}, {{}, true, true, false}};
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
