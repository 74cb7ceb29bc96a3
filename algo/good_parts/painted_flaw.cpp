#include "algo/good_parts/painted_flaw.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace hord::algo {
namespace {

constexpr int kPoints = 16;  // along each axis of a lenslet

// The share of lenslet (m, n) that the flaw covers.
template <class Inside>
double covered(int m, int n, const Inside& inside) {
    int count = 0;
    for (int k = 0; k < kPoints * kPoints; ++k) {
        const double x = m + (k % kPoints + 0.5) / kPoints - 0.5, y = n + (k / kPoints + 0.5) / kPoints - 0.5;
        count += inside(x, y) ? 1 : 0;
    }
    return count / static_cast<double>(kPoints * kPoints);
}

// The light of the bins, moved by (x, y) bins; what leaves them is lost.
std::vector<double> moved(const std::vector<double>& light, const Extents& e, double x, double y) {
    std::vector<double> to(light.size());
    const double fx = x - std::floor(x), fy = y - std::floor(y);
    for (int b = 0; b < e.bins(); ++b) {
        const int i = b % e.i + static_cast<int>(std::floor(x)), j = b / e.i + static_cast<int>(std::floor(y));
        for (int k = 0; k < 4; ++k) {
            const int u = i + k % 2, v = j + k / 2;
            if (u < 0 || v < 0 || u >= e.i || v >= e.j) continue;
            to[static_cast<std::size_t>(v * e.i + u)] +=
                light[static_cast<std::size_t>(b)] * (k % 2 == 0 ? 1 - fx : fx) * (k / 2 == 0 ? 1 - fy : fy);
        }
    }
    return to;
}

std::vector<double> scattered(const std::vector<double>& light, const Extents& e) {
    const auto weight = [](int d) {
        return 0.5 * (std::erf((d + 0.5) / std::numbers::sqrt2) - std::erf((d - 0.5) / std::numbers::sqrt2));
    };
    std::vector<double> to(light.size());
    for (int b = 0; b < e.bins(); ++b) {
        for (int l = 0; l < e.bins(); ++l) {
            to[static_cast<std::size_t>(l)] += light[static_cast<std::size_t>(b)] *
                weight(std::abs(l % e.i - b % e.i)) * weight(std::abs(l / e.i - b / e.i));
        }
    }
    return to;
}

}  // namespace

void paint(Frame& frame, const Extents& e, PaintedFlaw flaw, double m, double n, double size, double angle,
           double pedestal_dn) {
    const double c = std::cos(angle), s = std::sin(angle);
    const double disc = flaw == PaintedFlaw::hole ? size : flaw == PaintedFlaw::dimple ? kPaintedDimple : kPaintedHaze;
    const auto inside = [&](double x, double y) {
        const double dx = x - m, dy = y - n;
        if (flaw != PaintedFlaw::scratch) return dx * dx + dy * dy <= disc * disc;
        return std::abs(c * dx + s * dy) <= kPaintedScratch / 2 && std::abs(c * dy - s * dx) <= size;
    };
    // A thin scratch falls between the points: its share is computed at a width of at least two points, then scaled.
    const double least = 1.0 / kPoints, thin = flaw == PaintedFlaw::scratch ? std::min(1.0, size / least) : 1;
    const auto covers = [&](int column, int row) {
        if (thin == 1) return covered(column, row, inside);
        return thin * covered(column, row, [&](double x, double y) {
                   const double dx = x - m, dy = y - n;
                   return std::abs(c * dx + s * dy) <= kPaintedScratch / 2 && std::abs(c * dy - s * dx) <= least;
               });
    };
    const int reach = static_cast<int>(std::ceil(flaw == PaintedFlaw::scratch ? kPaintedScratch / 2 : disc)) + 1;
    std::vector<double> light(static_cast<std::size_t>(e.bins()));
    const double full = frame.view().full_scale();
    e.for_each_around(static_cast<int>(std::lround(m)), static_cast<int>(std::lround(n)), reach,
                      [&](int column, int row) {
                          const double share = covers(column, row);
                          if (share == 0) return;
                          for (int b = 0; b < e.bins(); ++b) {
                              light[static_cast<std::size_t>(b)] =
                                  frame.view().sample(column * e.i + b % e.i, row * e.j + b / e.i) - pedestal_dn;
                          }
                          std::vector<double> changed(light.size());
                          double of_changed = share;
                          if (flaw == PaintedFlaw::dimple) changed = moved(light, e, size * c, size * s);
                          if (flaw == PaintedFlaw::haze) changed = scattered(light, e), of_changed = share * size;
                          for (int b = 0; b < e.bins(); ++b) {
                              const auto k = static_cast<std::size_t>(b);
                              const double value = (1 - of_changed) * light[k] + of_changed * changed[k] + pedestal_dn;
                              frame.set(column * e.i + b % e.i, row * e.j + b / e.i,
                                        static_cast<std::uint32_t>(std::lround(std::clamp(value, 0.0, full))));
                          }
                      });
}

}  // namespace hord::algo
