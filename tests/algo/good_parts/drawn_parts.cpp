#include "tests/algo/good_parts/drawn_parts.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace hord::algo::testing {

Frame draw(const DrawnPart& part) {
    std::mt19937_64 random(part.noise);
    std::normal_distribution<double> normal;
    Frame frame(kDrawn.width_px(), kDrawn.height_px(), 12);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const double dx = x % 9 - 4 - part.power * (x / 9 - 12.5 - part.x),
                         dy = y % 9 - 4 - 0.75 * part.power * (y / 9 - 11.5 - part.y);
            const double light = 1000 * part.light * std::exp(-(dx * dx + dy * dy) / 0.7);
            frame.set(x, y,
                      static_cast<std::uint32_t>(
                          std::clamp(std::lround(light + std::sqrt(light + 4) * normal(random)), 0L, 4095L)));
        }
    }
    return frame;
}

DrawnPart placed_part(std::uint64_t seed) {
    std::mt19937_64 random(seed + 1000);
    std::uniform_real_distribution<double> wobble(-0.5, 0.5);
    DrawnPart part;
    part.x = wobble(random), part.y = wobble(random), part.noise = seed;
    return part;
}

}  // namespace hord::algo::testing
