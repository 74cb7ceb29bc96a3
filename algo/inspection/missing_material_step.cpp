// MissingMaterialFinder: whether the light of what may be a hole is more than a lamp explains.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "algo/inspection/missing_material.h"

namespace hord::algo {
namespace {

constexpr std::size_t kTerms = 7;           // 1, x, y, xx, xy, yy; 1 in a hole
constexpr std::size_t kMinLenslets = 32;    // of a fit, as of an estimate of noise
constexpr double kSurely = 3;               // standard errors that the noise is taken to be larger than it seems
constexpr double kMinIndependent = 1.0e-9;  // of a term that those before it do not explain, of its square

using Terms = std::array<double, kTerms>;

// Least squares of light by the terms.
class LightFit {
  public:
    void add(const Terms& terms, double light) {
        for (std::size_t i = 0; i < kTerms; ++i) {
            for (std::size_t j = 0; j <= i; ++j) products_[i][j] += terms[i] * terms[j];
            with_light_[i] += terms[i] * light;
        }
        light_squared_ += light * light;
        light_ += light;
        ++count_;
    }
    struct Step {
        double light = 0, error = 0;  // of the last term; its standard error
        double mean = 0;              // light
    };
    // False if the lenslets are too few, or the last term is explained by the others.
    bool solve(Step& step) const {
        if (count_ < kMinLenslets) return false;
        // L of the products = L L', and z of L z = `with_light_`: the last coefficient is z / l of the last row.
        std::array<Terms, kTerms> l{};
        Terms z{};
        double rest = light_squared_;
        for (std::size_t i = 0; i < kTerms; ++i) {
            for (std::size_t j = 0; j < i; ++j) {
                double sum = products_[i][j];
                for (std::size_t k = 0; k < j; ++k) sum -= l[i][k] * l[j][k];
                l[i][j] = sum / l[j][j];
            }
            double left = products_[i][i];
            for (std::size_t k = 0; k < i; ++k) left -= l[i][k] * l[i][k];
            if (left <= kMinIndependent * products_[i][i]) return false;
            l[i][i] = std::sqrt(left);
            double sum = with_light_[i];
            for (std::size_t k = 0; k < i; ++k) sum -= l[i][k] * z[k];
            z[i] = sum / l[i][i];
            rest -= z[i] * z[i];
        }
        const auto free = static_cast<double>(count_ - kTerms);
        const double noise = std::sqrt(std::max(rest, 0.0) / free) * (1 + kSurely / std::sqrt(2 * free));
        step = {.light = z.back() / l.back().back(),
                .error = noise / l.back().back(),
                .mean = light_ / static_cast<double>(count_)};
        return true;
    }

  private:
    std::array<Terms, kTerms> products_{};
    Terms with_light_{};
    double light_squared_ = 0, light_ = 0;
    std::size_t count_ = 0;
};

}  // namespace

// The light of single lenslets, those at the outline of what may be a hole left out: a step of it there beside what a
// lamp may do over the part, a polynomial of second order. The step must be as large as any hole's, and five of its
// standard errors.
bool MissingMaterialFinder::is_step_of_light(const Squares& squares) const {
    const Level &level = *squares.level, &lenslets = levels_.front();
    const auto stride = static_cast<std::ptrdiff_t>(level.stride);
    const auto is_at_outline_of_hole = [&](std::size_t at) {
        for (std::ptrdiff_t n = -1; n <= 1; ++n) {
            for (std::ptrdiff_t m = -1; m <= 1; ++m) {
                if (of_hole_[beside(at, n * stride + m)] != of_hole_[at]) return true;
            }
        }
        return false;
    };
    const double middle_m = (lenslets.m - 1) / 2.0, middle_n = (lenslets.n - 1) / 2.0;
    LightFit fit;
    for (int n = 0; n < level.n * level.block; ++n) {
        for (int m = 0; m < level.m * level.block; ++m) {
            const std::size_t k = lenslets.index(m, n), block = level.index(m / level.block, n / level.block);
            if (lenslets.count[k] <= 0 || is_at_outline_of_hole(block)) continue;
            const double x = (m - middle_m) / lenslets.m, y = (n - middle_n) / lenslets.n;
            fit.add({1, x, y, x * x, x * y, y * y, of_hole_[block] != 0 ? 1.0 : 0.0},
                    static_cast<double>(lenslets.light[k]));
        }
    }
    LightFit::Step step;
    return fit.solve(step) && step.light >= static_cast<double>(kMinExcess) * step.mean &&
        step.light >= static_cast<double>(kMinExcessSigmas) * step.error;
}

}  // namespace hord::algo
