#include "algo/maps/optical_map.h"

#include <cmath>

#include "algo/features/deflection.h"
#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr int kHalf = 2;             // of the window of the derivatives
constexpr double kSquares = 5 * 10;  // sum of m^2 over the window: 5 rows of 4 + 1 + 0 + 1 + 4

struct Derivatives {
    double by_m = 0, by_n = 0;  // a lenslet
};

// Least squares of a plane over the window about (m, n).
Derivatives derivatives(const std::vector<float>& of, const Extents& e, int m, int n) {
    Derivatives sum;
    for (int b = -kHalf; b <= kHalf; ++b) {
        for (int a = -kHalf; a <= kHalf; ++a) {
            const auto value = static_cast<double>(of[e.index(m + a, n + b)]);
            sum.by_m += a * value;
            sum.by_n += b * value;
        }
    }
    return {sum.by_m / kSquares, sum.by_n / kSquares};
}

bool has_window(const std::vector<std::uint8_t>& mask, const Extents& e, int m, int n) {
    if (m < kHalf || n < kHalf || m >= e.m - kHalf || n >= e.n - kHalf) return false;
    for (int b = -kHalf; b <= kHalf; ++b) {
        for (int a = -kHalf; a <= kHalf; ++a) {
            if ((mask[e.index(m + a, n + b)] & (kDark | kSaturated)) != 0) return false;
        }
    }
    return true;
}

}  // namespace

Result<OpticalMap> optical_map(const FrameView& frame, const Extents& extents, int bits, const LightLevels& levels,
                               Optical what, const OpticalScale& scale) {
    if (auto valid = check_frame(frame, extents, bits); !valid) return tl::unexpected(valid.error());
    const bool of_power = what == Optical::power || what == Optical::cylinder;
    if (of_power && !(scale.lenslet_mm > 0 && scale.bin_rad > 0)) {
        return fail(ErrorCode::invalid_argument, "a power in dioptres needs the width of a lenslet and of a bin",
                    "give a recipe with [scale] lenslet_mm and bin_rad");
    }
    OpticalMap map{std::vector<float>(extents.lenslets()), std::vector<std::uint8_t>(extents.lenslets())};
    std::vector<float> x(extents.lenslets()), y(extents.lenslets());  // bin pitches
    HordRow row(extents);
    std::vector<Deflection> means(static_cast<std::size_t>(extents.m));
    for (int n = 0; n < extents.n; ++n) {
        decode_row(frame, extents, levels, n, row);
        mean_deflections(row, means);
        for (int m = 0; m < extents.m; ++m) {
            const std::size_t k = extents.index(m, n), at = static_cast<std::size_t>(m);
            x[k] = static_cast<float>(means[at].x.to_double_rounded());
            y[k] = static_cast<float>(means[at].y.to_double_rounded());
            map.mask[k] = row.mask()[at];
        }
    }
    if (!of_power) {
        const std::vector<float>& of = what == Optical::deflection_x ? x : y;
        const double unit = scale.bin_rad > 0 ? 1e3 * scale.bin_rad : 1;
        for (std::size_t k = 0; k < of.size(); ++k) {
            if ((map.mask[k] & (kDark | kSaturated)) == 0)
                map.values[k] = static_cast<float>(unit * static_cast<double>(of[k]));
        }
        return map;
    }
    const double unit = 1e3 * scale.bin_rad / scale.lenslet_mm;  // dioptres of a bin a lenslet
    std::vector<std::uint8_t> alone(extents.lenslets());
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m) {
            const std::size_t k = extents.index(m, n);
            if (!has_window(map.mask, extents, m, n)) {
                alone[k] = 1;
                continue;
            }
            const Derivatives u = derivatives(x, extents, m, n), v = derivatives(y, extents, m, n);
            map.values[k] = static_cast<float>(
                unit *
                (what == Optical::power ? -(u.by_m + v.by_n) / 2 : std::hypot(u.by_m - v.by_n, u.by_n + v.by_m)));
        }
    }
    for (std::size_t k = 0; k < alone.size(); ++k) {
        if (alone[k] != 0 && map.mask[k] == kValid) map.mask[k] = kBorder;
    }
    return map;
}

}  // namespace hord::algo
