#include "lab/guarantee/drawn_families.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "common/hash.h"

namespace hord::lab {
namespace {

constexpr std::array<std::string_view, 10> kFamilies = {"lens",       "steep lens", "plate",   "wedge",     "vial",
                                                        "strip 0.05", "strip 0.5",  "strip 1", "strip 1.5", "freeform"};
constexpr double kElectrons = 2000, kReadElectrons = 2, kSpotBins = 0.6;
constexpr double kPose = 0.5, kTilt = 0.03, kPower = 0.01, kWaviness = 0.02, kRipple = 0.01, kBrightness = 0.1;

std::uint64_t mixed(std::initializer_list<std::uint64_t> words) {
    common::Fnv1a64 hash;
    for (const std::uint64_t word : words) {
        for (int byte = 0; byte < 8; ++byte) hash.add_word(word >> (8 * byte) & 0xFFU);
    }
    return hash.value();
}

struct Deflection {
    double x, y;
};

// The nominal part, (u, v) lenslets from its middle, bins.
Deflection nominal(std::size_t family, double u, double v) {
    switch (family) {
        case 0: return {0.1 * u, 0.1 * v};
        case 1: return {0.4 * u, 0.3 * v};
        case 2: return {0, 0};
        case 3: return {1.2, 0.3};
        case 4: return {0.12 * u + 0.008 * u * u * u, 0};
        case 5: return {0.025 * u, 0};
        case 6: return {0.25 * u, 0};
        case 7: return {0.5 * u, 0};
        case 8: return {0.7 * u, 0};
        default: return {0.08 * u + 0.4 * std::sin(u / 2.5) * std::cos(v / 4), 0.05 * v + 0.3 * std::sin((u + v) / 4)};
    }
}

}  // namespace

std::span<const std::string_view> drawn_families() { return kFamilies; }

Frame draw_good_part(std::size_t family, std::uint64_t seed, std::uint32_t stream, std::uint32_t number,
                     std::uint32_t exposure) {
    std::mt19937_64 of_sensor(mixed({seed, 0x5E})), of_part(mixed({seed, family, stream, number})),
        of_exposure(mixed({seed, family, stream, number, 1 + std::uint64_t{exposure}}));
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> even(-1, 1);
    const double at_u = kPose * even(of_part), at_v = kPose * even(of_part), tilt_x = kTilt * normal(of_part),
                 tilt_y = kTilt * normal(of_part), power = 1 + kPower * normal(of_part),
                 waves = kWaviness * normal(of_part), period = 8 + 4 * even(of_part),
                 phase = std::numbers::pi * even(of_part), angle = std::numbers::pi * even(of_part),
                 brightness = 1 + kBrightness * even(of_part);
    const algo::Extents& e = kFamilyExtents;
    Frame frame(e.width_px(), e.height_px(), kFamilyBits);
    std::array<double, algo::kMaxBins> along{}, across{};
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const double u = m - 0.5 * (e.m - 1) - at_u, v = n - 0.5 * (e.n - 1) - at_v;
            const Deflection d = nominal(family, u, v), beside = nominal(family, u + 0.5, v),
                             below = nominal(family, u, v + 0.5);
            const double wave =
                waves * std::sin(2 * std::numbers::pi * (std::cos(angle) * u + std::sin(angle) * v) / period + phase);
            const double x = power * d.x + tilt_x + wave * std::cos(angle),
                         y = power * d.y + tilt_y + wave * std::sin(angle);
            // The deflection changes inside the lenslet: the spot is as wide as the source and that change together.
            const auto width = [](double source, double change) {
                return std::sqrt(source * source + 4 * change * change / 12);
            };
            const double wide = width(kSpotBins, beside.x - d.x), high = width(kSpotBins, below.y - d.y);
            const auto fill = [](std::array<double, algo::kMaxBins>& bins, int count, double middle, double sigma) {
                for (int k = 0; k < count; ++k) {
                    const double from = k - 0.5 * count - middle, to = from + 1;
                    bins[static_cast<std::size_t>(k)] = 0.5 *
                        (std::erf(to / (sigma * std::numbers::sqrt2)) - std::erf(from / (sigma * std::numbers::sqrt2)));
                }
            };
            fill(along, e.i, x, wide), fill(across, e.j, y, high);
            const double light =
                kElectrons * brightness * (1 + kRipple * normal(of_part)) * (1 + kRipple * normal(of_sensor));
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i) {
                    const double electrons =
                        light * along[static_cast<std::size_t>(i)] * across[static_cast<std::size_t>(j)];
                    const double noise = std::sqrt(electrons + kReadElectrons * kReadElectrons) * normal(of_exposure);
                    frame.set(m * e.i + i, n * e.j + j,
                              static_cast<std::uint32_t>(std::clamp(std::lround(electrons + noise), 0L, 4095L)));
                }
            }
        }
    }
    return frame;
}

}  // namespace hord::lab
