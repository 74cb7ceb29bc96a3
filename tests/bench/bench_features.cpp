// How fast whole maps are, as a ratio to summing the frame's bytes in the same run (./dev bench).
//
// Work: frame_555_9x9.png (from $HORD_DATA/bench or ../shared/data/bench; dark threshold 3 DN), from samples to one
// value a lenslet: decoding is part of it. `bytes summed` is the fastest sum we know (SAD instructions on x86-64): it
// is bound by memory. Repetitions of all benchmarks are interleaved; the tables are made of medians of CPU time, so
// that other load on the machine affects all alike. Two threads against one is a ratio of elapsed times and needs two
// idle cores. Repetitions are many and short: a load peak affects all benchmarks.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include <benchmark/benchmark.h>
#include <opencv2/imgcodecs.hpp>

#include "algo/inspection/pipeline.h"
#include "algo/maps/feature_map.h"
#include "tests/bench/sum_of_bytes.h"

namespace hord::bench {
namespace {

using algo::Feature;
using algo::FeatureMapper;
using algo::Isa;

constexpr int kBins = 9;
constexpr algo::LightLevels kLevels{3, 16, 255};

std::filesystem::path data_dir() {
    const char* given = std::getenv("HORD_DATA");
    return given != nullptr ? std::filesystem::path(given) : std::filesystem::path(HORD_SOURCE_DIR) / "../shared/data";
}

const cv::Mat& image() {
    static const cv::Mat loaded = cv::imread((data_dir() / "bench/frame_555_9x9.png").string(), cv::IMREAD_UNCHANGED);
    return loaded;
}

FrameView frame() {
    return {reinterpret_cast<const std::byte*>(image().data), image().cols, image().rows,
            static_cast<std::ptrdiff_t>(image().step), 8};
}

algo::Extents extents() { return {image().cols / kBins, image().rows / kBins, kBins, kBins}; }

void bytes_summed(benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(sum_of_bytes(image().data, image().total()));
}

void feature_map(benchmark::State& state, Feature feature, Isa isa) {
    auto mapper = FeatureMapper::create(extents(), 8, kLevels, feature, {.isa = isa});
    if (!mapper) return state.SkipWithError(mapper.error().message().c_str());
    for (auto _ : state) benchmark::DoNotOptimize(mapper->over_neighbours(frame())->values.data());
}

struct Threads {
    std::vector<double> one_ms, two_ms, maps_ms;  // elapsed; the same index: one right after the other
};
std::map<Feature, Threads> of_threads;

// One map by one thread; one by two; and two independent maps at once by a thread each, which shows what two cores of
// this machine can do. Measured in turn, so that other load affects all three alike.
void threads(benchmark::State& state, Feature feature) {
    const auto mapper = [&](int count) {
        return *FeatureMapper::create(extents(), 8, kLevels, feature, {.threads = count});
    };
    const auto elapsed_ms = [](auto work) {
        const auto begin = std::chrono::steady_clock::now();
        work();
        return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    };
    const auto compute = [](FeatureMapper& by) {
        benchmark::DoNotOptimize(by.over_neighbours(frame())->values.data());
    };
    FeatureMapper one = mapper(1), another = mapper(1), two = mapper(2);
    Threads& seen = of_threads[feature];
    for (auto _ : state) {
        seen.one_ms.push_back(elapsed_ms([&] { compute(one); }));
        seen.two_ms.push_back(elapsed_ms([&] { compute(two); }));
        seen.maps_ms.push_back(elapsed_ms([&] {
            std::jthread beside([&] { compute(another); });
            compute(one);
        }));
    }
}

// A whole inspection, from samples to a verdict.
void verdict(benchmark::State& state, float limit, algo::MapSet maps) {
    algo::Recipe recipe;
    recipe.emd_limit_bins = limit;
    recipe.part_required = false;  // the frame shows no part
    auto pipeline = algo::Pipeline::create(extents(), 8, recipe, 1, maps);
    bool bounded = false;
    for (auto _ : state) bounded = pipeline->inspect(frame())->bounded;
    state.counters["bounded"] = bounded ? 1 : 0;
}

double median_of(std::vector<double> all) {
    std::sort(all.begin(), all.end());
    return all[all.size() / 2];
}

class Collected : public benchmark::ConsoleReporter {
  public:
    void ReportRuns(const std::vector<Run>& runs) override {
        for (const Run& run : runs) {
            if (run.run_type == Run::RT_Iteration) {
                const std::string name = run.run_name.function_name;
                cpu_ms[name].push_back(run.GetAdjustedCPUTime());
                if (const auto found = run.counters.find("bounded"); found != run.counters.end())
                    bounded[name] = found->second.value != 0;
            }
        }
        ConsoleReporter::ReportRuns(runs);
    }
    [[nodiscard]] double median(const std::string& name) const { return median_of(cpu_ms.at(name)); }
    std::map<std::string, std::vector<double>> cpu_ms;
    std::map<std::string, bool> bounded;
};

const Feature kCheap[] = {Feature::chi2, Feature::hellinger, Feature::marginal, Feature::centroid,
                          Feature::jacobian_frobenius};
const float kLimits[] = {0.5F, 1.0F, 2.0F};

std::string map_name(Feature feature, const char* how) { return std::string(algo::name_of(feature)) + "/" + how; }

std::string verdict_name(float limit, const char* maps) { return "verdict/" + std::to_string(limit) + "/" + maps; }

void print_tables(const Collected& seen) {
    const double sum = seen.median("bytes summed");
    std::printf("\nWhole maps of the frame, samples to values: CPU time, median, one thread. Bytes summed: %.2f ms\n\n",
                sum);
    std::printf(
        "| feature | here, ms | of the sum | AVX2, ms | of the sum | portable, ms | of the sum "
        "|\n|---|---|---|---|---|---|---|\n");
    for (const Feature f : kCheap) {
        std::printf("| %s |", std::string(algo::name_of(f)).c_str());
        for (const char* how : {"here", "avx2", "portable"}) {
            const double ms = seen.median(map_name(f, how));
            std::printf(" %.1f | %.1fx |", ms, ms / sum);
        }
        std::printf("\n");
    }
    std::printf(
        "\nTwo threads against one: elapsed time. What the machine gives: two maps at once by one thread each, which "
        "share nothing, against one after the\n"
        "other. Quietest: of all runs; median: of the ratios of runs one right after the other\n\n"
        "| feature | one, ms | two, ms | quietest | median | the machine gives, quietest | median "
        "|\n|---|---|---|---|---|---|---|\n");
    for (const auto& [f, t] : of_threads) {
        const auto ratios = [&t = t](const std::vector<double>& of, double maps) {
            std::vector<double> all;
            for (std::size_t k = 0; k < of.size(); ++k) all.push_back(maps * t.one_ms[k] / of[k]);
            return median_of(all);
        };
        const auto least = [](const std::vector<double>& all) { return *std::min_element(all.begin(), all.end()); };
        const double one = least(t.one_ms), two = least(t.two_ms);
        std::printf("| %s | %.1f | %.1f | %.2fx | %.2fx | %.2fx | %.2fx |\n", std::string(algo::name_of(f)).c_str(),
                    one, two, one / two, ratios(t.two_ms, 1), 2 * one / least(t.maps_ms), ratios(t.maps_ms, 2));
    }
    std::printf(
        "\nA verdict (CPU time of a whole inspection, median, one thread), by bounds and with the exact map of the "
        "EMD; "
        "the exact map alone takes %.0f ms\n\n"
        "| limit, bins | verdict, ms | with the exact map, ms | ratio | a limit of work was reached |\n"
        "|---|---|---|---|---|\n",
        seen.median(map_name(Feature::emd, "here")));
    for (const float limit : kLimits) {
        const std::string judged = verdict_name(limit, "judged"), exact = verdict_name(limit, "exact");
        std::printf("| %.1f | %.1f | %.1f | %.2fx | %s |\n", static_cast<double>(limit), seen.median(judged),
                    seen.median(exact), seen.median(judged) / seen.median(exact),
                    seen.bounded.at(judged) ? "yes" : "no");
    }
}

}  // namespace
}  // namespace hord::bench

int main(int argc, char** argv) {
    using namespace hord;
    using namespace hord::bench;
    if (image().empty()) {
        std::printf("no bench/frame_555_9x9.png below %s: set HORD_DATA\n", data_dir().c_str());
        return 0;
    }
    const auto add = [](const std::string& name, auto run) {
        return benchmark::RegisterBenchmark(name.c_str(), run)
            ->Unit(benchmark::kMillisecond)
            ->Repetitions(31)
            ->MinTime(0.02)
            ->MeasureProcessCPUTime();
    };
    add("bytes summed", bytes_summed);
    for (const Feature f : kCheap) {
        add(map_name(f, "here"), [f](benchmark::State& s) { feature_map(s, f, hord::algo::best_isa()); });
        add(map_name(f, "avx2"),
            [f](benchmark::State& s) { feature_map(s, f, hord::algo::has(Isa::avx2) ? Isa::avx2 : Isa::portable); });
        add(map_name(f, "portable"), [f](benchmark::State& s) { feature_map(s, f, Isa::portable); });
    }
    add(map_name(Feature::emd, "here"),
        [](benchmark::State& s) { feature_map(s, Feature::emd, hord::algo::best_isa()); });
    for (const Feature f : {Feature::emd, Feature::chi2, Feature::jacobian_frobenius}) {
        benchmark::RegisterBenchmark(map_name(f, "threads").c_str(), [f](benchmark::State& s) {
            threads(s, f);
        })->Iterations(f == Feature::emd ? 50 : 400);
    }
    for (const float limit : kLimits) {
        add(verdict_name(limit, "judged"),
            [limit](benchmark::State& s) { verdict(s, limit, hord::algo::MapSet::judged); });
        add(verdict_name(limit, "exact"),
            [limit](benchmark::State& s) { verdict(s, limit, hord::algo::MapSet::exact); });
    }
    std::vector<char*> arguments(argv, argv + argc);
    std::string interleave = "--benchmark_enable_random_interleaving=true";
    arguments.push_back(interleave.data());
    int count = static_cast<int>(arguments.size());
    benchmark::Initialize(&count, arguments.data());
    Collected seen;
    benchmark::RunSpecifiedBenchmarks(&seen);
    try {
        print_tables(seen);
    } catch (const std::out_of_range&) {
        std::printf("\n(no table: --benchmark_filter left some benchmarks out)\n");
    }
}
