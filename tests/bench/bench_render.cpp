// Ray tracing speed of the simulated cell, compared with POV-Ray on the same scene in the same run (./dev bench).
//
// Scene: the double-convex lens of hal_sim/scenes/lens.toml before a collimated source of 0.61 bins at infinity, no
// Fresnel losses.
//   rays     999x999 parallel rays of one direction, slopes (0.009, 0.003). POV-Ray: an orthographic camera without
//            antialiasing; the time of 9x9 rays (start, parse) is subtracted. Here: trace_many(), one call a row, and
//            for comparison trace(), one call a ray. The share of rays that reach the source must be the same.
//   frames   555x555 lenslets x 9x9 bins. POV-Ray's time is computed from its speed, for 16 rays a bin.
// All times are CPU times of one thread. Rounds are interleaved and medians printed, so that other load on the machine
// affects both alike.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <sys/resource.h>

#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/trace/trace.h"

namespace {

using namespace hord;
using namespace hord::sim;
using Clock = std::chrono::steady_clock;

constexpr int kSide = 999, kRounds = 5;

// CPU time of this process, or of those that it has started and waited for.
double cpu_seconds(int whose) {
    rusage used{};
    getrusage(whose, &used);
    return static_cast<double>(used.ru_utime.tv_sec) + 1e-6 * static_cast<double>(used.ru_utime.tv_usec);
}
double median(std::vector<double> of) {
    std::sort(of.begin(), of.end());
    return of[of.size() / 2];
}

// x right, y down, z towards the camera; POV-Ray's own y is up. Source: the part of the sky within the source's radius.
const char* const kPovScene = R"(#version 3.7;
global_settings { assumed_gamma 1 max_trace_level 16 }
#declare R = 190; #declare A = 10; #declare H = 2 + R - sqrt(R*R - A*A);
camera { orthographic location <-9,3,1000> direction <0.009,-0.003,-1> right 24*x up 24*y }
sky_sphere { pigment { function { select(x*x + y*y - 0.00915*0.00915, 1, 0) } color_map { [0 rgb 0] [1 rgb 1] } } }
intersection { sphere { <0,0,H-R>, R } sphere { <0,0,R-H>, R } cylinder { <0,0,-3>, <0,0,3>, A }
  pigment { rgbt 1 } finish { ambient 0 diffuse 0 reflection 0 } interior { ior 1.5 } }
)";

double pov_seconds(const std::filesystem::path& scene, int side, const std::string& output = "-F") {
    const std::string command = "povray +I" + scene.string() + " " + output + " +W" + std::to_string(side) + " +H" +
        std::to_string(side) + " -A -D -GA +WT1 >/dev/null 2>&1";
    const double start = cpu_seconds(RUSAGE_CHILDREN);
    const int status = std::system(command.c_str());
    return status == 0 ? cpu_seconds(RUSAGE_CHILDREN) - start : -1;
}

// The share of white pixels in the picture that POV-Ray writes; negative if it fails.
double pov_lit(const std::filesystem::path& scene) {
    const auto picture = scene.parent_path() / "lens.ppm";
    if (pov_seconds(scene, kSide, "+FP +O" + picture.string()) < 0) return -1;
    std::ifstream in(picture, std::ios::binary);
    const std::string bytes(std::istreambuf_iterator<char>(in), {});
    const std::size_t samples = std::size_t{3} * kSide * kSide;
    if (bytes.size() < samples) return -1;
    return static_cast<double>(std::count_if(bytes.end() - static_cast<std::ptrdiff_t>(samples), bytes.end(),
                                             [](char c) { return static_cast<unsigned char>(c) > 127; })) /
        static_cast<double>(samples);
}

struct Traced {
    double seconds, lit;
};
Traced trace_rows(const Body& body, bool side_by_side) {
    std::vector<CameraRay> rays(kSide);
    std::vector<Arrival> arrivals(kSide);
    const double start = cpu_seconds(RUSAGE_SELF);
    double lit = 0;
    for (int y = 0; y < kSide; ++y) {
        for (int x = 0; x < kSide; ++x)
            rays[static_cast<std::size_t>(x)] = {(x - 499) * 24.0 / kSide, (y - 499) * 24.0 / kSide, 0.009, 0.003};
        if (side_by_side) trace_many(body, rays, arrivals.data());
        else
            std::transform(rays.begin(), rays.end(), arrivals.begin(),
                           [&](const CameraRay& ray) { return trace(body, ray); });
        for (const Arrival& out : arrivals) lit += out.u * out.u + out.v * out.v < 0.00915 * 0.00915 ? out.weight : 0;
    }
    return {cpu_seconds(RUSAGE_SELF) - start, lit / kSide / kSide};
}

}  // namespace

int main() {
    Scene scene;
    scene.part = DoubleConvexLens{};
    const Body body = body_of(scene, true);
    const auto folder = std::filesystem::temp_directory_path() /
        ("hord_bench_render_" + std::to_string(Clock::now().time_since_epoch().count()));
    std::filesystem::create_directory(folder);
    std::ofstream(folder / "lens.pov") << kPovScene;

    std::vector<double> here, alone, peer, start;
    const double lit = trace_rows(body, true).lit, peer_lit = pov_lit(folder / "lens.pov");
    for (int round = 0; round < kRounds; ++round) {
        here.push_back(trace_rows(body, true).seconds);
        alone.push_back(trace_rows(body, false).seconds);
        start.push_back(pov_seconds(folder / "lens.pov", 9));
        peer.push_back(pov_seconds(folder / "lens.pov", kSide));
    }
    Scene large = scene;
    large.camera.extents = {555, 555, 9, 9};
    const double begin = cpu_seconds(RUSAGE_SELF);
    const auto field = render(large, {1, {}});
    const double frame = cpu_seconds(RUSAGE_SELF) - begin;
    std::filesystem::remove_all(folder);
    if (!field) return 1;

    const double rays = static_cast<double>(kSide) * kSide, bins = 555.0 * 555 * 81;
    std::printf("\nOne thread: %.2f million rays a second here (one by one %.2f)", rays / median(here) * 1e-6,
                rays / median(alone) * 1e-6);
    const double pov = median(peer) - median(start);
    if (median(start) <= 0 || pov <= 0) {
        std::printf("; POV-Ray cannot be run: apt-get install povray\n");
    } else {
        std::printf(", POV-Ray %.2f: %.1fx (one by one %.1fx)\n", rays / pov * 1e-6, pov / median(here),
                    pov / median(alone));
        std::printf("of these rays %.2f %% reach the source here, %.2f %% through POV-Ray\n", 100 * lit,
                    100 * peer_lit);
    }
    std::printf("555x555 x 9x9 bins: %.1f s of CPU time; 16 rays a bin in that time are %.1f million a second\n", frame,
                bins * 16 / frame * 1e-6);
    if (median(start) > 0 && pov > 0)
        std::printf("POV-Ray at 16 rays a bin, at its speed above: %.0f s: %.0fx\n", bins * 16 * pov / rays,
                    bins * 16 * pov / rays / frame);
}
