#include "lab/tradeoff/tradeoff_parts.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "hal_sim/optics/scene/noise.h"

namespace hord::lab {
namespace {

constexpr double kPitchMm = 0.1, kReferenceBinRad = 0.015;
constexpr double kIndex = 1.5, kInclusionIndex = 1.52, kReadNoiseE = 2, kJitterLenslets = 0.1;
constexpr double kHazeRad = 0.015, kHazeRadius = 1.2;
constexpr int kDefectsAPart = 4, kSampleBits = 16;

enum Stream : std::uint32_t { kGoodParts = 0x600D, kBadParts = 0xBAD0 };

sim::Scene scene_of(const TradeoffPoint& point) {
    sim::Scene scene;
    scene.name = point.key();
    const double focal_mm = 2 * kPitchMm / (kReferenceBinRad * point.slope);
    const int margin = 3;
    scene.part = sim::CylinderLens{(kIndex - 1) * focal_mm, 0.5 * kPitchMm * (kColumns * point.stride + 2 * margin),
                                   0.5 * kPitchMm * (kRows * point.stride + 2 * margin), 1.0, kIndex};
    scene.camera.extents = {kColumns * point.stride, kRows * point.stride, point.bins, point.bins};
    scene.camera.field_mm = kColumns * point.stride * kPitchMm;
    scene.camera.bin_pitch_rad = 1e-3 * point.range_mrad / point.bins;
    scene.camera.bits = kSampleBits;
    scene.camera.full_bin_dn = 65535;  // set by every exposure
    scene.light.source_radius_bins = 1e-3 * point.source_mrad / scene.camera.bin_pitch_rad;
    scene.noise.electrons_per_dn = 1;
    scene.noise.read_e = kReadNoiseE;
    return scene;
}

double nominal_x_mm(int place) { return kPitchMm * place / kPlaces; }

sim::LightField every(const sim::LightField& field, int stride) {
    if (stride == 1) return field;
    const algo::Extents& e = field.extents;
    sim::LightField few{{e.m / stride, e.n / stride, e.i, e.j}, {}};
    const int first = stride / 2;
    for (int n = 0; n < few.extents.n; ++n) {
        for (int j = 0; j < e.j; ++j) {
            const auto row =
                static_cast<std::size_t>((first + n * stride) * e.j + j) * static_cast<std::size_t>(e.width_px());
            for (int m = 0; m < few.extents.m; ++m) {
                const float* from = field.bins.data() + row + (first + m * stride) * e.i;
                few.bins.insert(few.bins.end(), from, from + e.i);
            }
        }
    }
    return few;
}

// A scene with four defects, one in each quarter of the strip, at least two used lenslets from its edge.
std::vector<PlacedDefect> add_defects(sim::Scene& scene, Family family, int stride, sim::Noise& draw) {
    std::vector<PlacedDefect> placed;
    const auto f = static_cast<std::size_t>(family);
    for (int k = 0; k < kDefectsAPart; ++k) {
        const double m = 1.5 + (kColumns - 4) * draw.uniform(),
                     n = kRows / kDefectsAPart * (k + 0.5) - 1 + draw.uniform();
        const double size = kSmallest[f] * std::pow(kLargest[f] / kSmallest[f], draw.uniform());
        placed.push_back({m, n, size});
        if (family == Family::haze) continue;
        // Converts positions: from used lenslets to all lenslets, and from these to the part's frame.
        const double x = (stride / 2 + m * stride - 0.5 * (kColumns * stride - 1)) * kPitchMm - scene.pose.x_mm;
        const double y = (stride / 2 + n * stride - 0.5 * (kRows * stride - 1)) * kPitchMm - scene.pose.y_mm;
        if (family == Family::bubble) {
            scene.defects.emplace_back(sim::AirBubble{{x, y, 0}, size * kPitchMm});
        } else {
            scene.defects.emplace_back(sim::Inclusion{{x, y, 0}, size * kPitchMm, kInclusionIndex});
        }
    }
    return placed;
}

// Spreads a share of the light of the lenslets in reach over the bins around it; light that leaves the bins is lost.
void add_haze(sim::LightField& light, const std::vector<PlacedDefect>& defects, double bin_rad) {
    const algo::Extents& e = light.extents;
    const double sigma = kHazeRad / bin_rad;
    std::vector<double> weight;  // of a distance in bins, along one axis
    for (int d = 0; d < e.i; ++d)
        weight.push_back(0.5 *
                         (std::erf((d + 0.5) / (sigma * std::numbers::sqrt2)) -
                          std::erf((d - 0.5) / (sigma * std::numbers::sqrt2))));
    for (const PlacedDefect& defect : defects) {
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                if (std::hypot(m - defect.m, n - defect.n) > kHazeRadius) continue;
                const auto bin = [&](int i, int j) -> float& {
                    return light.bins[static_cast<std::size_t>(n * e.j + j) * static_cast<std::size_t>(e.width_px()) +
                                      static_cast<std::size_t>(m * e.i + i)];
                };
                std::vector<double> spread(static_cast<std::size_t>(e.bins()));
                for (int k = 0; k < e.bins(); ++k) {
                    const auto from = static_cast<double>(bin(k % e.i, k / e.i));
                    for (int l = 0; from > 0 && l < e.bins(); ++l) {
                        spread[static_cast<std::size_t>(l)] += from *
                            weight[static_cast<std::size_t>(std::abs(l % e.i - k % e.i))] *
                            weight[static_cast<std::size_t>(std::abs(l / e.i - k / e.i))];
                    }
                }
                for (int k = 0; k < e.bins(); ++k) {
                    float& value = bin(k % e.i, k / e.i);
                    value = static_cast<float>((1 - defect.size) * static_cast<double>(value) +
                                               defect.size * spread[static_cast<std::size_t>(k)]);
                }
            }
        }
    }
}

}  // namespace

std::string TradeoffPoint::key() const {
    std::string key =
        fmt::format("bins {} slope {:g} photons {} frames {} stride {}", bins, slope, photons, frames, stride);
    if (range_mrad != TradeoffPoint{}.range_mrad) key += fmt::format(" range {:g}", range_mrad);
    if (source_mrad != TradeoffPoint{}.source_mrad) key += fmt::format(" source {:g}", source_mrad);
    return key;
}

Result<TradeoffParts> trace_parts(const TradeoffPoint& point, const PartCounts& counts, std::uint64_t seed, int threads,
                                  const std::function<void(double)>& progress) {
    TradeoffParts parts;
    parts.scene = scene_of(point);
    const int families = static_cast<int>(kFamilies), total = kPlaces + counts.good + families * counts.bad_of_a_family;
    int done = 0;
    const auto traced = [&](const sim::Scene& scene) -> Result<sim::LightField> {
        auto light = sim::render(scene, {threads, {}});
        if (!light) return tl::unexpected(light.error());
        progress(static_cast<double>(++done) / total);
        return every(*light, point.stride);
    };
    const auto lie = [&](sim::Scene& scene, int place, sim::Noise& draw) {
        scene.pose.x_mm = nominal_x_mm(place) + kJitterLenslets * kPitchMm * (2 * draw.uniform() - 1);
        scene.pose.y_mm = kJitterLenslets * kPitchMm * (2 * draw.uniform() - 1);
    };
    for (int place = 0; place < kPlaces; ++place) {
        sim::Scene scene = parts.scene;
        scene.pose.x_mm = nominal_x_mm(place);
        auto light = traced(scene);
        if (!light) return tl::unexpected(light.error());
        parts.nominal.push_back(std::move(*light));
    }
    for (int k = 0; k < counts.good; ++k) {
        sim::Noise draw(seed, static_cast<std::uint64_t>(k), kGoodParts);
        sim::Scene scene = parts.scene;
        PartLight part;
        part.place = k % kPlaces;
        lie(scene, part.place, draw);
        auto light = traced(scene);
        if (!light) return tl::unexpected(light.error());
        part.light = std::move(*light);
        parts.good.push_back(std::move(part));
    }
    for (int k = 0; k < families * counts.bad_of_a_family; ++k) {
        sim::Noise draw(seed, static_cast<std::uint64_t>(k), kBadParts);
        sim::Scene scene = parts.scene;
        PartLight part;
        part.place = k / families % kPlaces;
        part.family = static_cast<Family>(k % families);
        lie(scene, part.place, draw);
        part.defects = add_defects(scene, part.family, point.stride, draw);
        auto light = traced(scene);
        if (!light) return tl::unexpected(light.error());
        part.light = std::move(*light);
        if (part.family == Family::haze) add_haze(part.light, part.defects, scene.camera.bin_pitch_rad);
        parts.bad.push_back(std::move(part));
    }
    return parts;
}

Frame expose_part(const TradeoffParts& parts, const sim::LightField& light, const TradeoffPoint& point,
                  std::uint64_t seed, std::uint64_t exposure) {
    sim::Scene scene = parts.scene;
    const double source_bins = std::numbers::pi * scene.light.source_radius_bins * scene.light.source_radius_bins;
    scene.camera.full_bin_dn = point.photons / source_bins;
    const auto turn = [&](int frame) {
        return seed * 0x9E3779B97F4A7C15U + exposure * 64 + static_cast<std::uint64_t>(frame);
    };
    Frame mean = sim::expose(light, scene, turn(0));
    if (point.frames == 1) return mean;
    const auto pixels = static_cast<std::size_t>(mean.width_px()) * static_cast<std::size_t>(mean.height_px());
    std::vector<std::uint32_t> sums(pixels);
    for (int f = 0; f < point.frames; ++f) {
        const Frame frame = f == 0 ? mean : sim::expose(light, scene, turn(f));
        for (std::size_t k = 0; k < pixels; ++k) sums[k] += frame.view().row16(0)[k];
    }
    const auto count = static_cast<std::uint32_t>(point.frames);
    for (std::size_t k = 0; k < pixels; ++k) mean.set(static_cast<int>(k), 0, (sums[k] + count / 2) / count);
    return mean;
}

Frame expose_exactly(const TradeoffParts& parts, const sim::LightField& light) {
    sim::Scene scene = parts.scene;
    scene.noise = {};
    const float brightest = std::max(1e-6F, *std::ranges::max_element(light.bins));
    scene.camera.full_bin_dn = 65000.0 / static_cast<double>(brightest);
    return sim::expose(light, scene, 1);
}

algo::LightLevels levels_at(const TradeoffPoint& point) {
    const double dark = 3 * kReadNoiseE / std::sqrt(static_cast<double>(point.frames));
    return {static_cast<std::uint32_t>(std::ceil(dark)), 20, 65535};
}

}  // namespace hord::lab
