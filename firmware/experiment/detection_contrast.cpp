#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <optional>

#include <fmt/format.h>

#include "algo/pipeline.h"
#include "algo/reference_learner.h"
#include "firmware/experiment/detection.h"
#include "firmware/experiment/detection_parts.h"
#include "firmware/experiment/scenes.h"
#include "firmware/experiment/sight.h"
#include "hal_sim/optics/noise.h"

namespace hord::firmware {
namespace {

constexpr double kElectrons = 2000, kSourceArea = 1.169;  // bins
constexpr double kFloor = 1e-3;                           // of a map's contrast, where the clean part shows nothing

// The paper's lens as this camera sees it: 12 bits, noise, a little wobble.
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

std::int64_t cpu_ns() {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

double median(std::vector<double> values) { return quantile(std::move(values), 0.5); }

// CPU time of one thread a frame, ms: of the features, without and with a reference; taken in turns, for other programs slow both alike.
struct Times {
    double features_ms, without_ms, with_ms, added;  // added: the median of the pairs' (with - without) / features
};
Result<Times> times_of(algo::Pipeline& alone, algo::Pipeline& against, const algo::Frame& frame, int repeats) {
    std::vector<double> features, without, with, added;
    for (int k = 0; k < repeats; ++k) {
        const auto a = alone.inspect(frame.view(), cpu_ns);
        if (!a) return tl::unexpected(a.error());
        features.push_back(static_cast<double>(a->times.feature_ns + a->times.decode_ns + a->times.hord_ns) / 1e6);
        without.push_back(static_cast<double>(a->times.total_ns) / 1e6);
        const auto b = against.inspect(frame.view(), cpu_ns);
        if (!b) return tl::unexpected(b.error());
        with.push_back(static_cast<double>(b->times.total_ns) / 1e6);
        added.push_back((with.back() - without.back()) / features.back());
    }
    return Times{median(features), median(without), median(with), median(added)};
}

}  // namespace

Result<Json> measure_contrast(const ExperimentOptions& options) {
    const int lenslets = 111, learn = 12, shots = options.quick ? 2 : 10;
    const sim::Scene nominal = paper_lens(lenslets);
    const algo::Extents& e = nominal.camera.extents;
    const auto shoot = [&](const sim::Scene& scene, std::uint64_t exposure) -> Result<algo::Frame> {
        auto light = sim::render(scene, {options.threads, {}});
        if (!light) return tl::unexpected(light.error());
        return expose_part(*light, scene, options.seed, exposure);
    };
    std::vector<algo::Frame> frames;
    for (int k = 0; k < learn; ++k) {
        auto frame = shoot(moved(nominal, options.seed, static_cast<std::uint32_t>(k)), 0xC000'0000U + static_cast<std::uint64_t>(k));
        if (!frame) return tl::unexpected(frame.error());
        frames.push_back(std::move(*frame));
    }
    algo::LearnOptions learning;
    learning.levels = algo::light_levels(production_recipe(), nominal.camera.bits);
    learning.electrons_per_dn = kProductionGain;
    learning.read_dn = kProductionReadDn;
    auto learned = algo::learn_reference(e, nominal.camera.bits, frames.size(), [&](std::size_t k) -> Result<algo::Frame> { return frames[k]; }, learning);
    if (!learned) return tl::unexpected(learned.error());
    algo::Recipe recipe = production_recipe();
    auto alone = algo::Pipeline::create(e, nominal.camera.bits, recipe);
    recipe.reference = std::make_shared<const algo::Reference>(std::move(learned->reference));
    auto against = algo::Pipeline::create(e, nominal.camera.bits, recipe);
    if (!alone || !against) return tl::unexpected(alone ? against.error() : alone.error());

    sim::Scene clean = moved(nominal, options.seed, 1000), cut = clean, bubble = clean;
    cut.name = "cut", bubble.name = "bubble";
    cut.defects.emplace_back(cut_of_lens(0.15));
    bubble.defects.emplace_back(bubble_of_lens(0.5));
    struct Seen {
        std::vector<float> emd, surprise;
        std::vector<std::uint8_t> mask;
    };
    Json scenes = Json::array();
    std::optional<sim::LightField> clean_light;
    for (const sim::Scene* scene : {&clean, &cut, &bubble}) {
        auto light = sim::render(*scene, {options.threads, {}});
        if (!light) return tl::unexpected(light.error());
        if (!clean_light) {
            clean_light = std::move(*light);
            continue;
        }
        const sim::TruthDefect truth = sim::truth_of(*scene).defects.front();
        std::vector<double> by_emd, by_surprise;
        int refused = 0;
        for (int k = 0; k < shots; ++k) {
            std::optional<Seen> seen[2];  // clean, flawed
            for (int which = 0; which < 2; ++which) {
                const algo::Frame frame = expose_part(which == 0 ? *clean_light : *light, *scene, options.seed, 0xC100'0000U + static_cast<std::uint64_t>(2 * k + which));
                const auto found = against->inspect(frame.view());
                if (!found) return tl::unexpected(found.error());
                if (found->surprise.empty()) break;
                seen[which] = Seen{{found->emd.begin(), found->emd.end()}, {found->surprise.begin(), found->surprise.end()}, {found->mask.begin(), found->mask.end()}};
            }
            if (!seen[1]) {
                ++refused;
                continue;
            }
            const auto contrast = [&](std::vector<float> Seen::*map) {
                const Interior interior = interior_of(*seen[0].*map, seen[0]->mask);
                return contrast_of(*seen[1].*map, seen[1]->mask, e, truth, interior, kFloor).to_noise;
            };
            by_emd.push_back(contrast(&Seen::emd));
            by_surprise.push_back(contrast(&Seen::surprise));
        }
        scenes.push_back({{"scene", scene->name}, {"shots", shots}, {"unfit", refused}, {"emd", by_emd}, {"surprise", by_surprise}});
    }
    const algo::Frame frame = expose_part(*clean_light, clean, options.seed, 0xC200'0000U);
    const int repeats = options.quick ? 9 : 51;
    const auto times = times_of(*alone, *against, frame, repeats);
    if (!times) return tl::unexpected(times.error());
    return Json{{"scenes", scenes},
                {"times", {{"lenslets", lenslets}, {"repeats", repeats}, {"features", times->features_ms}, {"without", times->without_ms}, {"with", times->with_ms}, {"added", times->added}}}};
}

}  // namespace hord::firmware
