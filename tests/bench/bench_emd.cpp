// Speed of the exact earth mover's distance, compared with stock solvers in the same run (./dev bench).
//
// Work: every pair of neighbouring lit lenslets of two frames of 555x555 lenslets and 9x9 bins, dark threshold 3 DN:
// frame_555_9x9.png (from $HORD_DATA/bench or ../shared/data/bench), and the lens with a bubble of
// hal_sim/scenes/bubble.toml, rendered here, with 0.6 DN of read noise. And synthetic pairs of 9x9 bins: two lobes,
// about 37 lit bins, and dense (81). Our solver gets whole frames, row by row, from decoded HORDs as in a station; the
// peers are too slow for that and get a random subset of the pairs. All figures are CPU time per pair. Repetitions of
// all benchmarks are interleaved and tables show medians, so that other load on the machine affects all alike.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <random>
#include <stdexcept>
#include <string>

#include <benchmark/benchmark.h>
#include <opencv2/imgcodecs.hpp>

#include "algo/emd/emd_solver.h"
#include "hal_sim/optics/camera/render.h"
#include "tests/bench/peers.h"

namespace hord::bench {
namespace {

using algo::Hord;
using Pair = std::pair<Hord, Hord>;

constexpr int kBins = 9;
constexpr int kPeerPairs = 3000;  // of the frame
constexpr unsigned kSeed = 20261121;
constexpr int kRepetitions = 31;  // many and short: a load peak of the machine affects all benchmarks alike

// Consecutive lenslets of 9x9 bins.
struct Field {
    std::vector<std::uint16_t> mass;
    std::vector<std::uint32_t> sum;
    std::vector<std::uint16_t>& add() {
        lenslet.assign(kBins * kBins, 0);
        return lenslet;
    }
    void close() {
        std::uint32_t total = 0;
        for (const auto m : lenslet) total += m;
        mass.insert(mass.end(), lenslet.begin(), lenslet.end());
        sum.push_back(total);
    }
    [[nodiscard]] Hord at(std::size_t k) const { return {mass.data() + k * kBins * kBins, sum[k]}; }
    std::vector<std::uint16_t> lenslet;
};

struct Work {
    int columns = 0;  // lenslets per row of a frame; 0 for synthetic pairs
    Field field;
    std::vector<Pair> pairs;
    std::vector<Pair> for_peers;
    double lit = 0;  // mean number of lit bins
};

std::filesystem::path data_dir() {
    const char* given = std::getenv("HORD_DATA");
    return given != nullptr ? std::filesystem::path(given) : std::filesystem::path(HORD_SOURCE_DIR) / "../shared/data";
}

void finish(Work& work, std::size_t peer_pairs) {
    std::mt19937_64 random(kSeed);
    std::sample(work.pairs.begin(), work.pairs.end(), std::back_inserter(work.for_peers), peer_pairs, random);
    for (const auto& m : work.field.mass) work.lit += m > 0 ? 1.0 : 0.0;
    work.lit /= static_cast<double>(work.field.sum.size());
}

Work frame_work(const FrameView& frame) {
    Work work;
    const int m = frame.width_px / kBins, n = frame.height_px / kBins;
    work.columns = m;
    for (int y = 0; y < n; ++y) {
        for (int x = 0; x < m; ++x) {
            auto& h = work.field.add();
            for (int k = 0; k < kBins * kBins; ++k) {
                const auto dn = frame.sample(x * kBins + k % kBins, y * kBins + k / kBins);
                h[static_cast<std::size_t>(k)] = static_cast<std::uint16_t>(dn <= 3 ? 0 : dn);
            }
            work.field.close();
        }
    }
    const auto add = [&](int x0, int y0, int x1, int y1) {
        if (x1 >= m || y1 >= n) return;
        const Hord a = work.field.at(static_cast<std::size_t>(y0 * m + x0)),
                   b = work.field.at(static_cast<std::size_t>(y1 * m + x1));
        if (a.sum > 0 && b.sum > 0) work.pairs.emplace_back(a, b);
    };
    for (int y = 0; y < n; ++y) {
        for (int x = 0; x < m; ++x) {
            add(x, y, x + 1, y);
            add(x, y, x, y + 1);
        }
    }
    finish(work, kPeerPairs);
    return work;
}

// No pairs if the frame is missing.
Work stored_frame() {
    const cv::Mat image = cv::imread((data_dir() / "bench/frame_555_9x9.png").string(), cv::IMREAD_UNCHANGED);
    if (image.empty()) return {};
    return frame_work({reinterpret_cast<const std::byte*>(image.data), image.cols, image.rows,
                       static_cast<std::ptrdiff_t>(image.step), 8});
}

Work lens_with_bubble() {
    auto scene = sim::load_scene(std::filesystem::path(HORD_SOURCE_DIR) / "hal_sim/scenes/bubble.toml");
    if (!scene) throw std::runtime_error(scene.error().what);
    scene->camera.extents = {555, 555, kBins, kBins};
    scene->noise.electrons_per_dn = 40;
    scene->noise.read_e = 0.6 * scene->noise.electrons_per_dn;
    scene->noise.photon_noise = false;
    const auto light = sim::render(*scene);
    if (!light) throw std::runtime_error(light.error().what);
    const Frame frame = sim::expose(*light, *scene, kSeed);
    return frame_work(frame.view());
}

// light(i, j) in 0..1 is drawn for each lenslet; consecutive lenslets are a pair.
template <class Light>
Work synthetic(std::size_t pairs, std::size_t peer_pairs, Light draw) {
    Work work;
    std::mt19937_64 random(kSeed);
    std::normal_distribution<double> noise(0.0, 0.6);
    for (std::size_t k = 0; k < 2 * pairs; ++k) {
        const auto light = draw(random, k);
        auto& h = work.field.add();
        for (int bin = 0; bin < kBins * kBins; ++bin) {
            const double dn = 250 * light(bin % kBins, bin / kBins) + noise(random);
            h[static_cast<std::size_t>(bin)] =
                dn <= 3 ? std::uint16_t{0} : static_cast<std::uint16_t>(std::min(dn, 255.0));
        }
        work.field.close();
    }
    for (std::size_t k = 0; k < pairs; ++k) work.pairs.emplace_back(work.field.at(2 * k), work.field.at(2 * k + 1));
    finish(work, peer_pairs);
    return work;
}

double gauss(double x, double y, double radius) { return std::exp(-(x * x + y * y) / (2 * radius * radius)); }

Work two_lobes() {
    return synthetic(4000, 500, [](auto& random, std::size_t) {
        std::uniform_real_distribution<double> at(2.0, 6.0), share(0.3, 0.7);
        const double x0 = at(random), y0 = at(random), x1 = at(random), y1 = at(random), s = share(random);
        return [=](int i, int j) { return s * gauss(i - x0, j - y0, 0.5) + (1 - s) * gauss(i - x1, j - y1, 0.5); };
    });
}
// Enough pairs that each shape of a problem is frequent, as in a frame.
Work mid() {
    return synthetic(4000, 100, [](auto& random, std::size_t) {
        std::uniform_real_distribution<double> at(3.5, 4.5);
        const double x0 = at(random), y0 = at(random);
        return [=, &random](int i, int j) {
            std::uniform_real_distribution<double> level(0.5, 1.0);
            const double r = std::hypot(i - x0, j - y0);
            return r > 3.45 ? 0.0 : gauss(i - x0, j - y0, 2.5) * level(random);
        };
    });
}
Work dense() {
    return synthetic(300, 20, [](auto& random, std::size_t) {
        return [&random](int, int) { return std::uniform_real_distribution<double>(0.02, 1.0)(random); };
    });
}

const Work& work_named(const std::string& name) {
    static std::map<std::string, Work> made;
    if (const auto found = made.find(name); found != made.end()) return found->second;
    return made[name] = name == "frame" ? stored_frame()
        : name == "lens with bubble"    ? lens_with_bubble()
        : name == "two-lobe"            ? two_lobes()
        : name == "mid"                 ? mid()
                                        : dense();
}

const algo::GroundDistance& ground() {
    static const auto made = *algo::GroundDistance::between_bins(kBins, kBins);
    return made;
}

void per_pair(benchmark::State& state, std::size_t pairs) {
    state.counters["ns_a_pair"] = benchmark::Counter(
        static_cast<double>(pairs) * 1e-9, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void ours_frame(benchmark::State& state, const Work& work, algo::Isa isa);

void ours(benchmark::State& state, const std::string& name, algo::Isa isa) {
    if (work_named(name).columns > 0) return ours_frame(state, work_named(name), isa);
    const auto& pairs = work_named(name).pairs;
    auto solver = *algo::EmdSolver::create(ground(), isa);
    std::vector<double> out(pairs.size());
    for (auto _ : state) {
        for (std::size_t k = 0; k < pairs.size(); ++k) solver.submit(pairs[k].first, pairs[k].second, &out[k]);
        solver.finish();
        benchmark::ClobberMemory();
    }
    per_pair(state, pairs.size());
}

void fetch(const Hord& h) {
    constexpr int kLine = algo::kAlignment / sizeof(h.mass[0]);
    for (int k = 0; k < kBins * kBins; k += kLine) __builtin_prefetch(h.mass + k);
}

// The whole frame as in a station: each row of lenslets is compacted and compared with itself and with the row above. A
// station has just decoded its rows into the cache; here the next row is prefetched from memory.
void ours_frame(benchmark::State& state, const Work& work, algo::Isa isa) {
    const auto m = static_cast<std::size_t>(work.columns), n = work.field.sum.size() / m;
    auto solver = *algo::EmdSolver::create(ground(), isa);
    std::vector<double> out(2 * m * n);
    algo::AlignedVector<algo::SparseHord> here(m), above(m);
    for (auto _ : state) {
        double* to = out.data();
        for (std::size_t y = 0; y < n; ++y) {
            std::swap(here, above);
            solver.compact()(work.field.at(y * m).mass, std::span(work.field.sum).subspan(y * m, m), kBins * kBins,
                             here.data());
            for (std::size_t x = 0; x < m; ++x) {
                if (y + 1 < n) fetch(work.field.at((y + 1) * m + x));
                if (x > 0) solver.submit(here[x - 1], here[x], to++);
                if (y > 0) solver.submit(above[x], here[x], to++);
            }
        }
        solver.finish();
        benchmark::ClobberMemory();
    }
    per_pair(state, work.pairs.size());
}

template <class Peer>
void peer(benchmark::State& state, const std::string& name, Peer solver) {
    const auto& pairs = work_named(name).for_peers;
    for (auto _ : state) {
        for (const auto& [a, b] : pairs) benchmark::DoNotOptimize(solver.distance(a, b));
    }
    per_pair(state, pairs.size());
}

// Collects the median of every benchmark.
class Medians : public benchmark::ConsoleReporter {
  public:
    void ReportRuns(const std::vector<Run>& runs) override {
        for (const Run& run : runs) {
            if (run.run_type == Run::RT_Aggregate && run.aggregate_name == "median") {
                ns_a_pair[run.run_name.function_name] = run.counters.at("ns_a_pair").value;
            }
        }
        ConsoleReporter::ReportRuns(runs);
    }
    std::map<std::string, double> ns_a_pair;
};

const char* const kPeers[] = {"cv, zeros skipped", "cv, cancelled", "LEMON, zeros skipped"};

void print_table(const std::map<std::string, double>& ns, const std::vector<std::string>& works) {
    std::printf(
        "\nExact earth mover's distance, Euclidean ground, 9x9 bins: CPU time a pair, median, one thread\n\n"
        "| pairs | lit bins | here, ns | portable, ns | %s | %s | %s | against the best "
        "|\n|---|---|---|---|---|---|---|---|\n",
        kPeers[0], kPeers[1], kPeers[2]);
    for (const auto& work : works) {
        const double here = ns.at(work + "/here");
        std::printf("| %s | %.1f | %.1f | %.1f |", work.c_str(), work_named(work).lit, here, ns.at(work + "/portable"));
        double best = INFINITY;
        for (const char* name : kPeers) {
            const double other = ns.at(work + "/" + name);
            best = std::min(best, other);
            std::printf(" %.0f ns = %.1fx |", other, other / here);
        }
        std::printf(" %.1fx |\n", best / here);
    }
    std::printf("\n");
    for (const auto& work : works) {
        if (work_named(work).columns == 0) continue;
        const double pairs = static_cast<double>(work_named(work).pairs.size());
        std::printf("%s: %.0f pairs in %.1f ms on one core; peers from a random %d of them.\n", work.c_str(), pairs,
                    pairs * ns.at(work + "/here") * 1e-6, kPeerPairs);
    }
}

}  // namespace
}  // namespace hord::bench

int main(int argc, char** argv) {
    using namespace hord;
    using namespace hord::bench;
    using hord::algo::Isa;
    std::vector<std::string> works = {"frame", "lens with bubble", "two-lobe", "mid", "dense"};
    if (work_named("frame").pairs.empty()) {
        std::printf("no bench/frame_555_9x9.png below %s: set HORD_DATA; measuring the others only\n",
                    data_dir().c_str());
        works.erase(works.begin());
    }
    for (const auto& work : works) {
        const auto add = [&](const std::string& name, auto run) {
            benchmark::RegisterBenchmark((work + "/" + name).c_str(), run)
                ->Unit(benchmark::kMillisecond)
                ->Repetitions(kRepetitions)
                ->MinTime(0.02)
                ->ReportAggregatesOnly();
        };
        add("here", [work](benchmark::State& s) { ours(s, work, hord::algo::best_isa()); });
        add("avx2", [work](benchmark::State& s) {
            hord::algo::has(Isa::avx2) ? ours(s, work, Isa::avx2) : s.SkipWithError("no AVX2");
        });
        add("portable", [work](benchmark::State& s) { ours(s, work, Isa::portable); });
        add(kPeers[0], [work](benchmark::State& s) { peer(s, work, CvPeer(ground(), false)); });
        add(kPeers[1], [work](benchmark::State& s) { peer(s, work, CvPeer(ground(), true)); });
        add(kPeers[2], [work](benchmark::State& s) { peer(s, work, LemonPeer(ground())); });
    }
    std::vector<char*> arguments(argv, argv + argc);
    std::string interleave = "--benchmark_enable_random_interleaving=true";
    arguments.push_back(interleave.data());
    int count = static_cast<int>(arguments.size());
    benchmark::Initialize(&count, arguments.data());
    Medians medians;
    benchmark::RunSpecifiedBenchmarks(&medians);
    try {
        print_table(medians.ns_a_pair, works);
    } catch (const std::out_of_range&) {
        std::printf("\n(no table: --benchmark_filter left some benchmarks out)\n");
    }
}
