#include "hal_sim/optics/camera/slope_blur.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/optics/scene/exact_math.h"

namespace hord::sim {
namespace {

constexpr double kPi = 3.14159265358979323846;

double sinc_squared(double x) {
    if (std::abs(x) < 1e-4) return 1 - kPi * kPi * x * x / 3;
    double sine = 0, cosine = 1;
    exact::sin_cos(kPi * x, sine, cosine);
    return sine * sine / (kPi * kPi * x * x);
}

double normal(double x) { return std::abs(x) < 30 ? 0.39894228040143268 * exact::exp(-0.5 * x * x) : 0; }

// Five-point Gauss-Legendre quadrature over [a, b].
template <class F>
double five_points(double a, double b, const F& f) {
    constexpr double at[] = {0.90617984593866399, 0.53846931010568309},
                     weight[] = {0.23692688505618909, 0.47862867049936647};
    const double middle = 0.5 * (a + b), half = 0.5 * (b - a);
    double sum = 0.56888888888888889 * f(middle);
    for (int k = 0; k < 2; ++k) sum += weight[k] * (f(middle - half * at[k]) + f(middle + half * at[k]));
    return half * sum;
}

}  // namespace

SlopeBlur SlopeBlur::diffraction(double first_zero, double step, int most_cells) {
    return {sinc_squared, first_zero, step, most_cells};
}
SlopeBlur SlopeBlur::gaussian(double rms, double step, int most_cells) { return {normal, rms, step, most_cells}; }

// `density`: of a point's light, even, with integral 1, by slope in `unit` bin pitches.
SlopeBlur::SlopeBlur(double (&density)(double), double unit, double step, int most_cells)
    : split_(std::max(1, static_cast<int>(std::ceil(step / kFinest - 1e-9)))) {
    const double narrow = step / split_;
    middle_ = split_ * most_cells;
    share_.resize(static_cast<std::size_t>(2 * middle_ + split_));
    // F(x): share of a point's light before x. The light of a uniform fine cell before an edge is a difference of the
    // integral of F: x F(x) - M(x), with M(x) = integral of t density(t). All edges are multiples of a fine cell, so F
    // and M are cumulative sums from 0.
    const int edges = middle_ + 2 * split_ + 1;
    std::vector<double> integral(static_cast<std::size_t>(2 * edges + 1));  // at (k - edges) * narrow
    double share = 0, moment = 0;                                           // from 0
    const double apart = narrow / unit;
    const int pieces = std::max(1, static_cast<int>(std::ceil(4 * apart)));
    for (int k = 0; k <= edges; ++k) {
        const double x = k * apart;
        integral[static_cast<std::size_t>(edges + k)] = x * (0.5 + share) - moment;
        integral[static_cast<std::size_t>(edges - k)] = -x * (0.5 - share) - moment;
        for (int p = 0; p < pieces; ++p) {
            const double a = x + apart * p / pieces, b = x + apart * (p + 1) / pieces;
            share += five_points(a, b, density);
            moment += five_points(a, b, [&](double t) { return t * density(t); });
        }
    }
    const auto before = [&](int edge) {  // of a fine cell's light that begins at 0; `edge` in fine cells
        const auto at = static_cast<std::size_t>(edge + edges);
        return (integral[at] - integral[at - 1]) / apart;
    };
    for (int d = -middle_; d < middle_ + split_; ++d) {  // the cell begins d fine cells before the fine one
        share_[static_cast<std::size_t>(d + middle_)] = before(split_ - d) - before(-d);
    }
}

SlopeGrid SlopeBlur::fine(const SlopeGrid& grid) const {
    return {grid.left, grid.top, grid.step / split_, grid.i * split_, grid.j * split_};
}

void SlopeBlur::blur(const SlopeGrid& grid, const double* fine, double* cells) const {
    const int width = grid.i * split_, height = grid.j * split_;
    std::vector<double> row(static_cast<std::size_t>(grid.i));
    for (int l = 0; l < height; ++l) {
        const double* const line = fine + static_cast<std::ptrdiff_t>(l) * width;
        int first = 0, last = width - 1;  // columns with light
        while (first < width && line[first] == 0) ++first;
        if (first == width) continue;
        while (line[last] == 0) --last;
        std::fill(row.begin(), row.end(), 0.0);
        for (int f = first; f <= last; ++f) {
            for (int k = 0; k < grid.i; ++k) row[static_cast<std::size_t>(k)] += line[f] * share(f, k);
        }
        for (int c = 0; c < grid.j; ++c) {
            const double part = share(l, c);
            for (int k = 0; k < grid.i; ++k) cells[c * grid.i + k] += part * row[static_cast<std::size_t>(k)];
        }
    }
}

}  // namespace hord::sim
