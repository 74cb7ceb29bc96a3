// How the cost of a map grows with the number of lenslets, of bins, of lit bins, and with the read noise that exceeds
// the dark threshold. Usage: bench_growth OUT  writes OUT/growth.csv and prints the table. tests/bench/growth.gp plots
// it.
//
// Frames: a spot of light in every lenslet that moves smoothly over the field, at 8 bits and up to 250 DN, dark
// threshold 3 DN; 64x64 lenslets are drawn and repeated. `verdict`: a whole inspection with the default recipe
// (algo/inspection/pipeline.h). CPU time of one thread, with decoding. Every frame is measured once
// per round, so that other load affects all rows of the table alike; the median of the rounds counts.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "algo/maps/feature_map.h"

namespace {

using namespace hord;
using namespace hord::algo;

constexpr int kTile = 64;  // lenslets per side of the drawn tile
constexpr int kRounds = 5;
constexpr Feature kFeatures[] = {Feature::emd, Feature::chi2, Feature::jacobian_frobenius};
constexpr std::size_t kVerdict = std::size(kFeatures), kColumns = kVerdict + 1;

struct Scene {
    int lenslets = 256, bins = 9;
    double radius = 0.62;  // of the spot, bins
    double noise_dn = 0.6;
};

Frame drawn(const Scene& s) {
    std::mt19937_64 random(20261121);
    std::normal_distribution<double> noise(0, 1);
    const int tile_px = kTile * s.bins;
    std::vector<std::uint8_t> tile(static_cast<std::size_t>(tile_px) * static_cast<std::size_t>(tile_px));
    for (int y = 0; y < tile_px; ++y) {
        for (int x = 0; x < tile_px; ++x) {
            const int m = x / s.bins, n = y / s.bins;
            const double middle = (s.bins - 1) / 2.0, swing = 0.3 * s.bins, turn = 2 * std::acos(-1.0) / kTile;
            const double dx = x % s.bins - middle - swing * std::sin(turn * m),
                         dy = y % s.bins - middle - swing * std::cos(turn * n);
            const double dn =
                250 * std::exp(-(dx * dx + dy * dy) / (2 * s.radius * s.radius)) + s.noise_dn * noise(random);
            tile[static_cast<std::size_t>(y) * static_cast<std::size_t>(tile_px) + static_cast<std::size_t>(x)] =
                static_cast<std::uint8_t>(std::clamp(std::lround(dn), 0L, 254L));
        }
    }
    const int side_px = s.lenslets * s.bins;
    Frame frame(side_px, side_px, 8);
    for (int y = 0; y < side_px; ++y) {
        for (int x = 0; x < side_px; ++x) {
            frame.set(x, y,
                      tile[static_cast<std::size_t>(y % tile_px) * static_cast<std::size_t>(tile_px) +
                           static_cast<std::size_t>(x % tile_px)]);
        }
    }
    return frame;
}

double occupied_bins(const Frame& frame, const Extents& e) {
    std::size_t lit = 0;
    for (const std::byte b : frame.bytes()) lit += static_cast<int>(b) > 3 ? 1U : 0U;
    return static_cast<double>(lit) / static_cast<double>(e.lenslets());
}

double cpu_ns() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) * 1e9 + static_cast<double>(now.tv_nsec);
}

// A row of the table.
struct GrowthPoint {
    const char* series;
    std::string what;
    Scene scene;
    double lit = 0;
    std::vector<double> ns[kColumns] = {};  // per lenslet, one per round
};

bool measure_once(GrowthPoint& point) {
    const Scene& scene = point.scene;
    const Extents e{scene.lenslets, scene.lenslets, scene.bins, scene.bins};
    constexpr LightLevels kLevels{3, 16, 255};
    const Frame frame = drawn(scene);
    point.lit = occupied_bins(frame, e);
    // The first run pays for page faults; it counts only if they hardly matter.
    const auto measure = [&](std::size_t column, auto once) {
        if (scene.lenslets <= 512 && !once()) return false;
        const double start = cpu_ns();
        if (!once()) return false;
        point.ns[column].push_back((cpu_ns() - start) / static_cast<double>(e.lenslets()));
        return true;
    };
    for (std::size_t f = 0; f < std::size(kFeatures); ++f) {
        auto mapper = FeatureMapper::create(e, 8, kLevels, kFeatures[f]);
        if (!mapper || !measure(f, [&] { return mapper->over_neighbours(frame.view()).has_value(); })) return false;
    }
    Recipe recipe;
    recipe.part_required = false;
    auto pipeline = Pipeline::create(e, 8, recipe);
    return pipeline && measure(kVerdict, [&] { return pipeline->inspect(frame.view()).has_value(); });
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

void print(const GrowthPoint& p, std::ofstream& csv) {
    csv << p.series << ',' << p.scene.lenslets << ',' << p.scene.bins << ',' << p.lit << ',' << p.scene.noise_dn;
    std::printf("| %s | %s | %.1f |", p.series, p.what.c_str(), p.lit);
    for (const auto& ns : p.ns) {
        csv << ',' << median(ns);
        std::printf(" %.1f |", median(ns));
    }
    csv << '\n';
    std::printf("\n");
}

std::vector<GrowthPoint> all_points() {
    std::vector<GrowthPoint> points;
    const auto add = [&](const char* series, const std::string& what, const Scene& scene) {
        points.push_back({series, what, scene});
    };
    for (const int side : {64, 128, 256, 512, 1024, 2048})
        add("lenslets", std::to_string(side) + "x" + std::to_string(side), {.lenslets = side});
    for (int bins = 3; bins <= 15; ++bins)
        add("bins", std::to_string(bins) + "x" + std::to_string(bins), {.lenslets = 128, .bins = bins});
    for (const double radius : {0.15, 0.3, 0.45, 0.62, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0, 6.0}) {
        add("lit bins", "spot " + std::to_string(radius).substr(0, 4), {.lenslets = 128, .radius = radius});
    }
    for (const double noise : {0.0, 0.3, 0.6, 0.9, 1.2, 1.6, 2.0}) {
        add("noise", std::to_string(noise).substr(0, 3) + " DN", {.lenslets = 128, .noise_dn = noise});
    }
    return points;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: bench_growth OUT\n");
        return 2;
    }
    std::error_code error;
    std::filesystem::create_directories(argv[1], error);
    std::ofstream csv(std::filesystem::path(argv[1]) / "growth.csv");
    csv << "series,lenslets_a_side,bins_a_side,lit_bins,noise_dn";
    std::printf("| grows | to | lit bins a lenslet |");
    for (const Feature f : kFeatures) {
        csv << ',' << name_of(f) << "_ns_a_lenslet";
        std::printf(" %s, ns a lenslet |", std::string(name_of(f)).c_str());
    }
    csv << ",verdict_ns_a_lenslet\n";
    std::printf(" verdict, ns a lenslet |\n|---|---|---|---|---|---|---|\n");
    std::vector<GrowthPoint> points = all_points();
    for (int round = 0; round < kRounds; ++round) {
        for (GrowthPoint& point : points) {
            if (measure_once(point)) continue;
            std::fprintf(stderr, "bench_growth: no map of %s %s\n", point.series, point.what.c_str());
            return 1;
        }
    }
    for (const GrowthPoint& point : points) print(point, csv);
    if (csv.flush()) return 0;
    std::fprintf(stderr, "bench_growth: %s cannot be written: give a folder that may be written to\n", argv[1]);
    return 2;
}
