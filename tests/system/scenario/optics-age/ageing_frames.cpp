#include "tests/system/scenario/optics-age/ageing_frames.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace hord::sim {
namespace {

constexpr int kPlaces = 8;  // sample points along a side of a lenslet

// Fraction of a lenslet's light that passes the dust.
double passes(const DustOnLenslets& dust, int m, int n) {
    int covered = 0;
    for (int y = 0; y < kPlaces; ++y) {
        for (int x = 0; x < kPlaces; ++x) {
            const double right = m + (x + 0.5) / kPlaces - 0.5 - dust.m, below = n + (y + 0.5) / kPlaces - 0.5 - dust.n;
            covered += right * right + below * below <= dust.radius * dust.radius ? 1 : 0;
        }
    }
    return 1 - (1 - dust.transmission) * covered / (kPlaces * kPlaces);
}

class Samples {
  public:
    Samples(std::byte* data, int width, int bits) : data_(data), width_(width), bits_(bits) {}
    template <class Change>
    void change(int x, int y, const Change& change) {
        const std::size_t at =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
        const double full = (1U << bits_) - 1U;
        const auto limited = [&](double dn) {
            return static_cast<std::uint32_t>(std::clamp(std::round(dn), 0.0, full));
        };
        if (bits_ <= 8) {
            auto* sample = reinterpret_cast<std::uint8_t*>(data_) + at;
            *sample = static_cast<std::uint8_t>(limited(change(*sample)));
        } else {
            auto* sample = reinterpret_cast<std::uint16_t*>(data_) + at;
            *sample = static_cast<std::uint16_t>(limited(change(*sample)));
        }
    }

  private:
    std::byte* data_;
    int width_, bits_;
};

}  // namespace

FrameView AgeingFrames::expose(const Exposure& exposure, std::span<std::byte> scratch) {
    const CellAge age = of_exposure_(exposures_++);
    Exposure weaker = exposure;
    weaker.light *= age.light;
    FrameView view = young_.expose(weaker, scratch);
    if (age.dark_dn == 0 && age.dust.empty()) return view;
    const auto line = static_cast<std::size_t>(view.width_px) * (view.bits > 8 ? 2U : 1U);
    if (view.data != scratch.data()) {  // the source's own
        for (int y = 0; y < view.height_px; ++y)
            std::memcpy(scratch.data() + static_cast<std::size_t>(y) * line, view.data + y * view.stride_bytes, line);
        view.data = scratch.data();
        view.stride_bytes = static_cast<std::ptrdiff_t>(line);
    }
    Samples samples(scratch.data(), view.width_px, view.bits);
    for (const DustOnLenslets& dust : age.dust) {
        const auto from = [&](double centre) {
            return std::max(0, static_cast<int>(std::floor(centre - dust.radius - 0.5)));
        };
        const auto to = [&](double centre, int count) {
            return std::min(count - 1, static_cast<int>(std::ceil(centre + dust.radius + 0.5)));
        };
        for (int n = from(dust.n); n <= to(dust.n, extents_.n); ++n) {
            for (int m = from(dust.m); m <= to(dust.m, extents_.m); ++m) {
                const double share = passes(dust, m, n);
                for (int j = 0; j < extents_.j; ++j) {
                    for (int i = 0; i < extents_.i; ++i)
                        samples.change(m * extents_.i + i, n * extents_.j + j, [&](double dn) { return share * dn; });
                }
            }
        }
    }
    if (age.dark_dn == 0) return view;
    for (int y = 0; y < view.height_px; ++y) {
        for (int x = 0; x < view.width_px; ++x) samples.change(x, y, [&](double dn) { return dn + age.dark_dn; });
    }
    return view;
}

}  // namespace hord::sim
