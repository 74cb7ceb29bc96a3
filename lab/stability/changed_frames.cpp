#include "lab/stability/changed_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <random>

namespace hord::lab {

using namespace hord::algo;

namespace {

constexpr std::size_t kChangeBytes = 5, kMaxChanges = 8;

struct Change {
    int kind, x, y, a, b;
};

int changed(const FrameView& from, const Change& c, int x, int y, std::minstd_rand& random) {
    const int width = from.width_px, height = from.height_px;
    const auto at = [&](int px, int py) {
        return static_cast<int>(from.sample(((px % width) + width) % width, ((py % height) + height) % height));
    };
    const int dn = at(x, y), left = c.x * width / 256, top = c.y * height / 256;
    const bool inside = x >= left && y >= top && x < left + 1 + c.a * width / 256 && y < top + 1 + c.b * height / 256;
    switch (c.kind % 16) {
        case 0: return dn + c.a % 32;                                                       // pedestal
        case 1: return dn * c.a / 128;                                                      // exposure
        case 2: return dn + static_cast<int>(random() % (2 * (c.a % 16U) + 1)) - c.a % 16;  // noise
        case 3: return (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) + dn) / 5;
        case 4: return at(x + c.x % 9 - 4, y + c.y % 9 - 4);  // shifted
        case 5: return inside ? 0 : dn;                       // a shadow
        case 6: return inside ? c.kind : dn;                  // flat
        case 7: return inside ? at(x + 9, y) : dn;            // a copy of the neighbours
        case 8: return inside ? dn / 2 : dn;
        case 9: return inside ? static_cast<int>(random() % 256) : dn;
        case 10: return inside ? at(x + 1, y) : dn;                   // deflected
        case 11: return dn & c.a;                                     // dead bits
        case 12: return y % (c.a % 20 + 2) == 0 ? at(x, y + 1) : dn;  // lost rows
        case 13: return x % 9 < c.a % 9 ? dn : at(x - 9, y);
        case 14: return dn + at(x + c.x % 64, y + c.y % 64) * (c.a % 64) / 64;  // a ghost
        default: return at(y * width / height, x * height / width);             // transposed
    }
}

}  // namespace

Frame clean_frame(const Extents& e) {
    Frame frame(e.width_px(), e.height_px(), 8);
    const double radius = 0.4 * std::min(e.m, e.n);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const double u = (x / e.i - 0.5 * (e.m - 1)) / radius, v = (y / e.j - 0.5 * (e.n - 1)) / radius,
                         bend = u * u + v * v < 1 ? 1 : 0, i = x % e.i - 0.5 * (e.i - 1) - bend * u,
                         j = y % e.j - 0.5 * (e.j - 1) - bend * v;
            frame.set(x, y, static_cast<std::uint32_t>(std::lround(230 * std::exp(-(i * i + j * j) / (2 * 0.36)))));
        }
    }
    return frame;
}

Frame changed_frame(const Frame& clean, std::span<const std::uint8_t> input) {
    Frame frame = clean;
    for (std::size_t k = 1; k + kChangeBytes <= std::min(input.size(), 1 + kMaxChanges * kChangeBytes);
         k += kChangeBytes) {
        const Frame before = frame;
        const Change c{input[k], input[k + 1], input[k + 2], input[k + 3], input[k + 4]};
        std::minstd_rand random(input[k + 4] + 1U);
        for (int y = 0; y < frame.height_px(); ++y) {
            for (int x = 0; x < frame.width_px(); ++x)
                frame.set(x, y,
                          static_cast<std::uint32_t>(std::clamp(changed(before.view(), c, x, y, random), 0, 255)));
        }
    }
    return frame;
}

Recipe recipe_of_byte(unsigned byte) {
    Recipe r;
    r.form = std::array{PartForm::round, PartForm::tube, PartForm::plate, PartForm::web}.at(byte & 3U);
    r.part_required = r.form != PartForm::web;
    r.slopes = (byte & 4U) == 0;
    r.light = (byte & 8U) == 0;
    if ((byte & 16U) != 0) {  // judges nearly any frame
        r.part_required = r.check_period = false;
        r.max_offset_bins = r.max_spot_bins = r.max_second_share = 0;
        r.max_dark_rise_dn = 60;
    }
    r.emd_limit_bins = std::array{1.0F, 0.2F, 0.05F, 3.0F, 1.0F, 0.5F, 8.0F, 0.01F}.at(byte >> 5U);
    return r;
}

}  // namespace hord::lab
