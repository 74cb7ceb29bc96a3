#include "lab/scene/scene_needs.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "algo/maps/feature_map.h"
#include "algo/recipe/recipe.h"
#include "common/statistics.h"
#include "hal_sim/optics/camera/render.h"
#include "lab/optics/truth.h"
#include "lab/report/cpu_time.h"

namespace hord::lab {
namespace {

struct Features {
    std::vector<float> emd, jacobian, light;
    std::vector<std::uint8_t> mask;
};

Result<Features> features_of(const Frame& frame, const algo::Extents& e, const algo::LightLevels& levels) {
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
    static Result<SceneComparison> make(const sim::Scene& scene, int threads, SceneNeeds& needs) {
        SceneComparison out;
        out.threads_ = threads;
        for (const std::uint8_t label : truth_of(scene).labels)
            out.judged_.push_back(label == 0 || label == 1 || label == 3);
        needs.lenslets = static_cast<int>(std::count(out.judged_.begin(), out.judged_.end(), 1));
        auto light = out.light(scene, needs.render_ms, &out.field_);
        if (!light) return tl::unexpected(light.error());
        auto sensor = out.sensor(scene, needs.expose_ms);
        if (!sensor) return tl::unexpected(sensor.error());
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
        auto features = features_of(sim::expose(*field, quiet, 1), scene.camera.extents, {0, 30, 65535});
        if (keep) *keep = std::move(*field);
        return features;
    }
    // The sensor's frame with the station's light levels.
    Result<Features> sensor(const sim::Scene& scene, double& ms) const {
        const double start = process_cpu_ms();
        const Frame frame = sim::expose(field_, scene, scene.seed);
        ms = process_cpu_ms() - start;
        return features_of(frame, scene.camera.extents, algo::light_levels({}, scene.camera.bits));
    }

    int threads_ = 0;
    std::vector<std::uint8_t> judged_;
    sim::LightField field_;
    Features whole_light_, whole_sensor_;
};

FeatureChange larger(const FeatureChange& a, const FeatureChange& b) {
    return {std::max(a.emd, b.emd),
            std::max(a.jacobian, b.jacobian),
            std::max(a.transmission, b.transmission),
            std::max(a.emd_rms, b.emd_rms),
            std::max(a.jacobian_rms, b.jacobian_rms),
            std::max(a.transmission_rms, b.transmission_rms),
            std::max(a.unseen, b.unseen)};
}

// Leaves out as many effects of the light (or of the sensor) as the tolerance allows, the smallest first.
Result<void> leave_out(SceneNeeds& needs, const sim::Scene& scene, bool of_sensor, const SceneComparison& comparison,
                       const std::function<void()>& step) {
    std::vector<EffectNeed*> order;
    for (EffectNeed& need : needs.effects) {
        if (is_of_sensor(need.effect) == of_sensor) order.push_back(&need);
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
        if (changed->largest() > needs.tolerance) continue;
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

std::vector<Effect> SceneNeeds::required() const {
    std::vector<Effect> out;
    for (const EffectNeed& need : effects) {
        if (need.required) out.push_back(need.effect);
    }
    return out;
}

Result<SceneNeeds> needs_of(const sim::Scene& scene, const NeedsOptions& options) {
    SceneNeeds needs;
    needs.tolerance = options.tolerance;
    const auto named = effects_of(scene);
    const double steps = 2 + 2 * static_cast<double>(named.size());
    double done = 0;
    const auto step = [&] {
        if (options.progress) options.progress(std::min(1.0, ++done / steps));
    };
    // Renders a first frame to warm the caches, so that the next time is comparable with the others.
    if (auto first = sim::render(scene, {options.threads, {}}); !first) return tl::unexpected(first.error());
    step();
    const auto comparison = SceneComparison::make(scene, options.threads, needs);
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
    if (options.progress) options.progress(1);
    return needs;
}

std::string table_of(const SceneNeeds& needs) {
    std::string out = fmt::format(
        "{} lenslets off the rims; render {:.0f} ms, exposure {:.0f} ms of processor time; change: 99th percentile "
        "(rms)\n\n",
        needs.lenslets, needs.render_ms, needs.expose_ms);
    out += fmt::format("{:<13} {:>18} {:>18} {:>18} {:>7} {:>9}  {}\n", "without", "EMD, bins", "Jacobian, bins",
                       "light, share", "unseen", "cost, ms", "");
    const auto both = [](double p99, double mean) { return fmt::format("{:.4f} ({:.4f})", p99, mean); };
    for (const EffectNeed& need : needs.effects) {
        const FeatureChange& c = need.change;
        out += fmt::format("{:<13} {:>18} {:>18} {:>18} {:>7} {:>9.1f}  {}\n", name_of(need.effect),
                           both(c.emd, c.emd_rms), both(c.jacobian, c.jacobian_rms),
                           both(c.transmission, c.transmission_rms), c.unseen, need.cost_ms,
                           need.required ? "required" : "");
    }
    std::string set;
    for (const Effect effect : needs.required()) set += (set.empty() ? "" : ", ") + std::string(name_of(effect));
    out += fmt::format("\nAt a tolerance of {} this scene requires: {}.\n", needs.tolerance,
                       set.empty() ? "none of the effects that it names" : set);
    out += fmt::format("Without all others: EMD {:.4f}, Jacobian {:.4f}, light {:.4f}.\n", needs.left_out.emd,
                       needs.left_out.jacobian, needs.left_out.transmission);
    return out;
}

}  // namespace hord::lab
