#include "calib/calibrate/lenslet_shape.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <vector>

#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr std::size_t kOneSided = 100, kEdges = 400;  // lenslets
constexpr double kMaxSquare = 0.01;                   // CentreFinder::lobes, four of them: round lenslets have none
constexpr double kNormal = 0.6745;  // median deviation of a normal distribution, over its standard deviation

// Of the median: as that of the mean of as many normal values, which is less by a fifth.
double standard_error(std::vector<double> values, double median) {
    for (double& value : values) value = std::abs(value - median);
    return 1.2533 / kNormal * common::upper_median(std::span(values)) / std::sqrt(static_cast<double>(values.size()));
}

}  // namespace

double one_sided(const CentreFinder& finder, const GridCalibration& of) {
    if (of.odd_light.known())
        return finder.half_height_radius_px() * std::hypot(of.odd_light.gradient.x_px, of.odd_light.gradient.y_px);
    const std::vector<Observation>& observations = of.observations;
    std::vector<double> x, y;
    const std::size_t every = std::max<std::size_t>(1, observations.size() / kOneSided);
    for (std::size_t k = 0; k < observations.size(); k += every) {
        const auto gradient = finder.gradient(observations[k].centre_px);
        if (!gradient) continue;
        x.push_back(gradient->x_px);
        y.push_back(gradient->y_px);
    }
    return x.empty() ? 0 : std::hypot(common::upper_median(std::span(x)), common::upper_median(std::span(y)));
}

std::optional<std::complex<double>> four_lobes(const CentreFinder& finder, std::span<const Observation> observations) {
    std::complex<double> sum;
    int count = 0;
    const std::size_t every = std::max<std::size_t>(1, observations.size() / kOneSided);
    for (std::size_t k = 0; k < observations.size(); k += every) {
        if (!observations[k].used) continue;
        const auto of = finder.lobes(observations[k].centre_px, 4);
        if (!of) continue;
        sum += *of;
        ++count;
    }
    if (!(std::abs(sum) > kMaxSquare * count)) return std::nullopt;
    return sum / static_cast<double>(count);
}

EdgeBlur edge_blur(const CentreFinder& finder, const Lattice& lattice, std::span<const Observation> observations) {
    std::vector<double> x, y;
    std::complex<double> squares;
    const std::size_t every = std::max<std::size_t>(1, observations.size() / kEdges);
    for (std::size_t k = 0; k < observations.size(); k += every) {
        if (!observations[k].used) continue;
        const auto of = finder.edge_blur_px2(observations[k].centre_px);
        if (!of) continue;
        x.push_back(of->real());
        y.push_back(of->imag());
        squares += finder.lobes(observations[k].centre_px, 4).value_or(0.0);
    }
    if (x.empty()) return {};
    const double along_x = common::upper_median(std::span(x)), aslant = common::upper_median(std::span(y));
    std::complex<double> more(along_x, aslant);
    const bool crossed = lattice.kind == algo::LatticeKind::hexagonal;
    if (crossed && std::abs(squares) > kMaxSquare * static_cast<double>(x.size())) {
        const algo::PixelPoint row = lattice.stagger == algo::Stagger::columns ? lattice.step_v : lattice.step_u;
        more *= std::polar(1.0, -2 * std::atan2(row.y_px, row.x_px));
        more.real(std::max(0.0, more.real()));  // below 0: across the rows
    }
    return {std::abs(more), std::hypot(standard_error(x, along_x), standard_error(y, aslant)),
            finder.edge_variance_px2()};
}

}  // namespace hord::calib
