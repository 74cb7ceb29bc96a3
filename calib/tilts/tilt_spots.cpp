// Measures the spots of one capture relative to the lenslets' centres.
#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "calib/tilts/tilts.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

using algo::PixelPoint;

constexpr std::size_t kFoldLenslets = 3000;
constexpr double kMinMatch = 0.5;  // as of the white frame's lenslets
constexpr double kMinAmplitude = 0.08;

// The position of the spot to about a pixel: the light of many lenslets, summed pixel by pixel.
std::optional<PixelPoint> coarse_place(const WhiteImage& image, const std::vector<PixelPoint>& centres, double pitch) {
    const int half = static_cast<int>(std::floor(0.5 * pitch));
    const int side = 2 * half + 1;
    std::vector<double> fold(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    const std::size_t every = centres.size() / kFoldLenslets + 1;
    for (std::size_t k = 0; k < centres.size(); k += every) {
        const auto cx = static_cast<int>(std::lround(centres[k].x_px));
        const auto cy = static_cast<int>(std::lround(centres[k].y_px));
        if (cx < half || cy < half || cx + half >= image.width_px() || cy + half >= image.height_px()) continue;
        std::size_t at = 0;
        for (int y = -half; y <= half; ++y) {
            for (int x = -half; x <= half; ++x) fold[at++] += image.at(cx + x, cy + y);
        }
    }
    const auto [low, high] = std::minmax_element(fold.begin(), fold.end());
    if (!(*high > *low)) return std::nullopt;
    // The centre of gravity above half of the range.
    const double level = 0.5 * (*low + *high);
    double sum = 0, x_sum = 0, y_sum = 0;
    std::size_t at = 0;
    for (int y = -half; y <= half; ++y) {
        for (int x = -half; x <= half; ++x) {
            const double light = std::max(0.0, fold[at++] - level);
            sum += light;
            x_sum += light * x;
            y_sum += light * y;
        }
    }
    return PixelPoint{x_sum / sum, y_sum / sum};
}

// The mean without values off by more than five robust standard deviations.
double robust_mean(std::vector<double> values) {
    std::vector<double> sorted = values;
    const double median = common::upper_median(std::span(sorted));
    for (std::size_t k = 0; k < sorted.size(); ++k) sorted[k] = std::abs(values[k] - median);
    const double most = 5 * 1.4826 * common::upper_median(std::span(sorted)) + 1e-3;
    std::erase_if(values, [&](double v) { return std::abs(v - median) > most; });
    const auto count = static_cast<double>(values.size());
    double mean = 0;
    for (const double v : values) mean += v / count;
    return mean;
}

}  // namespace

Result<SpotPlace> measure_spots(const FrameView& frame, const std::optional<FrameView>& dark,
                                const std::optional<FrameView>& flat, const GridCalibration& grid) {
    if (frame.width_px != grid.fit.grid.width_px || frame.height_px != grid.fit.grid.height_px) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("a capture of {}x{} px for a grid of {}x{} px", frame.width_px, frame.height_px,
                                grid.fit.grid.width_px, grid.fit.grid.height_px),
                    "capture with the same region of the sensor");
    }
    const auto image = WhiteImage::open(frame, dark, flat);
    if (!image) return tl::unexpected(image.error());
    std::vector<PixelPoint> centres;
    for (const GridCalibration::Node& node : grid.nodes()) {
        if (node.found) centres.push_back(node.centre_px);
    }
    const auto coarse = coarse_place(*image, centres, grid.pitch_px);
    if (!coarse)
        return fail(ErrorCode::refused, "the capture shows no spot in the lenslets",
                    "let collimated light in, below saturation");
    // The profile is learned from the lenslets nearest to the middle.
    const PixelPoint middle{0.5 * frame.width_px, 0.5 * frame.height_px};
    const auto far = [&](const PixelPoint& p) { return std::hypot(p.x_px - middle.x_px, p.y_px - middle.y_px); };
    std::sort(centres.begin(), centres.end(),
              [&](const PixelPoint& a, const PixelPoint& b) { return far(a) < far(b); });
    std::vector<PixelPoint> seeds;
    for (std::size_t k = 0; k < std::min<std::size_t>(centres.size(), 400); ++k)
        seeds.push_back({centres[k].x_px + coarse->x_px, centres[k].y_px + coarse->y_px});
    const auto finder = CentreFinder::learn(*image, seeds, grid.pitch_px);
    if (!finder) return tl::unexpected(finder.error());
    std::vector<double> x, y;
    for (const PixelPoint& centre : centres) {
        const auto spot =
            finder->measure({centre.x_px + coarse->x_px, centre.y_px + coarse->y_px}, 0.3 * grid.pitch_px);
        if (!spot || spot->match < kMinMatch || spot->amplitude_dn < kMinAmplitude * finder->typical_amplitude_dn())
            continue;
        x.push_back(spot->centre_px.x_px - centre.x_px);
        y.push_back(spot->centre_px.y_px - centre.y_px);
    }
    if (x.size() < 4) {
        return fail(ErrorCode::refused, fmt::format("only {} lenslets show a spot", x.size()),
                    "let collimated light in over the whole field, below saturation");
    }
    const auto lenslets = static_cast<int>(x.size());
    return SpotPlace{{robust_mean(std::move(x)), robust_mean(std::move(y))}, lenslets};
}

}  // namespace hord::calib
