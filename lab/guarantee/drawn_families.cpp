#include "lab/guarantee/drawn_families.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

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

// A flaw at its place, and what it does to the light that falls on a point of the field.
class PlacedFlaw {
  public:
    PlacedFlaw(DrawnFlaw flaw, std::mt19937_64& random) : flaw_(flaw) {
        std::uniform_real_distribution<double> uniform(0, 1);
        m = kFromBorder + (kFamilyExtents.m - 1 - 2 * kFromBorder) * uniform(random);
        n = kFromBorder + (kFamilyExtents.n - 1 - 2 * kFromBorder) * uniform(random);
        angle_ = std::numbers::pi * uniform(random);
        size = flaw == DrawnFlaw::bubble ? kMinBubble * std::pow(kMaxBubble / kMinBubble, uniform(random))
            : flaw == DrawnFlaw::scratch ? 0.15
            : flaw == DrawnFlaw::dimple  ? 1.5
            : flaw == DrawnFlaw::stria   ? 1.4
            : flaw == DrawnFlaw::haze    ? 1.2
                                         : 1;
    }
    double m, n, size;

    struct Effect {
        double transmission = 1, scattered = 0;  // shares of the light
        Deflection moved{0, 0};                  // bins
    };
    // Empty outside the flaw.
    [[nodiscard]] std::optional<Effect> at(double column, double row) const {
        const double x = column - m, y = row - n, c = std::cos(angle_), s = std::sin(angle_), across = c * y - s * x;
        const bool is_long = flaw_ == DrawnFlaw::scratch || flaw_ == DrawnFlaw::stria;
        if (is_long ? std::abs(c * x + s * y) > kLong / 2 || std::abs(across) > size : std::hypot(x, y) > size)
            return {};
        switch (flaw_) {
            case DrawnFlaw::bubble:
            case DrawnFlaw::scratch: return Effect{.transmission = 0};
            case DrawnFlaw::dimple: return Effect{.moved = {kDimple * x / size, kDimple * y / size}};
            case DrawnFlaw::stria: {
                const double to = across > 0 ? kStria : -kStria;
                return Effect{.moved = {-s * to, c * to}};
            }
            case DrawnFlaw::haze: return Effect{.scattered = kHaze};
            default: return Effect{.transmission = kSpeck};
        }
    }

  private:
    static constexpr double kFromBorder = 2, kMinBubble = 0.05, kMaxBubble = 1.5, kLong = 8, kDimple = 0.5,
                            kStria = 0.1, kHaze = 0.1, kSpeck = 0.5;
    DrawnFlaw flaw_;
    double angle_;
};

using Bins = std::array<double, algo::kMaxBins>;

// The share of a Gaussian spot in each of `count` bins.
void fill(Bins& bins, int count, double middle, double sigma) {
    for (int k = 0; k < count; ++k) {
        const double from = k - 0.5 * count - middle, to = from + 1;
        bins[static_cast<std::size_t>(k)] =
            0.5 * (std::erf(to / (sigma * std::numbers::sqrt2)) - std::erf(from / (sigma * std::numbers::sqrt2)));
    }
}

struct Spot {
    double x, y, wide, high;  // middle and standard deviations, bins
};

// Adds `share` of a lenslet's light.
void add(std::vector<double>& bins, const Spot& spot, double share) {
    const algo::Extents& e = kFamilyExtents;
    Bins along{}, across{};
    fill(along, e.i, spot.x, spot.wide), fill(across, e.j, spot.y, spot.high);
    for (int b = 0; b < e.bins(); ++b) {
        bins[static_cast<std::size_t>(b)] +=
            share * along[static_cast<std::size_t>(b % e.i)] * across[static_cast<std::size_t>(b / e.i)];
    }
}

// The light of lenslet (m, n), 1 in all if none is lost.
void light_of(std::vector<double>& bins, const Spot& spot, int m, int n, const std::optional<PlacedFlaw>& flaw) {
    constexpr int kPoints = 16;  // along each axis
    constexpr double kPoint = 1.0 / (kPoints * kPoints);
    std::ranges::fill(bins, 0.0);
    int clear = kPoints * kPoints;
    for (int k = 0; flaw && k < kPoints * kPoints; ++k) {
        const auto effect = flaw->at(m + (k % kPoints + 0.5) / kPoints - 0.5, n + (k / kPoints + 0.5) / kPoints - 0.5);
        if (!effect) continue;
        --clear;
        if (effect->transmission == 0) continue;
        const double x = spot.x + effect->moved.x, y = spot.y + effect->moved.y;
        add(bins, {x, y, spot.wide, spot.high}, kPoint * effect->transmission * (1 - effect->scattered));
        if (effect->scattered > 0)
            add(bins, {x, y, std::hypot(spot.wide, 1), std::hypot(spot.high, 1)}, kPoint * effect->scattered);
    }
    if (clear > 0) add(bins, spot, clear * kPoint);
}

}  // namespace

std::span<const std::string_view> drawn_families() { return kFamilies; }

DrawnPart draw_part(std::size_t family, std::uint64_t seed, std::uint32_t stream, std::uint32_t number,
                    std::uint32_t exposure, std::optional<DrawnFlaw> flaw) {
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
    DrawnPart part{Frame(e.width_px(), e.height_px(), kFamilyBits)};
    std::optional<PlacedFlaw> placed;
    if (flaw) {
        std::mt19937_64 of_flaw(mixed({seed, family, stream, number, 0xF1A3, static_cast<std::uint64_t>(*flaw)}));
        placed.emplace(*flaw, of_flaw);
        part.m = placed->m, part.n = placed->n, part.size = placed->size;
    }
    std::vector<double> bins(static_cast<std::size_t>(e.bins()));
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
            light_of(bins, {x, y, wide, high}, m, n, placed);
            const double light =
                kElectrons * brightness * (1 + kRipple * normal(of_part)) * (1 + kRipple * normal(of_sensor));
            for (int b = 0; b < e.bins(); ++b) {
                const double electrons = light * bins[static_cast<std::size_t>(b)];
                const double noise = std::sqrt(electrons + kReadElectrons * kReadElectrons) * normal(of_exposure);
                part.frame.set(m * e.i + b % e.i, n * e.j + b / e.i,
                               static_cast<std::uint32_t>(std::clamp(std::lround(electrons + noise), 0L, 4095L)));
            }
        }
    }
    return part;
}

Frame draw_good_part(std::size_t family, std::uint64_t seed, std::uint32_t stream, std::uint32_t number,
                     std::uint32_t exposure) {
    return draw_part(family, seed, stream, number, exposure, {}).frame;
}

}  // namespace hord::lab
