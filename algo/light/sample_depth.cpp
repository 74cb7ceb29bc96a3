#include "algo/light/sample_depth.h"

#include <algorithm>
#include <cstdint>

namespace hord::algo {

int fewer_bits(const FrameView& frame, std::size_t lenslets) {
    std::uint32_t largest = 0;
    for (int y = 0; y < frame.height_px; ++y) {
        for (int x = 0; x < frame.width_px; ++x) largest = std::max(largest, frame.sample(x, y));
    }
    int bits = 8;
    while (bits < frame.bits && largest >> static_cast<unsigned>(bits) != 0) bits += 2;
    if (bits >= frame.bits) return 0;
    std::size_t bright = 0;
    for (int y = 0; y < frame.height_px; ++y) {
        for (int x = 0; x < frame.width_px; ++x)
            bright += frame.sample(x, y) >> static_cast<unsigned>(bits - 1) != 0 ? 1 : 0;
    }
    return 2 * bright >= lenslets ? bits : 0;
}

}  // namespace hord::algo
