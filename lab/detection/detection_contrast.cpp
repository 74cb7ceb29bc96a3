#include <algorithm>
#include <cmath>
#include <ctime>
#include <map>
#include <memory>
#include <optional>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/reference/reference_learner.h"
#include "algo/reference/reference_sampler.h"
#include "hal_sim/optics/scene/noise.h"
#include "lab/detection/detection.h"
#include "lab/detection/detection_parts.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/experiment/scenes.h"
#include "lab/optics/truth.h"
#include "lab/report/cpu_time.h"

namespace hord::lab {
namespace {

constexpr double kElectrons = 2000, kSourceArea = 1.169;  // bins
constexpr double kFloor = 1e-3;                           // smallest sigma of a map, times 3

// The paper's lens with this camera: 12 bits, noise, a small wobble.
sim::Scene paper_lens(int lenslets) {
    sim::Scene scene = lens_scene(lenslets);
    scene.camera.bits = 12;
    scene.camera.full_bin_dn = kElectrons / kSourceArea;
    scene.noise.electrons_per_dn = static_cast<double>(kProductionGain);
    scene.noise.read_e = static_cast<double>(kProductionReadDn);
    return scene;
}

sim::Scene moved(sim::Scene scene, std::uint64_t seed, std::uint32_t number) {
    sim::Noise draw(seed, number, 0xC0A7);
    const double pitch_mm = scene.camera.field_mm / scene.camera.extents.m;
    scene.pose.x_mm = 0.5 * pitch_mm * (2 * draw.uniform() - 1);
    scene.pose.y_mm = 0.5 * pitch_mm * (2 * draw.uniform() - 1);
    return scene;
}

Result<sim::LightField> light_of(const sim::Scene& scene, const ExperimentOptions& options) {
    return sim::render(scene, {options.threads, {}});
}

// The maps of a frame, with masks of the lenslets that have no value. A dark lenslet has a z-score.
// It has a gradient only if it is taken as evenly lit.
struct PartMaps {
    std::vector<float> emd, even, z_score;
    std::vector<float> deviance;  // deviance_of(), where z_score has a value
    std::vector<std::uint8_t> emd_mask, even_mask, z_score_mask;
};
struct NamedMap {
    const char* name;
    std::vector<float> PartMaps::*map;
    std::vector<std::uint8_t> PartMaps::*mask;
};
constexpr NamedMap kMaps[] = {{"emd", &PartMaps::emd, &PartMaps::emd_mask},
                              {"even", &PartMaps::even, &PartMaps::even_mask},
                              {"z-score", &PartMaps::z_score, &PartMaps::z_score_mask}};

// The deviance of each lenslet, an upper bound for any score: twice the log likelihood ratio of its bins as measured
// and as the reference expects them. The noise is photon and read noise alone: Poisson where light is missing,
// normal where there is more. By Neyman and Pearson no test for exactly this flaw is better, and under noise alone the
// ratio is R or more with a probability of at most 1 / R. So a score that good parts exceed as rarely as a normal
// number is at most about the root of the deviance, less its mean under noise.
std::vector<float> deviance_of(const Frame& frame, const algo::Extents& e, const algo::Reference& reference,
                               const algo::ReferenceSampler& reference_hord, const algo::Registered& at,
                               std::span<const std::uint8_t> mask) {
    std::vector<float> deviance(e.lenslets());
    std::vector<float> bins(reference.stride());
    const algo::PoseMap pose(at.pose, e);
    const double gain = static_cast<double>(kProductionGain), read = static_cast<double>(kProductionReadDn);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const auto k = static_cast<std::size_t>(n * e.m + m);
            if ((mask[k] & (algo::kOutside | algo::kSaturated)) != 0) continue;
            std::ranges::fill(bins, 0.0F);
            const auto place = pose.to_reference(m, n);
            const auto at_place = reference_hord.read(place.m, place.n, at.light, bins.data());
            if (!at_place.has_hord) continue;
            double sum = 0;
            for (int b = 0; b < e.bins(); ++b) {
                const auto sample = static_cast<double>(frame.view().sample(m * e.i + b % e.i, n * e.j + b / e.i));
                const double measured = std::max(0.0, sample - static_cast<double>(reference.levels.dark)),
                             expected = at_place.light * static_cast<double>(bins[reference.place(b % e.i, b / e.i)]);
                const double more = measured - expected;
                if (more > 0) sum += more * more / (expected / gain + read * read + 1.0 / 12);
                else sum += 2 * gain * ((measured > 0 ? measured * std::log(measured / expected) : 0) - more);
            }
            deviance[k] = static_cast<float>(sum);
        }
    }
    return deviance;
}

// The roots of the deviances above `by_noise`, the mean deviance under noise alone.
std::vector<float> roots_of(const std::vector<float>& deviance, double by_noise) {
    std::vector<float> roots;
    for (const float d : deviance)
        roots.push_back(static_cast<float>(std::sqrt(std::max(0.0, static_cast<double>(d) - by_noise))));
    return roots;
}

Result<std::optional<PartMaps>> inspect_part(algo::Pipeline& with_reference, algo::Pipeline& without_reference,
                                             const algo::Reference& reference,
                                             const algo::ReferenceSampler& reference_hord, const Frame& frame,
                                             const algo::Extents& e) {
    const auto found = with_reference.inspect(frame.view());
    if (!found) return tl::unexpected(found.error());
    if (found->z_score.empty()) return std::optional<PartMaps>();
    PartMaps maps;
    maps.emd.assign(found->emd.begin(), found->emd.end());
    maps.z_score.assign(found->z_score.begin(), found->z_score.end());
    maps.emd_mask.assign(found->mask.begin(), found->mask.end());
    maps.z_score_mask = maps.emd_mask;
    for (std::uint8_t& bits : maps.z_score_mask) bits &= static_cast<std::uint8_t>(~(algo::kDark | algo::kBorder));
    maps.deviance = deviance_of(frame, e, reference, reference_hord, found->registered, maps.z_score_mask);
    const Frame filled = with_dark_as_uniform(frame, InspectedMaps{e, maps.emd, {}, {}, maps.emd_mask});
    const auto even = without_reference.inspect(filled.view());
    if (!even) return tl::unexpected(even.error());
    maps.even.assign(even->emd.begin(), even->emd.end());
    maps.even_mask.assign(even->mask.begin(), even->mask.end());
    return std::optional(std::move(maps));
}

// Contrast to noise of the map averaged over a disc of the defect and 1.5 lenslets around it: the average at the defect
// less the mean of such averages over the clean interior, over their standard deviation.
double averaged_contrast(const std::vector<float>& flawed, const std::vector<std::uint8_t>& flawed_mask,
                         const std::vector<float>& clean, const std::vector<std::uint8_t>& interior,
                         const algo::Extents& e, const TruthDefect& defect) {
    const double radius = defect.radius_lenslets + 1.5;
    const int reach = static_cast<int>(std::ceil(radius));
    // Empty where the disc leaves the field, or, with `all`, where a lenslet in it has no value.
    const auto mean_at = [&](const std::vector<float>& map, const std::vector<std::uint8_t>& mask, double at_m,
                             double at_n, std::uint8_t none, bool all) -> std::optional<double> {
        double sum = 0, count = 0;
        for (int n = static_cast<int>(at_n) - reach; n <= static_cast<int>(at_n) + reach + 1; ++n) {
            for (int m = static_cast<int>(at_m) - reach; m <= static_cast<int>(at_m) + reach + 1; ++m) {
                if (std::hypot(m - at_m, n - at_n) > radius) continue;
                if (m < 0 || n < 0 || m >= e.m || n >= e.n) return std::nullopt;
                const auto k = static_cast<std::size_t>(n * e.m + m);
                const bool has = (mask[k] & none) == 0;
                if (!has && all) return std::nullopt;
                if (has) sum += static_cast<double>(map[k]), count += 1;
            }
        }
        return count > 0 ? std::optional(sum / count) : std::nullopt;
    };
    double sum = 0, squares = 0, count = 0;
    for (int n = 0; n < e.n; n += 2) {
        for (int m = 0; m < e.m; m += 2) {
            const auto mean = mean_at(clean, interior, m, n, 0xFF, true);
            if (mean) sum += *mean, squares += *mean * *mean, count += 1;
        }
    }
    const auto there = mean_at(flawed, flawed_mask, defect.m, defect.n, algo::kNoGradient, false);
    if (count < 2 || !there) return 0;
    const double mean = sum / count, sigma = std::sqrt(std::max(0.0, squares / count - mean * mean));
    return (*there - mean) / std::max(sigma, kFloor / 3);
}

std::int64_t cpu_ns() { return thread_cpu_time().count(); }

double median(std::vector<double> values) { return quantile(std::move(values), 0.5); }

// The same recipe without and with a reference that was learned from these frames.
struct Pipelines {
    std::shared_ptr<const algo::Reference> reference;
    algo::Pipeline without, with;
};
Result<Pipelines> learn_pipelines(const sim::Scene& scene, const std::vector<Frame>& frames, algo::MapSet maps) {
    auto reference = learn_as_a_user(scene.camera, frames);
    if (!reference) return tl::unexpected(reference.error());
    algo::Recipe recipe = production_recipe();
    auto without = algo::Pipeline::create(scene.camera.extents, scene.camera.bits, recipe, 1, maps);
    if (!without) return tl::unexpected(without.error());
    recipe.reference = *reference;
    auto with = algo::Pipeline::create(scene.camera.extents, scene.camera.bits, recipe, 1, maps);
    if (!with) return tl::unexpected(with.error());
    return Pipelines{*reference, std::move(*without), std::move(*with)};
}

// The cut, the bubble, and hollows as wide as the cut but shallower: they deflect the light at their rim by so many
// bins, so that none leaves the bins.
struct Flawed {
    std::string name;
    sim::SceneDefect defect;
};
std::vector<Flawed> flaws_of(const sim::Scene& nominal) {
    std::vector<Flawed> flawed{{"cut", cut_of_lens(0.15)}, {"bubble", bubble_of_lens(0.5)}};
    for (const double bins : {1.0, 0.3, 0.15}) {
        constexpr double kHalfWidthMm = 0.66;
        const sim::DoubleConvexLens lens;
        // A hollow changes the curvature by its own plus the lens's, which it replaces.
        const double curved = bins * nominal.camera.bin_pitch_rad / ((lens.refractive_index - 1) * kHalfWidthMm);
        flawed.push_back(
            {fmt::format("hollow, {:g} bin", bins),
             cut_of_lens(kHalfWidthMm * kHalfWidthMm * curved / 2, 1 / (curved - 1 / lens.radius_of_curvature_mm))});
    }
    return flawed;
}

// Contrasts of flawed parts over clean ones in the same pose.
class ContrastMeter {
  public:
    ContrastMeter(const ExperimentOptions& options, std::uint64_t seed, Pipelines pipelines)
        : options_(options), seed_(seed), pipelines_(std::move(pipelines)),
          sampler_(*pipelines_.reference, algo::best_isa()), shots_(options.quick ? 2 : 10) {}

    // For each of some exposures.
    Result<Json> compare(const std::string& name, const sim::Scene& clean, const sim::LightField& clean_light,
                         const sim::Scene& scene, const TruthDefect& truth) {
        const algo::Extents& e = scene.camera.extents;
        auto light = light_of(scene, options_);
        if (!light) return tl::unexpected(light.error());
        std::map<std::string, std::vector<double>> each, averaged;
        int refused = 0;
        for (int k = 0; k < shots_; ++k) {
            const auto good = inspect(expose_part(clean_light, clean, seed_, exposure_++), e);
            const auto bad = inspect(expose_part(*light, scene, seed_, exposure_++), e);
            if (!good || !bad) return tl::unexpected(good ? bad.error() : good.error());
            if (!*good || !*bad) {
                ++refused;
                continue;
            }
            // In units of the scores' clean standard deviation; the clean mean is not subtracted.
            const Interior scores = interior_of((**good).z_score, (**good).emd_mask);
            const std::vector<float> surest =
                roots_of((**bad).deviance, interior_of((**good).deviance, (**good).emd_mask).mean);
            each["surest"].push_back(
                contrast_of(surest, (**bad).z_score_mask, e, truth, {.sigma = scores.sigma}, kFloor).to_noise);
            for (const NamedMap& map : kMaps) {
                const Interior interior = interior_of((**good).*map.map, (**good).emd_mask);
                each[map.name].push_back(
                    contrast_of((**bad).*map.map, (**bad).*map.mask, e, truth, interior, kFloor).to_noise);
                averaged[map.name].push_back(averaged_contrast((**bad).*map.map, (**bad).*map.mask, (**good).*map.map,
                                                               (**good).emd_mask, e, truth));
            }
        }
        return Json{{"scene", name},       {"seed", seed_},    {"radius", truth.radius_lenslets},
                    {"shots", shots_},     {"unfit", refused}, {"each", each},
                    {"averaged", averaged}};
    }

  private:
    Result<std::optional<PartMaps>> inspect(const Frame& frame, const algo::Extents& e) {
        return inspect_part(pipelines_.with, pipelines_.without, *pipelines_.reference, sampler_, frame, e);
    }
    const ExperimentOptions& options_;
    std::uint64_t seed_;
    Pipelines pipelines_;
    algo::ReferenceSampler sampler_;
    int shots_;
    std::uint64_t exposure_ = 0xC100'0000U;
};

// Every flaw at its place in one lens.
Result<void> compare_flaws(ContrastMeter& meter, const sim::Scene& clean, const std::vector<Flawed>& flawed,
                           const ExperimentOptions& options, Json& scenes) {
    auto clean_light = light_of(clean, options);
    if (!clean_light) return tl::unexpected(clean_light.error());
    std::optional<TruthDefect> cut;
    for (const Flawed& flaw : flawed) {
        sim::Scene scene = clean;
        scene.name = flaw.name;
        scene.defects.push_back(flaw.defect);
        // The hollows have the position of the cut.
        const TruthDefect truth = flaw.name.starts_with("hollow") ? *cut : truth_of(scene).defects.front();
        if (!cut) cut = truth;
        auto compared = meter.compare(flaw.name, clean, *clean_light, scene, truth);
        if (!compared) return tl::unexpected(compared.error());
        scenes.push_back(*compared);
    }
    return {};
}

// The light of the cut depends on its position between the lenslets. Offsets of its centre from a lenslet's centre: 0,
// 1/4, 1/2 and 3/4 lenslet along either axis.
Result<void> compare_places(ContrastMeter& meter, const sim::Scene& nominal, const sim::SceneDefect& cut,
                            const ExperimentOptions& options, Json& scenes) {
    constexpr int kSides = 4;
    const double pitch_mm = nominal.camera.field_mm / nominal.camera.extents.m;
    for (int place = 0; place < kSides * kSides; ++place) {
        const double beside_m = static_cast<double>(place % kSides) / kSides,
                     beside_n = static_cast<double>(place / kSides) / kSides;
        sim::Scene scene = nominal;
        scene.defects.push_back(cut);
        const TruthDefect middle = truth_of(scene).defects.front();
        const auto to = [](double from, double beside) {
            return beside - from - std::round(beside - from);
        };  // to the nearest such place
        scene.pose.x_mm += pitch_mm * to(middle.m, beside_m);
        scene.pose.y_mm += pitch_mm * to(middle.n, beside_n);
        sim::Scene good = scene;
        good.defects.clear();
        auto good_light = light_of(good, options);
        if (!good_light) return tl::unexpected(good_light.error());
        auto compared = meter.compare("cut beside", good, *good_light, scene, truth_of(scene).defects.front());
        if (!compared) return tl::unexpected(compared.error());
        (*compared)["beside"] = {beside_m, beside_n};
        scenes.push_back(*compared);
    }
    return {};
}

}  // namespace

Result<Json> measure_contrast(const ExperimentOptions& options, std::uint64_t seed, bool all_flaws) {
    constexpr int kLenslets = 111, kLearn = 12;
    const sim::Scene nominal = paper_lens(kLenslets);
    std::vector<Frame> frames;
    for (int k = 0; k < kLearn; ++k) {
        const sim::Scene scene = moved(nominal, seed, static_cast<std::uint32_t>(k));
        auto light = light_of(scene, options);
        if (!light) return tl::unexpected(light.error());
        frames.push_back(expose_part(*light, scene, seed, 0xC000'0000U + static_cast<std::uint64_t>(k)));
    }
    auto pipelines = learn_pipelines(nominal, frames, algo::MapSet::exact);
    if (!pipelines) return tl::unexpected(pipelines.error());
    ContrastMeter meter(options, seed, std::move(*pipelines));
    const std::vector<Flawed> flawed = flaws_of(nominal);
    Json scenes = Json::array();
    if (all_flaws) {
        if (auto done = compare_flaws(meter, moved(nominal, seed, 1000), flawed, options, scenes); !done)
            return tl::unexpected(done.error());
    }
    if (auto done = compare_places(meter, nominal, flawed.front().defect, options, scenes); !done)
        return tl::unexpected(done.error());
    return scenes;
}

// CPU time of one thread, of the features, without and with a reference in turns, so that other load disturbs both
// alike. One traced lens of the paper's size (the quick form: smaller) is exposed repeatedly, learned from and
// inspected.
Result<Json> measure_times(const ExperimentOptions& options) {
    const int lenslets = options.quick ? 111 : 555, repeats = options.quick ? 9 : 31;
    const sim::Scene scene = paper_lens(lenslets);
    auto light = light_of(scene, options);
    if (!light) return tl::unexpected(light.error());
    const auto shoot = [&](std::uint64_t exposure) {
        return expose_part(*light, scene, options.seed, 0xC200'0000U + exposure);
    };
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < algo::Reference::kMinParts; ++k) frames.push_back(shoot(k + 1));
    auto pipelines = learn_pipelines(scene, frames, algo::MapSet::judged);
    if (!pipelines) return tl::unexpected(pipelines.error());
    frames.clear();
    const Frame frame = shoot(0);
    std::vector<double> features, without, with, added;
    for (int k = 0; k < repeats; ++k) {
        const auto a = pipelines->without.inspect(frame.view(), cpu_ns);
        if (!a) return tl::unexpected(a.error());
        features.push_back(
            static_cast<double>(a->times.feature_ns + a->times.bound_ns + a->times.decode_ns + a->times.hord_ns) / 1e6);
        without.push_back(static_cast<double>(a->times.total_ns) / 1e6);
        const auto b = pipelines->with.inspect(frame.view(), cpu_ns);
        if (!b) return tl::unexpected(b.error());
        if (!b->registered.found())
            return fail(ErrorCode::internal, "the timed part was not registered",
                        "a bug: its reference was learned from the same part");
        with.push_back(static_cast<double>(b->times.total_ns) / 1e6);
        added.push_back((with.back() - without.back()) / features.back());
    }
    return Json{{"lenslets", lenslets},
                {"repeats", repeats},
                {"features", median(features)},
                {"without", median(without)},
                {"with", median(with)},
                {"added", median(added)},
                {"added_low", quantile(added, 0.1)},
                {"added_high", quantile(added, 0.9)}};
}

}  // namespace hord::lab
