#include "lab/kinds/kind_contrast.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/camera/telecentric.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/optics/truth.h"

namespace hord::lab {
namespace {

constexpr double kLightFloor = 0.01;  // of the light: as in paper.md
constexpr int kBins = 9;

// One view of a part: 0 where it looks as a good part does.
struct Signal {
    std::vector<float> values;
    std::vector<std::uint8_t> mask;  // algo::MaskBit
};
struct Views {
    algo::Verdict verdict;
    algo::Reason reason;
    float score;
    std::array<Signal, kLineViewNames.size()> signals;
};

std::vector<float> off_one(std::span<const float> light) {
    std::vector<float> off;
    for (const float value : light) off.push_back(std::abs(1 - value));
    return off;
}

Result<Views> views_of(const sim::Scene& scene, std::uint64_t seed, int threads) {
    const algo::Extents& e = scene.camera.extents;
    const auto light = sim::render(scene, {threads, {}});
    if (!light) return tl::unexpected(light.error());
    const Frame frame = sim::expose(*light, scene, seed);
    auto pipeline = algo::Pipeline::create(e, frame.bits(), {}, 1, algo::MapSet::all);
    if (!pipeline) return tl::unexpected(pipeline.error());
    const auto found = pipeline->inspect(frame.view());
    if (!found) return tl::unexpected(found.error());
    sim::Scene beside = scene;
    beside.telecentric.width_px = e.m, beside.telecentric.height_px = e.n;
    beside.telecentric.field_mm = scene.camera.field_mm;
    const auto picture = sim::render_telecentric(beside, {threads, {}});
    if (!picture) return tl::unexpected(picture.error());

    const std::vector<std::uint8_t> judged(found->mask.begin(), found->mask.end());
    const auto only = [&](unsigned bits) {
        std::vector<std::uint8_t> mask = judged;
        for (std::uint8_t& of : mask) of = static_cast<std::uint8_t>(of & bits);
        return mask;
    };
    Views views{found->verdict, found->reason, found->score, {}};
    views.signals[0] = {off_one(picture->light), only(algo::kNotJudged)};
    views.signals[1] = {off_one(found->transmission), only(algo::kNotJudged | algo::kSaturated)};
    views.signals[2] = {{found->gradient.begin(), found->gradient.end()}, judged};
    views.signals[3] = {{found->frobenius.begin(), found->frobenius.end()}, judged};
    return views;
}

double floor_of(std::size_t view) {
    const auto is = static_cast<LineView>(view);
    return is == LineView::telecentric || is == LineView::transmission ? kLightFloor : 0;
}

// The circle around all defects of a scene: grains of haze are one defect.
Result<TruthDefect> place_of(const sim::Scene& scene) {
    const Truth truth = truth_of(scene);
    if (truth.defects.empty())
        return fail(ErrorCode::internal, "scene " + scene.name + " has no defect in sight", "report this");
    if (truth.defects.size() == 1) return truth.defects.front();
    TruthDefect all;
    for (const TruthDefect& one : truth.defects) {
        all.m += one.m / static_cast<double>(truth.defects.size());
        all.n += one.n / static_cast<double>(truth.defects.size());
    }
    for (const TruthDefect& one : truth.defects)
        all.radius_lenslets =
            std::max(all.radius_lenslets, std::hypot(one.m - all.m, one.n - all.n) + one.radius_lenslets);
    return all;
}

}  // namespace

Result<std::vector<SeenPart>> see_scenes(const std::vector<sim::Scene>& scenes,
                                         const std::vector<sim::PartClass>& kinds, std::uint64_t seed, int threads) {
    std::vector<SeenPart> parts;
    std::array<Interior, kLineViewNames.size()> good;
    for (std::size_t k = 0; k < scenes.size(); ++k) {
        const sim::Scene& scene = scenes[k];
        const auto views = views_of(scene, seed + k, threads);
        if (!views) return tl::unexpected(views.error());
        SeenPart part{kinds[k], views->verdict, views->reason, views->score, {}, 0};
        if (k == 0) {
            for (std::size_t v = 0; v < good.size(); ++v)
                good[v] = interior_of(views->signals[v].values, views->signals[v].mask);
        } else {
            const auto where = place_of(scene);
            if (!where) return tl::unexpected(where.error());
            for (std::size_t v = 0; v < good.size(); ++v) {
                const Signal& signal = views->signals[v];
                const Contrast seen =
                    contrast_of(signal.values, signal.mask, scene.camera.extents, *where, good[v], floor_of(v));
                part.contrast[v] = seen.ratio;
                if (static_cast<LineView>(v) == LineView::transmission) part.missing_light = seen.peak;
            }
        }
        parts.push_back(part);
    }
    return parts;
}

Result<std::vector<SeenPart>> see_parts(const std::vector<sim::PartClass>& kinds, std::uint64_t seed, int threads) {
    sim::ProductionOptions options;
    options.clean = sim::line_lens(kBins, kBins);
    options.seed = seed;
    options.good_parts = options.of_each_defect = 1;
    options.defects = kinds;
    auto drawn = sim::draw_production(options);
    if (!drawn) return tl::unexpected(drawn.error());
    std::vector<sim::PartClass> all{sim::PartClass::good};
    all.insert(all.end(), kinds.begin(), kinds.end());
    return see_scenes(drawn->scenes, all, seed, threads);
}

}  // namespace hord::lab
