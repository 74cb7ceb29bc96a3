// Frames of a weak lens that fills the field: input for teach-in without optics.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::firmware {

inline constexpr algo::Extents kDrawnExtents{18, 16, 7, 7};
inline constexpr int kDrawnBits = 12;

// Each seed has its own position and noise; one electron a DN. `speck`: nine lenslets with a third less light.
inline Frame drawn_lens(std::uint64_t seed, bool speck = false) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> wobble(-0.3, 0.3);
    const double x0 = wobble(random), y0 = wobble(random);
    Frame frame(kDrawnExtents.width_px(), kDrawnExtents.height_px(), kDrawnBits);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const int m = x / 7, n = y / 7;
            const double dx = x % 7 - 3 - 0.08 * (m - 8.5 - x0), dy = y % 7 - 3 - 0.06 * (n - 7.5 - y0);
            double light = 1500 * std::exp(-(dx * dx + dy * dy) / 0.7);
            if (speck && std::abs(m - 11) <= 1 && std::abs(n - 6) <= 1) light *= 0.67;
            const double noisy = light + std::sqrt(light + 4) * normal(random);
            frame.set(x, y, static_cast<std::uint32_t>(std::clamp(std::lround(noisy), 0L, 4095L)));
        }
    }
    return frame;
}

}  // namespace hord::firmware
