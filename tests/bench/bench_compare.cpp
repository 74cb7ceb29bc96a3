// The cost of judging against a reference, step by step: the paper's lens, 111x111 lenslets of 9x9 bins, 12 bits, 2,000
// electrons a lenslet. Times are per lenslet inside the part. The time of the features alone is measured in the same
// run for comparison, as machines and their load differ (./dev bench).
#include <array>
#include <cstdio>
#include <memory>
#include <span>
#include <vector>

#include <benchmark/benchmark.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/inspection/reference_defects.h"
#include "algo/reference/reference_comparison.h"
#include "common/statistics.h"
#include "lab/detection/detection_parts.h"
#include "lab/experiment/scenes.h"
#include "lab/report/cpu_time.h"

namespace hord::bench {
namespace {

using namespace lab;

// A good part, a reference learned from other parts of its kind, and the pipeline's results that the comparison needs.
struct Compared {
    sim::Scene scene = lens_scene(111);
    algo::Recipe recipe = production_recipe();
    Frame frame;
    algo::Registered registered;
    std::vector<algo::Deflection> deflections;
    std::vector<std::uint32_t> sums;
    std::vector<std::uint8_t> mask;
    std::vector<float> emd, frobenius;
    double lenslets = 0;  // inside the part

    Compared() {
        recipe.dark_dn = 4, recipe.min_sum_dn = 60;  // as the times in docs/notes were measured
        scene.camera.bits = 12;
        scene.camera.full_bin_dn = kProductionElectrons / 1.169;  // the source's area, bins
        scene.noise.electrons_per_dn = static_cast<double>(kProductionGain);
        scene.noise.read_e = static_cast<double>(kProductionReadDn);
        const auto light = sim::render(scene).value();
        std::vector<Frame> frames;
        for (std::uint64_t k = 0; k <= algo::Reference::kMinParts; ++k)
            frames.push_back(expose_part(light, scene, 1, k));
        algo::LearnOptions learning;
        learning.levels = algo::light_levels(recipe, scene.camera.bits);
        learning.electrons_per_dn = kProductionGain;
        learning.read_dn = kProductionReadDn;
        const algo::Extents& e = scene.camera.extents;
        auto learned = algo::learn_reference(
            e, scene.camera.bits, algo::Reference::kMinParts, [&](std::size_t k) -> Result<Frame> { return frames[k]; },
            learning);
        recipe.reference = std::make_shared<const algo::Reference>(std::move(learned.value().reference));
        frame = std::move(frames.back());
        auto pipeline = algo::Pipeline::create(e, scene.camera.bits, recipe, 1, algo::MapSet::exact).value();
        const auto found = pipeline.inspect(frame.view()).value();
        registered = found.registered;
        sums.assign(found.sums.begin(), found.sums.end());
        mask.assign(found.mask.begin(), found.mask.end());
        emd.assign(found.emd.begin(), found.emd.end());
        frobenius.assign(found.frobenius.begin(), found.frobenius.end());
        deflections.resize(e.lenslets());
        algo::HordRow row(e);
        for (int n = 0; n < e.n; ++n) {
            algo::decode_row(frame.view(), e, recipe.reference->levels, n, row);
            algo::mean_deflections(
                row, std::span(deflections).subspan(static_cast<std::size_t>(n * e.m), static_cast<std::size_t>(e.m)));
        }
        for (const std::uint8_t bits : mask) lenslets += (bits & algo::kOutside) == 0 ? 1 : 0;
    }
};
const Compared& compared() {
    static const Compared all;
    return all;
}

void a_lenslet(benchmark::State& state) {
    state.counters["a_lenslet"] = benchmark::Counter(
        compared().lenslets, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void inspect(benchmark::State& state, bool with_reference) {
    const Compared& c = compared();
    algo::Recipe recipe = c.recipe;
    if (!with_reference) recipe.reference = nullptr;
    auto pipeline = algo::Pipeline::create(c.scene.camera.extents, c.scene.camera.bits, recipe).value();
    for (auto _ : state) benchmark::DoNotOptimize(pipeline.inspect(c.frame.view())->score);
    a_lenslet(state);
}

void find_pose(benchmark::State& state) {
    const Compared& c = compared();
    const algo::Reference& r = *c.recipe.reference;
    algo::Registrar registrar(r.extents);
    for (auto _ : state)
        benchmark::DoNotOptimize(
            registrar
                .find(r.maps(), c.deflections, c.sums, c.mask, static_cast<double>(r.sensor.electrons_per_dn), r.parts)
                .light);
    a_lenslet(state);
}

std::vector<algo::Difference> compare_all(algo::ReferenceComparer& comparer) {
    const Compared& c = compared();
    const algo::Extents& e = c.scene.camera.extents;
    const algo::PoseMap pose(c.registered.pose, e);
    std::vector<algo::Difference> all(e.lenslets());
    const auto columns = static_cast<std::size_t>(e.m);
    for (int n = 0; n < e.n; ++n) {
        const auto at = static_cast<std::size_t>(n) * columns;
        comparer.compare_row(c.frame.view(), std::span(c.sums).subspan(at, columns),
                             std::span(c.mask).subspan(at, columns), n, pose, c.registered.light,
                             c.recipe.reference->levels.dark, std::span(all).subspan(at, columns));
    }
    return all;
}

void compare(benchmark::State& state, algo::Isa isa) {
    if (!algo::has(isa)) return state.SkipWithError("not on this processor");
    algo::ReferenceComparer comparer(*compared().recipe.reference, isa);
    for (auto _ : state) benchmark::DoNotOptimize(compare_all(comparer).data());
    a_lenslet(state);
}

void judge(benchmark::State& state) {
    const Compared& c = compared();
    algo::ReferenceComparer comparer(*c.recipe.reference);
    const auto differences = compare_all(comparer);
    algo::ReferenceDefects judge(c.scene.camera.extents, c.recipe);
    std::vector<float> z_score(differences.size());
    const algo::ComparedFrame features{differences, c.emd, c.frobenius, c.mask};
    for (auto _ : state) {
        judge.score_lenslets(features, z_score);
        benchmark::DoNotOptimize(judge.find(features, c.registered.pose).score);
    }
    a_lenslet(state);
}

// With and without what several lenslets show together, in turns: the ratio of the medians.
void judge_together(benchmark::State& state) {
    const Compared& c = compared();
    std::vector<algo::Pipeline> pipelines;
    for (const float limit : {0.0F, algo::kPooledUnreached}) {
        algo::Recipe recipe = c.recipe;
        recipe.pooled_score = limit;
        pipelines.push_back(algo::Pipeline::create(c.scene.camera.extents, c.scene.camera.bits, recipe).value());
    }
    std::array<std::vector<double>, 2> times;
    for (auto _ : state) {
        for (std::size_t k = 0; k < 2; ++k) {
            const auto begin = thread_cpu_time();
            benchmark::DoNotOptimize(pipelines[k].inspect(c.frame.view())->score);
            times[k].push_back(static_cast<double>((thread_cpu_time() - begin).count()));
        }
    }
    state.counters["with_over_without"] = common::quantile(times[1], 0.5) / common::quantile(times[0], 0.5);
}

BENCHMARK(judge_together)->Iterations(200)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(inspect, alone, false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(inspect, against_a_reference, true)->Unit(benchmark::kMillisecond);
BENCHMARK(find_pose)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compare, portable, algo::Isa::portable)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compare, avx2, algo::Isa::avx2)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compare, avx512, algo::Isa::avx512)->Unit(benchmark::kMillisecond);
BENCHMARK(judge)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace hord::bench

BENCHMARK_MAIN();
