#include "lab/scene/scene_needs.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "algo/maps/feature_map.h"
#include "algo/recipe/recipe.h"
#include "common/statistics.h"
#include "hal_sim/optics/camera/render.h"
#include "lab/optics/truth.h"
#include "lab/report/cpu_time.h"

namespace hord::lab {
namespace {

constexpr std::array<std::string_view, kContrasts> kContrastNames{"EMD", "Jacobian", "light"};
constexpr double kSeen = 2;    // a defect with less contrast is not seen
constexpr double kPlain = 10;  // contrasts above are clear: their changes do not matter

struct Features {
    std::vector<float> emd, jacobian, light;
    std::vector<std::uint8_t> mask;
    algo::Verdict verdict{};
    algo::Reason reason{};
    Contrasts contrast{};
    int false_defects = 0;
};

bool is_near(const Truth& truth, double m, double n) {
    return std::ranges::any_of(
        truth.defects, [&](const TruthDefect& d) { return std::hypot(m - d.m, n - d.n) <= d.radius_lenslets + 3; });
}

double percentile_99(std::vector<double>& of);

// The least 99th percentile that counts: bin pitches, bin pitches a lenslet, share of light. Below it a field is even.
constexpr Contrasts kMinEven{1e-3, 5e-4, 0.01};

// Largest value of a feature at true defects over the 99th percentile of the other judged lenslets.
Contrasts contrast_of(const Features& of, const algo::Extents& e, std::span<const std::uint8_t> not_judged,
                      const Truth& truth) {
    if (truth.defects.empty()) return {};
    const auto even = [&](std::size_t k) { return (not_judged[k] & algo::kNotJudged) == 0; };
    std::vector<float> lit;
    for (std::size_t k = 0; k < of.light.size(); ++k) {
        if (even(k)) lit.push_back(of.light[k]);
    }
    const double typical = lit.empty() ? 1.0 : std::max(1.0F, common::upper_median(std::span(lit)));
    Contrasts peak{};
    std::array<std::vector<double>, kContrasts> elsewhere;
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::size_t k = e.index(m, n);
            const bool near = is_near(truth, m, n), gradient = (of.mask[k] & algo::kNoGradient) == 0;
            const Contrasts value{gradient ? static_cast<double>(of.emd[k]) : 0,
                                  gradient ? static_cast<double>(of.jacobian[k]) : 0,
                                  std::abs(1 - static_cast<double>(of.light[k]) / typical)};
            for (std::size_t f = 0; f < kContrasts; ++f) {
                if (near) peak[f] = std::max(peak[f], value[f]);
                else if (even(k) && (f == kContrasts - 1 || gradient)) elsewhere[f].push_back(value[f]);
            }
        }
    }
    for (std::size_t f = 0; f < kContrasts; ++f) peak[f] /= std::max(kMinEven[f], percentile_99(elsewhere[f]));
    return peak;
}

// What the recipe says of the frame.
Result<void> judge(const Frame& frame, const algo::Extents& e, const algo::Recipe& recipe, const Truth& truth,
                   Features& out) {
    auto pipeline = algo::Pipeline::create(e, frame.bits(), recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    const auto found = pipeline->inspect(frame.view());
    if (!found) return tl::unexpected(found.error());
    out.verdict = found->verdict, out.reason = found->reason;
    out.false_defects = static_cast<int>(std::ranges::count_if(found->defects, [&](const algo::Defect& defect) {
        return !is_near(truth, static_cast<double>(defect.m), static_cast<double>(defect.n));
    }));
    out.contrast = contrast_of(out, e, found->mask, truth);
    return {};
}

Result<Features> features_of(const Frame& frame, const algo::Extents& e, const algo::LightLevels& levels,
                             const algo::Recipe& recipe, const Truth& truth) {
    Features out;
    for (const algo::Feature feature : {algo::Feature::emd, algo::Feature::jacobian_frobenius}) {
        auto mapper = algo::FeatureMapper::create(e, frame.bits(), levels, feature);
        if (!mapper) return tl::unexpected(mapper.error());
        const auto map = mapper->over_neighbours(frame.view());
        if (!map) return tl::unexpected(map.error());
        (feature == algo::Feature::emd ? out.emd : out.jacobian).assign(map->values.begin(), map->values.end());
        out.mask.assign(map->mask.begin(), map->mask.end());
    }
    algo::HordRow row(e);
    for (int n = 0; n < e.n; ++n) {
        algo::decode_row(frame.view(), e, levels, n, row);
        for (const std::uint32_t sum : row.sums()) out.light.push_back(static_cast<float>(sum));
    }
    if (auto done = judge(frame, e, recipe, truth, out); !done) return tl::unexpected(done.error());
    return out;
}

double percentile_99(std::vector<double>& of) {
    if (of.empty()) return 0;
    return common::nth_smallest(std::span(of),
                                static_cast<std::size_t>(0.99 * static_cast<double>(of.size() - 1) + 0.5));
}
double rms(const std::vector<double>& of) {
    double sum = 0;
    for (const double x : of) sum += x * x;
    return of.empty() ? 0 : std::sqrt(sum / static_cast<double>(of.size()));
}

// `judged`: the lenslets off the rims.
FeatureChange change(const Features& with, const Features& without, const std::vector<std::uint8_t>& judged) {
    std::vector<float> lit;
    for (std::size_t k = 0; k < judged.size(); ++k) {
        if (judged[k] != 0) lit.push_back(with.light[k]);
    }
    if (lit.empty()) return {};
    const double typical = std::max(1.0F, common::upper_median(std::span(lit)));
    std::vector<double> emd, jacobian, light;
    FeatureChange out;
    out.verdict = with.verdict, out.verdict_without = without.verdict;
    out.contrast = with.contrast, out.contrast_without = without.contrast;
    out.false_defects = with.false_defects, out.false_defects_without = without.false_defects;
    for (std::size_t k = 0; k < judged.size(); ++k) {
        if (judged[k] == 0) continue;
        light.push_back(std::abs(static_cast<double>(with.light[k]) - static_cast<double>(without.light[k])) / typical);
        const bool a = (with.mask[k] & algo::kNoGradient) == 0, b = (without.mask[k] & algo::kNoGradient) == 0;
        if (a != b) ++out.unseen;
        if (!a || !b) continue;
        emd.push_back(std::abs(static_cast<double>(with.emd[k]) - static_cast<double>(without.emd[k])));
        jacobian.push_back(std::abs(static_cast<double>(with.jacobian[k]) - static_cast<double>(without.jacobian[k])));
    }
    out.emd_rms = rms(emd), out.jacobian_rms = rms(jacobian), out.transmission_rms = rms(light);
    out.emd = percentile_99(emd), out.jacobian = percentile_99(jacobian), out.transmission = percentile_99(light);
    return out;
}

// The light and the exposure of a scene, to compare with the same scene without some effect.
class SceneComparison {
  public:
    // Takes the whole scene's frames; their processor times go to `needs`. Fails as sim::render() does.
    static Result<SceneComparison> make(const sim::Scene& scene, const NeedsOptions& options, SceneNeeds& needs) {
        SceneComparison out;
        out.threads_ = options.threads;
        out.recipe_ = options.recipe;
        out.truth_ = truth_of(scene);
        for (const std::uint8_t label : out.truth_.labels)
            out.judged_.push_back(label == 0 || label == 1 || label == 3);
        needs.lenslets = static_cast<int>(std::count(out.judged_.begin(), out.judged_.end(), 1));
        auto light = out.light(scene, needs.render_ms, &out.field_);
        if (!light) return tl::unexpected(light.error());
        auto sensor = out.sensor(scene, needs.expose_ms);
        if (!sensor) return tl::unexpected(sensor.error());
        needs.verdict = sensor->verdict, needs.reason = sensor->reason;
        out.whole_light_ = std::move(*light), out.whole_sensor_ = std::move(*sensor);
        return out;
    }

    // The change of the features from this scene to `less`; `ms`: the processor time of its frame.
    Result<FeatureChange> change_by(const sim::Scene& less, bool of_sensor, double& ms) const {
        const auto features = of_sensor ? sensor(less, ms) : light(less, ms);
        if (!features) return tl::unexpected(features.error());
        return change(of_sensor ? whole_sensor_ : whole_light_, *features, judged_);
    }

  private:
    // Without noise, at 16 bits.
    Result<Features> light(const sim::Scene& scene, double& ms, sim::LightField* keep = nullptr) const {
        const double start = process_cpu_ms();
        auto field = sim::render(scene, {threads_, {}});
        ms = process_cpu_ms() - start;
        if (!field) return tl::unexpected(field.error());
        sim::Scene quiet = scene;
        quiet.noise = {};
        quiet.camera.bits = 16;
        quiet.camera.full_bin_dn = 30000;  // room above: several sources, rims
        auto features =
            features_of(sim::expose(*field, quiet, 1), scene.camera.extents, {0, 30, 65535}, recipe_, truth_);
        if (keep) *keep = std::move(*field);
        return features;
    }
    // The sensor's frame with the station's light levels.
    Result<Features> sensor(const sim::Scene& scene, double& ms) const {
        const double start = process_cpu_ms();
        const Frame frame = sim::expose(field_, scene, scene.seed);
        ms = process_cpu_ms() - start;
        return features_of(frame, scene.camera.extents, algo::light_levels(recipe_, scene.camera.bits), recipe_,
                           truth_);
    }

    int threads_ = 0;
    algo::Recipe recipe_;
    Truth truth_;
    std::vector<std::uint8_t> judged_;
    sim::LightField field_;
    Features whole_light_, whole_sensor_;
};

// The larger changes of the field; of the other, what it says of verdict, contrast and defects.
FeatureChange larger(const FeatureChange& a, FeatureChange b) {
    b.emd = std::max(a.emd, b.emd), b.jacobian = std::max(a.jacobian, b.jacobian);
    b.transmission = std::max(a.transmission, b.transmission);
    b.emd_rms = std::max(a.emd_rms, b.emd_rms), b.jacobian_rms = std::max(a.jacobian_rms, b.jacobian_rms);
    b.transmission_rms = std::max(a.transmission_rms, b.transmission_rms);
    b.unseen = std::max(a.unseen, b.unseen);
    return b;
}

// Leaves out as many effects of the light (or of the sensor) as the tolerance allows, the smallest first.
Result<void> leave_out(SceneNeeds& needs, const sim::Scene& scene, bool of_sensor, const SceneComparison& comparison,
                       const std::function<void()>& step) {
    std::vector<EffectNeed*> order;
    for (EffectNeed& need : needs.effects) {
        if (need.named && is_of_sensor(need.effect) == of_sensor) order.push_back(&need);
    }
    std::stable_sort(order.begin(), order.end(),
                     [](const auto* a, const auto* b) { return a->change.largest() < b->change.largest(); });
    sim::Scene least = scene;
    for (EffectNeed* need : order) {
        const sim::Scene less = without(least, need->effect);
        double ms = 0;
        auto changed = comparison.change_by(less, of_sensor, ms);
        if (!changed) return tl::unexpected(changed.error());
        step();
        if (!changed->matters(needs.tolerance).empty()) continue;
        need->required = false;
        needs.left_out = larger(needs.left_out, *changed);
        least = less;
    }
    // Without fresnel there are no ghosts.
    for (EffectNeed* need : order) {
        if (!names(least, need->effect)) need->required = false;
    }
    return {};
}

}  // namespace

double FeatureChange::largest() const { return std::max({emd, jacobian, transmission}); }

double FeatureChange::contrast_change(std::size_t f) const {
    const double a = std::min(contrast[f], kPlain), b = std::min(contrast_without[f], kPlain);
    return std::max(a, b) < kSeen ? 0 : std::abs(a - b) / std::max(1.0, std::min(a, b));
}

std::size_t FeatureChange::shown() const {
    std::size_t most = 0, clearest = 0;
    for (std::size_t f = 1; f < kContrasts; ++f) {
        if (contrast_change(f) > contrast_change(most)) most = f;
        if (contrast[f] > contrast[clearest]) clearest = f;
    }
    if (contrast_change(most) > kContrastChange) return most;
    return std::max(contrast[clearest], contrast_without[clearest]) < kSeen ? kContrasts : clearest;
}

std::string_view FeatureChange::matters(double tolerance) const {
    if (verdict != verdict_without) return "verdict";
    if (false_defects != false_defects_without) return "false defects";
    for (std::size_t f = 0; f < kContrasts; ++f) {
        if (contrast_change(f) > kContrastChange) return "contrast";
    }
    return largest() > tolerance ? "field" : "";
}

std::vector<Effect> SceneNeeds::required() const {
    std::vector<Effect> out;
    for (const EffectNeed& need : effects) {
        if (need.named && need.required) out.push_back(need.effect);
    }
    return out;
}

std::vector<Effect> SceneNeeds::spare() const {
    std::vector<Effect> out;
    for (const EffectNeed& need : effects) {
        if (need.named && !need.required) out.push_back(need.effect);
    }
    return out;
}

std::vector<Effect> SceneNeeds::missing() const {
    std::vector<Effect> out;
    for (const EffectNeed& need : effects) {
        if (!need.named && need.required) out.push_back(need.effect);
    }
    return out;
}

Result<SceneNeeds> needs_of(const sim::Scene& scene, const NeedsOptions& options) {
    SceneNeeds needs;
    needs.tolerance = options.tolerance;
    const auto named = effects_of(scene);
    const double steps = 2 + 2 * static_cast<double>(named.size()) +
        (options.typical ? static_cast<double>(kEffects - named.size()) : 0);
    double done = 0;
    const auto step = [&] {
        if (options.progress) options.progress(std::min(1.0, ++done / steps));
    };
    // Renders a first frame to warm the caches, so that the next time is comparable with the others.
    if (auto first = sim::render(scene, {options.threads, {}}); !first) return tl::unexpected(first.error());
    step();
    const auto comparison = SceneComparison::make(scene, options, needs);
    if (!comparison) return tl::unexpected(comparison.error());
    step();
    for (const Effect effect : named) {
        const bool of_sensor = is_of_sensor(effect);
        double ms = 0;
        auto changed = comparison->change_by(without(scene, effect), of_sensor, ms);
        if (!changed) return tl::unexpected(changed.error());
        needs.effects.push_back({effect, *changed, (of_sensor ? needs.expose_ms : needs.render_ms) - ms, true});
        step();
    }
    for (const bool of_sensor : {false, true}) {
        if (auto good = leave_out(needs, scene, of_sensor, *comparison, step); !good)
            return tl::unexpected(good.error());
    }
    for (std::size_t k = 0; options.typical && k < kEffects; ++k, step()) {
        const auto effect = static_cast<Effect>(k);
        const sim::Scene more = with_typical(scene, effect);
        // Some exclude one another, or need what the scene does not have.
        if (names(scene, effect) || !names(more, effect) || !sim::problems(more).empty()) continue;
        const bool of_sensor = is_of_sensor(effect);
        double ms = 0;
        auto changed = comparison->change_by(more, of_sensor, ms);
        if (!changed) return tl::unexpected(changed.error());
        std::swap(changed->verdict, changed->verdict_without);
        std::swap(changed->contrast, changed->contrast_without);
        std::swap(changed->false_defects, changed->false_defects_without);
        const bool matters = !changed->matters(needs.tolerance).empty();
        needs.effects.push_back(
            {effect, *changed, ms - (of_sensor ? needs.expose_ms : needs.render_ms), matters, false});
    }
    if (options.progress) options.progress(1);
    return needs;
}

std::string table_of(const SceneNeeds& needs) {
    std::string out = fmt::format(
        "{} lenslets off the rims; verdict {}; render {:.0f} ms, exposure {:.0f} ms of processor time; change of the "
        "field: 99th percentile\n\n",
        needs.lenslets, name_of(needs.verdict), needs.render_ms, needs.expose_ms);
    if (needs.verdict == algo::Verdict::unfit) {
        out += fmt::format(
            "The recipe finds this scene unfit ({}): it judges no defects, and verdicts and false defects "
            "say little. Give the recipe of this part (--recipe; a plate needs form = \"plate\").\n\n",
            name_of(needs.reason));
    }
    out += fmt::format("{:<13} {:>9} {:>14} {:>12} {:>16} {:>18} {:>15} {:>9}  {}\n", "effect", "EMD, bins",
                       "Jacobian, bins", "light, share", "verdict", "contrast", "false defects", "cost, ms", "");
    bool said_typical = false;
    for (const EffectNeed& need : needs.effects) {
        if (!need.named && !std::exchange(said_typical, true)) out += "not named, at typical values:\n";
        const FeatureChange& c = need.change;
        const std::string_view why = c.matters(needs.tolerance);
        const std::string verdict = c.verdict == c.verdict_without
            ? std::string("-")
            : fmt::format("{}, else {}", name_of(c.verdict), name_of(c.verdict_without));
        const std::size_t seen = c.shown();
        const std::string contrast = seen == kContrasts
            ? std::string("-")
            : fmt::format("{}: {:.3g} / {:.3g}", kContrastNames[seen], c.contrast[seen], c.contrast_without[seen]);
        out += fmt::format("{:<13} {:>9.4f} {:>14.4f} {:>12.4f} {:>16} {:>18} {:>15} {:>9.1f}  {}\n",
                           name_of(need.effect), c.emd, c.jacobian, c.transmission, verdict, contrast,
                           fmt::format("{} / {}", c.false_defects, c.false_defects_without), need.cost_ms,
                           !need.required   ? std::string()
                               : need.named ? fmt::format("required: {}", why.empty() ? "with those left out" : why)
                                            : fmt::format("name it: {}", why));
    }
    const auto listed = [](const std::vector<Effect>& effects) {
        std::string set;
        for (const Effect effect : effects) set += (set.empty() ? "" : ", ") + std::string(name_of(effect));
        return set;
    };
    const std::string set = listed(needs.required()), missing = listed(needs.missing()), spare = listed(needs.spare());
    out += fmt::format(
        "\nContrast (of the feature that sees the defects best, or changes most; -: no feature sees the defects) and "
        "false defects: with / "
        "without "
        "the effect.\n"
        "At a tolerance of {} this scene requires: {}.\n",
        needs.tolerance, set.empty() ? "none of the effects that it names" : set);
    if (said_typical)
        out += fmt::format("It does not name, and at typical values would need: {}.\n",
                           missing.empty() ? "nothing" : missing);
    if (!spare.empty()) {
        out += fmt::format("It can do without {}: without all of them EMD {:.4f}, Jacobian {:.4f}, light {:.4f}.\n",
                           spare, needs.left_out.emd, needs.left_out.jacobian, needs.left_out.transmission);
    }
    return out;
}

}  // namespace hord::lab
