// Random HORDs of several shapes, from a seed, for the tests of distances.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <random>
#include <vector>

#include "algo/frame/hord.h"

namespace hord::algo::testing {

using Histogram = std::vector<std::uint16_t>;
using Random = std::mt19937_64;

inline Hord hord_of(const Histogram& h) { return {h.data(), std::accumulate(h.begin(), h.end(), std::uint32_t{0})}; }

inline int pick(Random& random, int low, int high) { return std::uniform_int_distribution<int>(low, high)(random); }

// A Gaussian spot at a random place, with noise and a dark threshold: the HORD of most lenslets.
inline Histogram blob(Random& random, int bins_i, int bins_j, int full_scale, double radius) {
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    std::normal_distribution<double> noise(0.0, 0.01);
    const double ci = unit(random) * (bins_i - 1), cj = unit(random) * (bins_j - 1);
    Histogram h(static_cast<std::size_t>(bins_i * bins_j));
    for (int j = 0; j < bins_j; ++j) {
        for (int i = 0; i < bins_i; ++i) {
            const double r2 = (i - ci) * (i - ci) + (j - cj) * (j - cj);
            const double light = std::exp(-r2 / (2 * radius * radius)) + noise(random);
            h[static_cast<std::size_t>(j * bins_i + i)] =
                light < 0.015 ? std::uint16_t{0} : static_cast<std::uint16_t>(std::clamp(light, 0.0, 1.0) * full_scale);
        }
    }
    if (hord_of(h).sum == 0) h[0] = 1;
    return h;
}

inline Histogram two_lobes(Random& random, int bins_i, int bins_j, int full_scale) {
    Histogram a = blob(random, bins_i, bins_j, full_scale / 2, 0.7);
    const Histogram b = blob(random, bins_i, bins_j, full_scale / 2, 0.7);
    for (std::size_t k = 0; k < a.size(); ++k) a[k] = static_cast<std::uint16_t>(a[k] + b[k]);
    return a;
}

// `lit` bins at random places, with masses 1..largest. A small `largest` makes many ties.
inline Histogram scattered(Random& random, int bins, int lit, int largest) {
    Histogram h(static_cast<std::size_t>(bins));
    for (int n = 0; n < lit; ++n)
        h[static_cast<std::size_t>(pick(random, 0, bins - 1))] = static_cast<std::uint16_t>(pick(random, 1, largest));
    return h;
}

}  // namespace hord::algo::testing
