// The cost of decoding raw frames at paper size (555 x 555 lenslets, 9 x 9 bins, 8 bit), against the macro-pixel
// path in the same run: that path is one inspection of bench/frame_555_9x9.png (from $HORD_DATA or ../shared/data), one
// thread. The raw frames are noise, of 9.4 px a lenslet, rotated by 3 degrees: their content does not change the work.
// CPU time; medians of interleaved repetitions.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <opencv2/imgcodecs.hpp>

#include "algo/frame/decode.h"
#include "algo/frame/regrid.h"
#include "algo/inspection/pipeline.h"
#include "tests/bench/medians.h"

namespace hord::bench {
namespace {

constexpr int kLenslets = 555, kBins = 9;
constexpr double kPitch = 9.4;

algo::LensletGrid grid_of(bool hexagonal) {
    algo::LensletGrid grid;
    grid.kind = hexagonal ? algo::LatticeKind::hexagonal : algo::LatticeKind::square;
    grid.stagger = hexagonal ? algo::Stagger::rows : algo::Stagger::none;
    grid.width_px = grid.height_px = static_cast<int>(kPitch * (kLenslets + 1));
    // A hexagonal lattice of the same number of lenslets has a longer pitch along its rows.
    const double pitch = hexagonal ? kPitch * 1.0745699318235 : kPitch;
    grid.columns = hexagonal ? 560 : kLenslets;
    grid.rows = hexagonal ? 640 : kLenslets;
    grid.origin_u = 0.5 * (grid.columns - 1);
    grid.origin_v = 0.5 * (grid.rows - 1) * (hexagonal ? 0.8660254037844386 : 1);
    grid.model = algo::GridModelKind::similarity;
    grid.parameters = {0.5 * grid.width_px, 0.5 * grid.height_px, pitch * 0.9986295, pitch * 0.0523360};
    return grid;
}

Frame noise(int side) {
    Frame frame(side, side, 8);
    std::uint32_t state = 1;
    for (std::byte& sample : frame.bytes())
        sample = static_cast<std::byte>((state = state * 1664525U + 1013904223U) >> 24U);
    return frame;
}

template <class Decoder>
void decode(benchmark::State& state, const Frame& raw, Decoder& decoder) {
    const algo::Extents& e = decoder.extents();
    std::vector<std::uint8_t> row(static_cast<std::size_t>(e.width_px()) * static_cast<std::size_t>(e.j));
    for (auto _ : state) {
        if constexpr (requires { decoder.begin_frame(); }) decoder.begin_frame();
        for (int n = 0; n < e.n; ++n) {
            decoder.decode_row(raw.view(), n, row.data(), e.width_px());
            benchmark::ClobberMemory();
        }
    }
}

}  // namespace
}  // namespace hord::bench

int main(int argc, char** argv) {
    using namespace hord;
    using namespace hord::bench;
    const char* given = std::getenv("HORD_DATA");
    const auto folder =
        given != nullptr ? std::filesystem::path(given) : std::filesystem::path(HORD_SOURCE_DIR) / "../shared/data";
    const cv::Mat macro = cv::imread((folder / "bench/frame_555_9x9.png").string(), cv::IMREAD_UNCHANGED);
    if (macro.empty() || macro.depth() != CV_8U) {
        std::printf("no bench/frame_555_9x9.png below %s: set HORD_DATA\n", folder.c_str());
        return 1;
    }
    const FrameView view{reinterpret_cast<const std::byte*>(macro.data), macro.cols, macro.rows,
                         static_cast<std::ptrdiff_t>(macro.step[0]), 8};
    const algo::Extents extents{kLenslets, kLenslets, kBins, kBins};
    auto pipeline = algo::Pipeline::create(extents, 8, {});
    const auto square = grid_of(false), hexagonal = grid_of(true);
    auto resampler = algo::Resampler::create(square, algo::even_layout(square, kBins, kBins));
    auto regridder = algo::Regridder::create(hexagonal, algo::even_layout(hexagonal, kBins, kBins));
    if (!pipeline || !resampler || !regridder) return 1;
    const Frame raw_square = noise(square.width_px), raw_hexagonal = noise(hexagonal.width_px);
    const auto add = [](const char* name, auto run) {
        benchmark::RegisterBenchmark(name, run)
            ->Unit(benchmark::kMillisecond)
            ->Repetitions(7)
            ->Iterations(1)
            ->ReportAggregatesOnly();
    };
    add("macro-pixel path", [&](benchmark::State& s) {
        for (auto _ : s) benchmark::DoNotOptimize(pipeline->inspect(view));
    });
    add("of it, splitting into HORDs", [&](benchmark::State& s) {
        algo::HordRow row(extents);
        for (auto _ : s) {
            for (int n = 0; n < extents.n; ++n) {
                algo::decode_row(view, extents, {3, 16, 255}, n, row);
                benchmark::ClobberMemory();
            }
        }
    });
    add("decode, square lattice", [&](benchmark::State& s) { decode(s, raw_square, *resampler); });
    add("decode, hexagonal lattice", [&](benchmark::State& s) { decode(s, raw_hexagonal, *regridder); });
    std::vector<char*> arguments(argv, argv + argc);
    std::string interleave = "--benchmark_enable_random_interleaving=true";
    arguments.push_back(interleave.data());
    int count = static_cast<int>(arguments.size());
    benchmark::Initialize(&count, arguments.data());
    Medians medians;
    benchmark::RunSpecifiedBenchmarks(&medians);
    const double path = medians.cpu_time["macro-pixel path"];
    std::printf(
        "\nDecode of raw frames at paper size, CPU time of one thread, median of 7\n\n| work | ms | of the macro-pixel "
        "path |\n|---|---|---|\n");
    for (const char* name :
         {"macro-pixel path", "of it, splitting into HORDs", "decode, square lattice", "decode, hexagonal lattice"}) {
        std::printf("| %s | %.1f | %.2f |\n", name, medians.cpu_time[name],
                    path > 0 ? medians.cpu_time[name] / path : 0.0);
    }
}
