#include "lab/detection/detection_parts.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "algo/reference/read_noise.h"
#include "hal_sim/optics/scene/noise.h"

namespace hord::lab {
namespace {

constexpr double kPitchMm = 0.2, kBinRad = 0.015, kSourceBins = 0.61;
constexpr double kRoundSlope = 0.2, kRadiusLenslets = 9.5, kEdgeMm = 1;
constexpr int kField = 27, kStripColumns = 10, kStripRows = 24;
constexpr double kHazeShare = 0.1, kHazeBins = 1, kSpeckTransmission = 0.5;
constexpr double kDimpleCurvatureMm = 20, kScratchMm = 0.03;

double focal_mm(double slope) { return 2 * kPitchMm / (kBinRad * slope); }

void common(sim::Scene& scene) {
    scene.camera.bin_pitch_rad = kBinRad;
    scene.camera.bits = 12;
    scene.camera.full_bin_dn = kProductionElectrons / (std::numbers::pi * kSourceBins * kSourceBins);
    scene.light.source_radius_bins = kSourceBins;
    scene.noise.electrons_per_dn = static_cast<double>(kProductionGain);
    scene.noise.read_e = static_cast<double>(kProductionReadDn * kProductionGain);
}

// Height of the lens's upper face over its middle plane.
double face_mm(const sim::DoubleConvexLens& lens, double x, double y) {
    const double r = lens.radius_of_curvature_mm, a = lens.aperture_radius_mm;
    return lens.edge_thickness_mm / 2 + std::sqrt(r * r - x * x - y * y) - std::sqrt(r * r - a * a);
}

// The share of a lenslet's area within `radius` of (m, n), by 8x8 points.
double covered(int at_m, int at_n, const PlacedFlaw& flaw) {
    int inside = 0;
    for (int k = 0; k < 64; ++k) {
        const double x = at_m + (k % 8 - 3.5) / 8 - flaw.m, y = at_n + (k / 8 - 3.5) / 8 - flaw.n;
        inside += x * x + y * y <= flaw.size * flaw.size ? 1 : 0;
    }
    return inside / 64.0;
}

}  // namespace

sim::Scene round_part() {
    sim::Scene scene;
    scene.name = "round part";
    const double n = 1.5;
    scene.part = sim::DoubleConvexLens{2 * (n - 1) * focal_mm(kRoundSlope), kRadiusLenslets * kPitchMm, kEdgeMm, n};
    scene.camera.extents = {kField, kField, 9, 9};
    scene.camera.field_mm = kField * kPitchMm;
    common(scene);
    return scene;
}

sim::Scene strip(double slope) {
    sim::Scene scene;
    scene.name = "strip";
    const double n = 1.5;
    scene.part = sim::CylinderLens{(n - 1) * focal_mm(slope), (kStripColumns / 2.0 + 2) * kPitchMm,
                                   (kStripRows / 2.0 + 3) * kPitchMm, kEdgeMm, n};
    scene.camera.extents = {kStripColumns, kStripRows, 9, 9};
    scene.camera.field_mm = kStripColumns * kPitchMm;
    common(scene);
    return scene;
}

Result<ProductionPart> make_part(const sim::Scene& nominal, Flaw flaw, double size, double wobble, std::uint64_t seed,
                                 Stream stream, std::uint32_t number) {
    sim::Scene scene = nominal;
    sim::Noise draw(seed, number, static_cast<std::uint32_t>(stream) + 0x10000U * static_cast<std::uint32_t>(flaw));
    const auto even = [&] { return 2 * draw.uniform() - 1; };
    scene.pose.x_mm = 0.5 * wobble * kPitchMm * even();
    scene.pose.y_mm = 0.5 * wobble * kPitchMm * even();
    scene.pose.rotation_rad = wobble * std::numbers::pi / 180 * even();
    ProductionPart part;
    if (flaw == Flaw::bubble || flaw == Flaw::dimple || flaw == Flaw::scratch) {
        const auto& lens = std::get<sim::DoubleConvexLens>(scene.part);
        part.flaw.size = size > 0 ? size : 0.1 * std::pow(15.0, draw.uniform());
        // Anywhere up to a lenslet from the rim; a scratch lies wholly on the part.
        const double reach = flaw == Flaw::scratch ? kRadiusLenslets - 1 - part.flaw.size : kRadiusLenslets - 1;
        const double away = reach * std::sqrt(draw.uniform()) * kPitchMm, angle = 2 * std::numbers::pi * draw.uniform();
        const double x = away * std::cos(angle), y = away * std::sin(angle);
        if (flaw == Flaw::bubble) {
            scene.defects.emplace_back(sim::AirBubble{{x, y, 0}, part.flaw.size * kPitchMm});
        } else if (flaw == Flaw::dimple) {
            const double radius_mm = part.flaw.size * kPitchMm,
                         depth = radius_mm * radius_mm / (2 * kDimpleCurvatureMm);
            scene.defects.emplace_back(
                sim::SphericalCut{{x, y, face_mm(lens, x, y) + kDimpleCurvatureMm - depth}, kDimpleCurvatureMm});
        } else {
            const double along = std::numbers::pi * draw.uniform(), half = part.flaw.size * kPitchMm;
            const double dx = half * std::cos(along), dy = half * std::sin(along);
            scene.defects.emplace_back(sim::Scratch{{x - dx, y - dy, face_mm(lens, x - dx, y - dy)},
                                                    {x + dx, y + dy, face_mm(lens, x + dx, y + dy)},
                                                    kScratchMm});
        }
        const double c = std::cos(scene.pose.rotation_rad), s = std::sin(scene.pose.rotation_rad);
        part.flaw.m = (c * x - s * y + scene.pose.x_mm) / kPitchMm + 0.5 * (kField - 1);
        part.flaw.n = (s * x + c * y + scene.pose.y_mm) / kPitchMm + 0.5 * (kField - 1);
    }
    auto light = sim::render(scene, {1, {}});
    if (!light) return tl::unexpected(light.error());
    part.light = std::move(*light);
    if (flaw == Flaw::speck || flaw == Flaw::haze) add_flaw(part, flaw, size, seed, stream, number);
    return part;
}

void add_flaw(ProductionPart& part, Flaw flaw, double size, std::uint64_t seed, Stream stream, std::uint32_t number) {
    const algo::Extents& e = part.light.extents;
    sim::Noise draw(seed, number,
                    static_cast<std::uint32_t>(stream) + 0x10000U * static_cast<std::uint32_t>(flaw) + 0x800000U);
    part.flaw.size = size;
    if (e.m == kField) {
        const double away = (kRadiusLenslets - 2) * std::sqrt(draw.uniform()),
                     angle = 2 * std::numbers::pi * draw.uniform();
        part.flaw.m = away * std::cos(angle) + 0.5 * (e.m - 1), part.flaw.n = away * std::sin(angle) + 0.5 * (e.n - 1);
    } else {
        part.flaw.m = 2 + (e.m - 5) * draw.uniform(), part.flaw.n = 2 + (e.n - 5) * draw.uniform();
    }
    std::vector<double> weight;  // of a distance in bins, along one axis
    for (int d = 0; d < std::max(e.i, e.j); ++d) {
        weight.push_back(0.5 *
                         (std::erf((d + 0.5) / (kHazeBins * std::numbers::sqrt2)) -
                          std::erf((d - 0.5) / (kHazeBins * std::numbers::sqrt2))));
    }
    std::vector<double> spread(static_cast<std::size_t>(e.bins()));
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const double share = covered(m, n, part.flaw);
            if (share == 0) continue;
            const auto bin = [&](int k) -> float& {
                return part.light
                    .bins[static_cast<std::size_t>(n * e.j + k / e.i) * static_cast<std::size_t>(e.width_px()) +
                          static_cast<std::size_t>(m * e.i + k % e.i)];
            };
            if (flaw == Flaw::speck) {
                for (int k = 0; k < e.bins(); ++k) bin(k) *= static_cast<float>(1 - share * (1 - kSpeckTransmission));
                continue;
            }
            std::ranges::fill(spread, 0.0);
            for (int k = 0; k < e.bins(); ++k) {
                const auto from = static_cast<double>(bin(k));
                for (int l = 0; from > 0 && l < e.bins(); ++l) {
                    spread[static_cast<std::size_t>(l)] += from *
                        weight[static_cast<std::size_t>(std::abs(l % e.i - k % e.i))] *
                        weight[static_cast<std::size_t>(std::abs(l / e.i - k / e.i))];
                }
            }
            for (int k = 0; k < e.bins(); ++k) {
                bin(k) = static_cast<float>((1 - share * kHazeShare) * static_cast<double>(bin(k)) +
                                            share * kHazeShare * spread[static_cast<std::size_t>(k)]);
            }
        }
    }
}

Frame expose_part(const sim::LightField& light, const sim::Scene& scene, std::uint64_t seed, std::uint64_t exposure,
                  double led) {
    return sim::expose(light, scene, seed * 0x9E3779B97F4A7C15U + exposure, led);
}

algo::Recipe production_recipe() {
    algo::Recipe recipe;
    recipe.name = "production";
    recipe.lenslet_mm = static_cast<float>(kPitchMm);
    recipe.bin_rad = static_cast<float>(kBinRad);
    return recipe;
}

Result<std::shared_ptr<const algo::Reference>> learn_as_a_user(const sim::Camera& camera,
                                                               std::span<const Frame> frames) {
    const algo::Recipe recipe;
    algo::LearnOptions options;
    options.levels = algo::light_levels(recipe, camera.bits);
    options.max_dark_rise_dn = recipe.max_dark_rise_dn;
    options.dark_from_noise = recipe.dark_dn == 0;
    const auto frame_of = [&](std::size_t k) -> Result<Frame> { return frames[k]; };
    const auto read_dn = algo::read_noise_of(camera.extents, options.levels, frames.size(), frame_of);
    if (!read_dn) return tl::unexpected(read_dn.error());
    options.read_dn = *read_dn;
    auto learned = algo::learn_reference(camera.extents, camera.bits, frames.size(), frame_of, options);
    if (!learned) return tl::unexpected(learned.error());
    return std::make_shared<const algo::Reference>(std::move(learned->reference));
}

Result<std::shared_ptr<const algo::Reference>> learn_production(const sim::Scene& scene, int parts, double wobble,
                                                                std::uint64_t seed, double led) {
    std::vector<Frame> frames;
    for (int k = 0; k < parts; ++k) {
        auto part = make_part(scene, Flaw::none, 0, wobble, seed, Stream::learn, static_cast<std::uint32_t>(k));
        if (!part) return tl::unexpected(part.error());
        frames.push_back(expose_part(part->light, scene, seed, 0x1EA2'0000U + static_cast<std::uint64_t>(k), led));
    }
    return learn_as_a_user(scene.camera, frames);
}

}  // namespace hord::lab
