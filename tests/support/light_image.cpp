#include "tests/support/light_image.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace hord::algo::testing {

LightImage changed(LightImage light, const std::function<double(int x, int y, double light)>& change) {
    for (int y = 0; y < light.extents.height_px(); ++y) {
        for (int x = 0; x < light.extents.width_px(); ++x) light.at(x, y) = change(x, y, light.at(x, y));
    }
    return light;
}

LightImage spots(const Extents& e, double peak_dn, double spread_bins, const std::function<Spot(int, int)>& spot) {
    LightImage light{e, std::vector<double>(static_cast<std::size_t>(e.width_px() * e.height_px()))};
    const double root = spread_bins * std::sqrt(2.0);
    const auto share = [&](double centre, int k, int bins) {  // of a spot's light in bin k
        const double left = k - (bins - 1) / 2.0 - 0.5 - centre;
        return 0.5 * (std::erf((left + 1) / root) - std::erf(left / root));
    };
    const double centred = share(0, e.i / 2, e.i | 1) * share(0, e.j / 2, e.j | 1);
    std::vector<double> across(static_cast<std::size_t>(e.i));
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const Spot s = spot(m, n);
            for (int i = 0; i < e.i; ++i) across[static_cast<std::size_t>(i)] = share(s.x, i, e.i);
            for (int j = 0; j < e.j; ++j) {
                const double down = share(s.y, j, e.j) * s.light * peak_dn / centred;
                for (int i = 0; i < e.i; ++i)
                    light.at(m * e.i + i, n * e.j + j) = across[static_cast<std::size_t>(i)] * down;
            }
        }
    }
    return light;
}

Frame exposed(const LightImage& light, const Sensor& sensor, std::uint64_t seed, int bits) {
    constexpr double kElectronsPerDn = 10;
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    const double scale = ((1 << bits) - 1) / 255.0;
    Frame frame(light.extents.width_px(), light.extents.height_px(), bits);
    std::size_t k = 0;
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x, ++k) {
            const double mean = light.bins[k] * sensor.light,
                         photons = sensor.photon_noise ? std::sqrt(mean / kElectronsPerDn) : 0;
            const double dn = mean + sensor.pedestal_dn + std::hypot(photons, sensor.noise_dn) * normal(random);
            frame.set(x, y, static_cast<std::uint32_t>(std::clamp(std::lround(dn * scale), 0L, (1L << bits) - 1)));
        }
    }
    return frame;
}

LightImage moved_px(const LightImage& light, double right_px, double down_px) {
    const Extents& e = light.extents;
    const auto value = [&](int x, int y) {
        return x >= 0 && y >= 0 && x < e.width_px() && y < e.height_px() ? light.at(x, y) : 0.0;
    };
    return changed(light, [&](int x, int y, double) {
        const double from_x = x - right_px, from_y = y - down_px;
        const int left = static_cast<int>(std::floor(from_x)), top = static_cast<int>(std::floor(from_y));
        const double u = from_x - left, v = from_y - top;
        return (1 - v) * ((1 - u) * value(left, top) + u * value(left + 1, top)) +
            v * ((1 - u) * value(left, top + 1) + u * value(left + 1, top + 1));
    });
}

LightImage blurred(const LightImage& light, double spread_px) {
    const Extents& e = light.extents;
    const int reach = static_cast<int>(std::ceil(3 * spread_px));
    std::vector<double> weights;
    double all = 0;
    for (int k = -reach; k <= reach; ++k) all += weights.emplace_back(std::exp(-k * k / (2 * spread_px * spread_px)));
    const auto along = [&](const LightImage& of, int step_x, int step_y) {
        return changed(of, [&](int x, int y, double) {
            double sum = 0;
            for (int k = -reach; k <= reach; ++k) {
                sum += weights[static_cast<std::size_t>(k + reach)] *
                    of.at(std::clamp(x + k * step_x, 0, e.width_px() - 1),
                          std::clamp(y + k * step_y, 0, e.height_px() - 1));
            }
            return sum / all;
        });
    };
    return along(along(light, 1, 0), 0, 1);
}

LightImage with_ghost(LightImage light, double share, int right_px, int down_px) {
    const LightImage moved = moved_px(light, right_px, down_px);
    for (std::size_t k = 0; k < light.bins.size(); ++k) light.bins[k] += share * moved.bins[k];
    return light;
}

LightImage joined(const LightImage& left, const LightImage& right, int from_column) {
    return changed(left,
                   [&](int x, int y, double v) { return x >= from_column * left.extents.i ? right.at(x, y) : v; });
}

}  // namespace hord::algo::testing
