// Time to fit a lenslet grid to a 5000 x 5000 px white frame, compared with the usual method for lenslet centres in the
// same run: OpenCV's Otsu threshold and the centroids of its connected components. libpleno works like that; the method
// yields no grid, model or error. CPU time of one thread, the frame in memory; repetitions of all benchmarks are
// interleaved, the table holds medians.
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/bench/medians.h"
#include "tests/calib/support/synthetic.h"

namespace hord::bench {
namespace {

struct Case {
    std::string name;
    bool hexagonal;
    double pitch_px;
};
const std::vector<Case> kCases{{"square 14.3 px", false, 14.3},
                               {"hexagonal 14.3 px", true, 14.3},
                               {"square 49.6 px", false, 49.6},
                               {"hexagonal 49.6 px", true, 49.6}};

Frame white_frame(const Case& of) {
    calib::test::White white;
    white.width_px = white.height_px = 5000;
    white.hexagonal = of.hexagonal;
    white.pitch_px = of.pitch_px;
    white.rotation_deg = of.hexagonal ? 7.3 : 9.8;
    white.shear = white.perspective_x = 0.002;
    white.perspective_y = -0.002;
    white.k1 = 0.004;
    white.dead_share = 0.02;
    return calib::test::draw(white).frame;
}

void ours(benchmark::State& state, const Frame& frame) {
    for (auto _ : state) {
        auto calibration = calib::calibrate_grid(frame.view());
        if (!calibration) state.SkipWithError(calibration.error().what.c_str());
        benchmark::DoNotOptimize(calibration);
    }
}

void peer(benchmark::State& state, const Frame& frame) {
    const FrameView view = frame.view();
    const cv::Mat raw(view.height_px, view.width_px, CV_16U, const_cast<std::byte*>(view.data));
    for (auto _ : state) {
        cv::Mat grey, lit, labels, statistics, centres;
        raw.convertTo(grey, CV_8U, 1.0 / 128);
        cv::threshold(grey, lit, 0, 255, cv::THRESH_BINARY | cv::THRESH_OTSU);
        benchmark::DoNotOptimize(cv::connectedComponentsWithStats(lit, labels, statistics, centres, 4));
    }
}

}  // namespace
}  // namespace hord::bench

int main(int argc, char** argv) {
    using namespace hord;
    using namespace hord::bench;
    cv::setNumThreads(1);
    std::vector<Frame> frames;
    for (const Case& of : kCases) frames.push_back(white_frame(of));
    for (std::size_t k = 0; k < kCases.size(); ++k) {
        const auto add = [&](const char* who, auto run) {
            benchmark::RegisterBenchmark((kCases[k].name + "/" + who).c_str(),
                                         [&frames, k, run](benchmark::State& s) { run(s, frames[k]); })
                ->Unit(benchmark::kMillisecond)
                ->Repetitions(5)
                ->Iterations(1)
                ->ReportAggregatesOnly();
        };
        add("here", ours);
        add("components", peer);
    }
    std::vector<char*> arguments(argv, argv + argc);
    std::string interleave = "--benchmark_enable_random_interleaving=true";
    arguments.push_back(interleave.data());
    int count = static_cast<int>(arguments.size());
    benchmark::Initialize(&count, arguments.data());
    Medians medians;
    benchmark::RunSpecifiedBenchmarks(&medians);
    std::printf(
        "\nGrid of a 5000 x 5000 px white frame: CPU time of one thread, median of 5\n\n"
        "| frame | here, ms | threshold and components, ms | ratio |\n|---|---|---|---|\n");
    for (const Case& of : kCases) {
        const auto here = medians.cpu_time.find(of.name + "/here"),
                   other = medians.cpu_time.find(of.name + "/components");
        if (here == medians.cpu_time.end() || other == medians.cpu_time.end()) continue;
        std::printf("| %s | %.0f | %.0f | %.2f |\n", of.name.c_str(), here->second, other->second,
                    here->second / other->second);
    }
}
