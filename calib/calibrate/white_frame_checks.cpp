#include "calib/calibrate/white_frame_checks.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>

#include "calib/calibrate/frame_regions.h"
#include "calib/calibrate/light_on_grid.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

// Of the frame's bright pixels. Light beside the grid is that of another pattern, such as through a part.
constexpr double kMinLightOnGrid = 0.85;
// The same, of one region of the frame: less means that the grid does not reach its lenslets.
constexpr double kMinLightOnGridOfRegion = 0.5;

constexpr double kMaxRejected = 0.5;  // of a region's lenslets
constexpr double kMinArea = 0.15;     // of a lenslet's cell, over that in the middle: less is a fold
constexpr double kMaxTorn = 0.002;    // pairs of neighbours, over the lenslets
constexpr double kMaxWaves = 0.985;   // PatternShape
constexpr double kMaxFirst = 0.997;
constexpr double kMinEven = 0.004, kMaxEven = 0.98;
// Dark dots on a bright ground, on a square lattice (a hexagonal one has two gaps a dot, and no lattice of them): what
// was taken for lenslets are the gaps between them. Between small dots it is bright everywhere; round lenslets that
// touch leave more dark. Between large dots the gaps are stars; spots with the cross of diffraction are smaller.
constexpr double kMaxBetween = 0.8, kMinDark = 0.17, kMaxDarkOfStars = 0.8, kMaxStar = 0.1;
// PatternShape::second: a lattice's cell has one lenslet, which is darkest at its rim. Real and drawn lenslets have
// 0.0.
constexpr double kMaxSecond = 0.5;

constexpr const char* kCure = "record evenly lit lenslets, without a part in the light, in focus";

// The region at the border of the frame with the largest share of rejected lenslets: where a model ends, it stops
// fitting first. Single lenslets, dirt and bubbles do not reject half of a region.
RegionCount worst_border(const GridCalibration& calibration) {
    const Regions regions(calibration);
    RegionCount worst;
    for (const RegionCount& count : count_regions(calibration)) {
        if (count.measured < kMinOfRegion || !regions.at_border(count.region)) continue;
        if (worst.measured == 0 || count.rejected * worst.measured > worst.rejected * count.measured) worst = count;
    }
    return worst;
}

// Where the distortion folds the frame, if it does: two lenslets of the grid in one place. Some lenslets are looked at,
// and all of those in the corners, where folds begin.
std::optional<PixelPoint> fold_of(const LensletGrid& grid) {
    const double middle = grid.steps_px({0, 0}).area_px2();
    const double middle_x = 0.5 * grid.width_px, middle_y = 0.5 * grid.height_px;
    const double corner2 = 0.8 * (middle_x * middle_x + middle_y * middle_y);  // squared distance from the middle
    const int step = std::max(1, std::max(grid.columns, grid.rows) / 64);
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const LensletGrid::Uv uv = grid.uv(m, n);
            const PixelPoint at = grid.at(uv);
            const double x = at.x_px - middle_x, y = at.y_px - middle_y;
            if (!grid.in_frame(at) || (x * x + y * y < corner2 && (m % step != 0 || n % step != 0))) continue;
            if (grid.steps_px(uv).area_px2() / middle < kMinArea) return at;
        }
    }
    return std::nullopt;
}

}  // namespace

Result<void> check_white_frame(const WhiteImage& image, const GridCalibration& calibration) {
    const auto refuse = [](std::string what, const char* cure = kCure) {
        return fail(ErrorCode::refused, std::move(what), cure);
    };
    const LightOnGrid light = light_on_grid(image, calibration);
    if (light.share < kMinLightOnGrid) {
        return refuse(
            fmt::format("this is no white frame: only {:.0f} % of its light fits the grid, {:.0f} % is the least",
                        100 * light.share, 100 * kMinLightOnGrid));
    }
    if (light.worst < kMinLightOnGridOfRegion) {
        return refuse(fmt::format("the grid does not reach the lenslets {}: only {:.0f} % of the light there fits it",
                                  Regions(calibration).place(light.region), 100 * light.worst),
                      "record evenly lit lenslets in focus up to the frame's corners, or stop the optics down: the "
                      "lenslets overlap or the distortion is too strong there");
    }
    const RegionCount misfit = worst_border(calibration);
    if (misfit.rejected > kMaxRejected * misfit.measured) {
        return refuse(
            fmt::format("the grid does not fit the lenslets {}: {} of {} measured there are off it",
                        Regions(calibration).place(misfit.region), misfit.rejected, misfit.measured),
            "record evenly lit lenslets in focus up to the frame's corners, in one exposure, without dark or dirty "
            "lenslets, bubbles or dead pixels there; if they are, the optics cut the lenslets there, or distort more "
            "than the grid's models can describe");
    }
    if (calibration.torn > std::max(3.0, kMaxTorn * calibration.found)) {
        return refuse(fmt::format("the lenslets cannot be numbered: {} pairs of neighbours are not one pitch apart",
                                  calibration.torn));
    }
    if (const auto fold = fold_of(calibration.fit.grid)) {
        const Regions regions(calibration);
        return refuse(fmt::format("the grid folds inside the frame, {}: its distortion places two lenslets in one spot",
                                  regions.place(regions.at(fold->x_px, fold->y_px))),
                      "record evenly lit lenslets up to the frame's corners, or use optics with less distortion");
    }
    const PatternShape& shape = calibration.shape;
    if (shape.wave_share > kMaxWaves || shape.first_share > kMaxFirst) {
        return refuse(
            fmt::format("this is no white frame: {:.1f} % of its pattern are plain waves, as of gratings or of "
                        "lenslets far out of focus",
                        100 * std::max(shape.wave_share, shape.first_share)),
            "focus the sensor on the lenslets, and record them in even light");
    }
    const bool square = calibration.fit.grid.kind == algo::LatticeKind::square;
    if (square && shape.even_share < kMinEven) {
        return refuse("this is no white frame: its dark and bright places have the same shape, as of a checkerboard",
                      "record a lenslet array in even light");
    }
    if (shape.even_share > kMaxEven) {
        return refuse(fmt::format("the grid has every {} lenslet only: the same light lies in the middle of {} of them",
                                  square ? "second" : "third", square ? "four" : "three"),
                      "record lenslets with a pitch of 8 px or more");
    }
    if (shape.second > kMaxSecond) {
        return refuse(
            fmt::format("this is no white frame: in the middle of {} lenslets lie other bright places, as in a "
                        "checkerboard",
                        square ? "four" : "three"),
            "record a lenslet array in even light");
    }
    if (square &&
        ((shape.between > kMaxBetween && shape.dark_share < kMinDark) ||
         (shape.dark_share < kMaxDarkOfStars && shape.corners < -kMaxStar))) {
        return refuse(
            "this is no white frame: between its lenslets it is as bright as in them, as between dark dots, lenslets "
            "out of focus or those exposed twice",
            "record the light behind a lenslet array, bright on dark, not inverted, in one exposure while array and "
            "light are still, and focus the sensor on the lenslets");
    }
    return {};
}

}  // namespace hord::calib
