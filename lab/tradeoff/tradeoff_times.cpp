#include "lab/tradeoff/tradeoff_times.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <numbers>
#include <numeric>
#include <optional>

#include "algo/emd/emd_solver.h"
#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/maps/feature_map.h"
#include "lab/experiment/scenes.h"
#include "lab/experiment/transport_check.h"
#include "lab/report/cpu_time.h"
#include "lab/report/statistics.h"
#include "lab/tradeoff/tradeoff_scores.h"

namespace hord::lab {
namespace {

constexpr int kLenslets = 111, kPaperLenslets = 555;

double processor_ms() { return std::chrono::duration<double, std::milli>(thread_cpu_time()).count(); }

// A frame and another exposure of the same scene as its reference, every stride-th lenslet of both.
struct Timed {
    algo::Extents extents;
    Frame frame, reference;
};

Frame every(const Frame& frame, const algo::Extents& e, int stride) {
    if (stride == 1) return frame;
    const algo::Extents few{e.m / stride, e.n / stride, e.i, e.j};
    Frame out(few.width_px(), few.height_px(), frame.bits());
    for (int y = 0; y < few.height_px(); ++y) {
        for (int x = 0; x < few.width_px(); ++x)
            out.set(x, y, frame.view().sample(x / e.i * stride * e.i + x % e.i, y / e.j * stride * e.j + y % e.j));
    }
    return out;
}

Result<Timed> frames_at(const TradeoffPoint& point, std::uint64_t seed, int threads) {
    sim::Scene scene = lens_scene(kLenslets);
    scene.defects = {bubble_of_lens(0.5)};
    scene.camera.extents.i = scene.camera.extents.j = point.bins;
    scene.light.source_radius_bins *= point.bins / 9.0;
    scene.camera.bin_pitch_rad *= 9.0 / point.bins;
    scene.camera.bits = 16;
    scene.camera.full_bin_dn = 65535;  // set by every exposure
    scene.noise.electrons_per_dn = 1;
    scene.noise.read_e = 2;
    auto light = sim::render(scene, {threads, {}});
    if (!light) return tl::unexpected(light.error());
    TradeoffParts parts;
    parts.scene = scene;
    const algo::Extents& e = scene.camera.extents;
    return Timed{{e.m / point.stride, e.n / point.stride, e.i, e.j},
                 every(expose_part(parts, *light, point, seed, 1), e, point.stride),
                 every(expose_part(parts, *light, point, seed, 2), e, point.stride)};
}

// Measures all in turn, round after round, so that other load disturbs all alike.
class Stopwatch {
  public:
    void add(const std::string& name, std::function<void()> work) { works_.push_back({name, std::move(work), {}}); }
    Json measure(int rounds) {
        for (int round = -1; round < rounds; ++round) {  // round -1 warms up
            for (Work& work : works_) {
                const double begin = processor_ms();
                work.run();
                if (round >= 0) work.ms.push_back(processor_ms() - begin);
            }
        }
        constexpr double kMore = static_cast<double>(kPaperLenslets * kPaperLenslets) / (kLenslets * kLenslets);
        Json times;
        for (const Work& work : works_) {
            times[work.name] = {{"median_ms", kMore * quantile(work.ms, 0.5)},
                                {"p99_ms", kMore * quantile(work.ms, 0.99)},
                                {"runs", work.ms.size()}};
        }
        return times;
    }

  private:
    struct Work {
        std::string name;
        std::function<void()> run;
        std::vector<double> ms;
    };
    std::vector<Work> works_;
};

algo::Recipe light_alone(const algo::LightLevels& levels) {
    algo::Recipe recipe;
    recipe.gradient.reset();
    recipe.slopes = false;
    recipe.dark_dn = levels.dark, recipe.min_sum_dn = levels.min_sum, recipe.saturated_dn = levels.saturated;
    return recipe;
}

// Entropic transport beside the exact distance, on the horizontal pairs of every 11th lenslet of every 11th row.
Result<Json> sinkhorn_beside_emd(const Timed& timed, const algo::LightLevels& levels) {
    constexpr int kEvery = 11, kMaxRounds = 2000;
    constexpr double kEpsilon = 0.05, kResidual = 1e-4;  // bin pitches; L1 error of the plan's marginals
    const algo::Extents& e = timed.extents;
    const auto ground = algo::GroundDistance::between_bins(e.i, e.j);
    if (!ground) return tl::unexpected(ground.error());
    std::vector<double> errors;
    double ms = 0, exact_ms = 0, rounds = 0;
    auto solver = algo::EmdSolver::create(*ground);
    if (!solver) return tl::unexpected(solver.error());
    algo::HordRow row(e);
    for (int n = kEvery; n + 1 < e.n; n += kEvery) {
        algo::decode_row(timed.frame.view(), e, levels, n, row);
        for (int m = kEvery; m + 1 < e.m; m += kEvery) {
            if (!row.has_hord(m - 1) || !row.has_hord(m + 1)) continue;
            const auto masses = [&](int at) { return Masses(row.hord(at).mass, row.hord(at).mass + e.bins()); };
            const Masses a = masses(m - 1), b = masses(m + 1);
            const double begin = processor_ms();
            const Sinkhorn found = sinkhorn(a, b, *ground, kEpsilon, kResidual, kMaxRounds);
            const double middle = processor_ms();
            const double exact = solver->distance(row.hord(m - 1), row.hord(m + 1));
            exact_ms += processor_ms() - middle, ms += middle - begin, rounds += found.rounds;
            errors.push_back(std::abs(found.cost - exact));
        }
    }
    const auto pairs = static_cast<double>(std::max<std::size_t>(errors.size(), 1));
    const double mean = std::accumulate(errors.begin(), errors.end(), 0.0) / pairs;
    return Json{{"mean", mean},
                {"p99", quantile(errors, 0.99)},
                {"pairs", errors.size()},
                {"pair_us", 1e3 * ms / pairs},
                {"exact_us", 1e3 * exact_ms / pairs},
                {"rounds", rounds / pairs}};
}

}  // namespace

Result<Json> time_features(const TradeoffPoint& point, std::uint64_t seed, int threads, bool quick) {
    const auto timed = frames_at(point, seed, threads);
    if (!timed) return tl::unexpected(timed.error());
    const auto levels = levels_at(point);
    std::optional<Error> wrong;
    Stopwatch watch;
    volatile std::uint64_t sink = 0;
    watch.add("sum the bytes", [&] {
        const auto bytes = timed->frame.bytes();
        sink = std::accumulate(bytes.begin(), bytes.end(), std::uint64_t{0},
                               [](std::uint64_t sum, std::byte b) { return sum + static_cast<std::uint64_t>(b); });
    });
    // The transmission has no mapper: the station computes it in its pipeline.
    auto light = algo::Pipeline::create(timed->extents, 16, light_alone(levels));
    if (!light) return tl::unexpected(light.error());
    std::deque<algo::FeatureMapper> mappers;
    for (const algo::FeatureChoice choice : every_choice()) {
        if (choice.feature == algo::Feature::transmission) {
            watch.add(name_of(choice), [&] {
                if (const auto seen = light->inspect(timed->frame.view()); !seen) wrong = seen.error();
            });
            continue;
        }
        auto made = algo::FeatureMapper::create(timed->extents, 16, levels, choice.feature);
        if (!made) return tl::unexpected(made.error());
        algo::FeatureMapper& mapper = mappers.emplace_back(std::move(*made));
        watch.add(name_of(choice), [&, choice] {
            const auto map = choice.against_reference ? mapper.against(timed->frame.view(), timed->reference.view())
                                                      : mapper.over_neighbours(timed->frame.view());
            if (!map) wrong = map.error();
        });
    }
    const Json times = watch.measure(quick ? 5 : 25);
    if (wrong) return tl::unexpected(*wrong);
    return times;
}

Result<Json> approximations_of_emd(const TradeoffPoint& point, std::uint64_t seed, int threads) {
    const auto timed = frames_at(point, seed, threads);
    if (!timed) return tl::unexpected(timed.error());
    const auto map_of = [&](algo::Feature feature) -> Result<std::vector<float>> {
        auto mapper = algo::FeatureMapper::create(timed->extents, 16, levels_at(point), feature);
        if (!mapper) return tl::unexpected(mapper.error());
        const auto map = mapper->over_neighbours(timed->frame.view());
        if (!map) return tl::unexpected(map.error());
        std::vector<float> values;
        for (std::size_t k = 0; k < map->values.size(); ++k) {
            if ((map->mask[k] & algo::kNoGradient) == 0) values.push_back(map->values[k]);
        }
        return values;
    };
    const auto exact = map_of(algo::Feature::emd);
    if (!exact) return tl::unexpected(exact.error());
    Json found;
    for (const algo::Feature feature :
         {algo::Feature::centroid, algo::Feature::marginal, algo::Feature::sliced, algo::Feature::emd_l1}) {
        const auto values = map_of(feature);
        if (!values) return tl::unexpected(values.error());
        std::vector<double> errors;
        for (std::size_t k = 0; k < exact->size(); ++k)
            errors.push_back(std::abs(static_cast<double>((*values)[k]) - static_cast<double>((*exact)[k])));
        const double mean = std::accumulate(errors.begin(), errors.end(), 0.0) /
            static_cast<double>(std::max<std::size_t>(errors.size(), 1));
        found[std::string(name_of(feature))] = {{"mean", mean}, {"p99", quantile(errors, 0.99)}};
    }
    auto entropic = sinkhorn_beside_emd(*timed, levels_at(point));
    if (!entropic) return tl::unexpected(entropic.error());
    found["sinkhorn"] = std::move(*entropic);
    return found;
}

}  // namespace hord::lab
