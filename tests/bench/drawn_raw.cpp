#include "tests/bench/drawn_raw.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace hord::bench {
namespace {

constexpr double kPitch = 9.0, kSpotPx = 0.6, kPeakDn = 200, kRimPx = 3.5;
constexpr double kRadius = 0.4 * kRawLenslets;  // of the lens, lenslets
constexpr double kDefectAt = 60, kDefectRadius = 4, kDefectPx = 1.2;

// Adds a spot at (x, y) of a sensor; `light`: 0..1 of the full one.
void add_spot(std::vector<float>& sensor, double x, double y, double light) {
    constexpr int kReach = 3;
    const int left = static_cast<int>(std::lround(x)), top = static_cast<int>(std::lround(y));
    for (int py = std::max(top - kReach, 0); py <= std::min(top + kReach, kRawSide - 1); ++py) {
        for (int px = std::max(left - kReach, 0); px <= std::min(left + kReach, kRawSide - 1); ++px) {
            const double away = (px - x) * (px - x) + (py - y) * (py - y);
            sensor[static_cast<std::size_t>(py) * kRawSide + static_cast<std::size_t>(px)] +=
                static_cast<float>(light * kPeakDn * std::exp(-away / (2 * kSpotPx * kSpotPx)));
        }
    }
}

}  // namespace

algo::LensletGrid raw_grid(bool hexagonal) {
    algo::LensletGrid grid;
    grid.kind = hexagonal ? algo::LatticeKind::hexagonal : algo::LatticeKind::square;
    grid.stagger = hexagonal ? algo::Stagger::rows : algo::Stagger::none;
    grid.width_px = grid.height_px = kRawSide;
    // A hexagonal lattice of as many lenslets a square has a longer pitch along its rows. It reaches beyond the frame.
    const double pitch = hexagonal ? kPitch * 1.0745699318235 : kPitch;
    grid.columns = hexagonal ? 560 : kRawLenslets;
    grid.rows = hexagonal ? 640 : kRawLenslets;
    grid.origin_u = 0.5 * (grid.columns - 1);
    grid.origin_v = 0.5 * (grid.rows - 1) * (hexagonal ? algo::kHalfSqrt3 : 1);
    grid.model = algo::GridModelKind::similarity;
    const double turn = hexagonal ? 0.0523599 : 0.0004;  // rad
    grid.parameters = {0.5 * kRawSide - 0.2, 0.5 * kRawSide - 0.3, pitch * std::cos(turn), pitch * std::sin(turn)};
    return grid;
}

Frame drawn_raw(const algo::LensletGrid& grid, double dx, double dy, std::uint64_t seed, bool defect) {
    std::vector<float> sensor(std::size_t{kRawSide} * kRawSide);
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const algo::PixelPoint at = grid.centre_px(m, n);
            if (!grid.in_frame(at)) continue;
            const double x = (at.x_px - 0.5 * kRawSide) / kPitch - dx, y = (at.y_px - 0.5 * kRawSide) / kPitch - dy;
            // A lenslet at the rim sees lens and free light.
            const double covered = std::clamp(kRadius - std::hypot(x, y) + 0.5, 0.0, 1.0);
            const double flaw = defect && std::hypot(x - kDefectAt, y - kDefectAt) < kDefectRadius ? kDefectPx : 0;
            if (covered < 1) add_spot(sensor, at.x_px, at.y_px, 1 - covered);
            if (covered > 0)
                add_spot(sensor, at.x_px + kRimPx * x / kRadius + flaw, at.y_px + kRimPx * y / kRadius, covered);
        }
    }
    std::mt19937_64 random(seed);
    std::normal_distribution<float> normal(0, 1);
    std::vector<float> normals(1U << 16U);
    for (float& one : normals) one = normal(random);
    Frame frame(kRawSide, kRawSide, 8);
    std::uint64_t state = seed * 2 + 1;
    std::byte* to = frame.bytes().data();
    for (const float dn : sensor) {
        state = state * 6364136223846793005U + 1442695040888963407U;
        const auto sigma = std::sqrt(dn / static_cast<float>(kElectronsPerDn) + static_cast<float>(kReadDn * kReadDn));
        *to++ = static_cast<std::byte>(std::clamp(std::lround(dn + sigma * normals[state >> 48U]), 0L, 254L));
    }
    return frame;
}

}  // namespace hord::bench
