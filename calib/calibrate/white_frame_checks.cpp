#include "calib/calibrate/white_frame_checks.h"

#include <algorithm>
#include <cmath>
#include <limits>
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

// Of a pitch: a lenslet that is off by less says nothing against the grid, as place_displaced() has it. In the corners
// of strong distortion, lenslets are squeezed, and their centres are off by some thousandths of a pitch.
constexpr double kMinOff = 0.002;
constexpr int kFewestOfRegion = 8;    // lenslets of a region that is judged
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
constexpr double kMaxOneSided = 0.35;  // of the light; below, centres are off by 0.025 px at the most
// px: as for light that is brighter on one side, twice over; spots that fall-off moves by less pass (see the notes).
constexpr double kMaxByFallOff = 0.05;
// RowShift, px: centres are off by half of it; and in its standard errors.
constexpr double kMaxRowShift = 0.04, kMaxRowShiftDeviations = 8;
// CutLenslets::elongated: spots of real Shack-Hartmann sensors have up to 0.12. Of spots of sigma s, two exposures that
// are d apart have (d / s)^2 / 8.
constexpr double kMaxElongated = 0.15;
// EdgeBlur::more_px2, over own_px2: the variance along is twice that across, so that half of it is not that of the
// lenslets. A light-field microscope's lenslets have 0.44 (soft edges). And in standard errors.
constexpr double kMaxEdgeBlur = 2.0 / 3, kMaxEdgeDeviations = 8;
// PatternShape::unequal. Real white frames have at most 0.005. Two exposures that lie d pitches apart multiply the
// first harmonics along their way by cos(pi d), which alone makes it (1 - cos)^2 / 2 / (1 + cos^2): 0.02 at 0.23 pitch.
constexpr double kMaxUnequal = 0.02;
constexpr double kMaxRoughness = 0.08;
constexpr double kMaxFollowed = 0.3;     // of the residuals' power: what gradients of the light explain
constexpr double kMinFollowed = 0.0002;  // of a pitch: explained residuals that matter
constexpr double kMaxOff = 0.08;         // of the found lenslets
constexpr double kMaxBend = 0.005;       // of a pitch: by polynomials beyond every lens model
// Of neighbours' residuals, and in standard deviations of that of independent pairs: frames of few lenslets.
constexpr double kMaxAlike = 0.2, kMaxAlikeDeviations = 4;
constexpr double kMaxCommon = 0.0002;  // of a pitch: the common part of residuals
// CutLenslets::Beyond::narrower, and in its standard errors. These are too small by half where neighbouring regions
// differ from the law alike: 8 are 4 then.
constexpr double kMaxCut = 0.002, kMaxCutDeviations = 8;
constexpr double kMaxUneven = 0.012;     // CutLenslets::uneven; a real white frame has 0.9 %
constexpr double kMaxMissing = 0.1;      // of the complete lenslets
constexpr double kMaxSaturated = 0.1;    // of the found lenslets
constexpr double kMaxOffOfRegion = 0.2;  // of a region's lenslets: missing or rejected
constexpr int kFewestOff = 5;            // of them: fewer may be dust

constexpr const char* kCure = "record evenly lit lenslets, without a part in the light, in focus";

// Lenslets of one region. Rejected: off the grid by kMinOff or more, and not by the missing light of a neighbour.
struct RegionCount {
    int measured = 0, rejected = 0, missing = 0;
    std::size_t region = 0;
    [[nodiscard]] int off() const { return rejected + missing; }
    [[nodiscard]] int all() const { return measured + missing; }
};

std::vector<RegionCount> count_regions(const GridCalibration& calibration) {
    const Regions regions(calibration);
    const LensletGrid& grid = calibration.fit.grid;
    std::vector<RegionCount> counts(regions.count());
    for (std::size_t k = 0; k < counts.size(); ++k) counts[k].region = k;
    for (const Observation& seen : calibration.observations) {
        RegionCount& count = counts[regions.at(seen.centre_px.x_px, seen.centre_px.y_px)];
        ++count.measured;
        if (seen.used || seen.displaced || seen.beside_missing) continue;
        const PixelPoint at = grid.at(grid.uv(seen.m, seen.n));
        const double off = std::hypot(seen.centre_px.x_px - at.x_px, seen.centre_px.y_px - at.y_px);
        if (off > kMinOff * calibration.pitch_px) ++count.rejected;
    }
    for (const PixelPoint& at : calibration.missing_px) ++counts[regions.at(at.x_px, at.y_px)].missing;
    return counts;
}

// The region at the border of the frame with the largest share of rejected lenslets: where a model ends, it stops
// fitting first. Single lenslets, dirt and bubbles do not reject half of a region.
RegionCount worst_border(const GridCalibration& calibration) {
    const Regions regions(calibration);
    RegionCount worst;
    for (const RegionCount& count : count_regions(calibration)) {
        if (count.measured < kFewestOfRegion || !regions.at_border(count.region)) continue;
        if (worst.measured == 0 || count.rejected * worst.measured > worst.rejected * count.measured) worst = count;
    }
    return worst;
}

// The region with the largest share of lenslets that are missing or rejected: there the grid is that of the model.
RegionCount least_covered(const GridCalibration& calibration) {
    RegionCount worst;
    for (const RegionCount& count : count_regions(calibration)) {
        if (count.all() < kFewestOfRegion) continue;
        if (worst.all() == 0 || count.off() * worst.all() > worst.off() * count.all()) worst = count;
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

// How much more lenslets are blurred one way than what is no second exposure: above 1 is one. 0 if not measured.
double exposed_twice(const EdgeBlur& of) {
    const double most = std::max(kMaxEdgeBlur * of.own_px2, kMaxEdgeDeviations * of.sigma_px2);
    return most > 0 ? of.more_px2 / most : 0;
}

// How much narrower outwards the lenslets are than whole lenslets; 0 if that is within the errors. They are of one
// size, or a relay lens scales them, whichever explains more. A cut makes lenslets narrower only, so what is wider than
// one of these is the other one.
double narrower_than_whole(const CutLenslets& cut) {
    double least = std::numeric_limits<double>::infinity();
    for (const CutLenslets::Beyond& of : {cut.one_size, cut.scaled}) {
        const double noise = std::max(kMaxCut, kMaxCutDeviations * of.sigma);
        if (of.narrower < -of.spread - noise) continue;
        const double narrower = of.narrower - of.spread;
        least = std::min(least, narrower > noise ? narrower : 0);
    }
    return std::isfinite(least) ? least : 0;
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
        return refuse(fmt::format("the grid does not fit the lenslets {}: {} of {} measured there are off it",
                                  Regions(calibration).place(misfit.region), misfit.rejected, misfit.measured),
                      "record evenly lit lenslets in focus up to the frame's corners, without dark or dirty lenslets, "
                      "bubbles or dead pixels there; if they are, the optics cut the lenslets there, or distort more "
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
            "this is no white frame: between its lenslets it is as bright as in them, as between dark dots or lenslets "
            "out of focus",
            "record the light behind a lenslet array, bright on dark, not inverted, and focus the sensor on the "
            "lenslets");
    }
    return {};
}

std::vector<std::string> warnings_about(const GridCalibration& calibration) {
    std::vector<std::string> out;
    if (calibration.apart > 0) {
        out.push_back(
            fmt::format("{} lenslets are apart from the others: no chain of lit neighbours says which ones "
                        "they are; light the whole array, or check them in centres.png",
                        calibration.apart));
    }
    if (calibration.missing > kMaxMissing * calibration.complete) {
        out.push_back(
            fmt::format("{} of {} lenslets have no centre: the grid there is only that of the model; if the "
                        "light should reach them, record the frame again, without a part in the light",
                        calibration.missing, calibration.complete));
    }
    if (calibration.saturated > kMaxSaturated * calibration.found) {
        out.push_back(
            fmt::format("{} of {} measured lenslets are saturated: what is uneven in their light is cut off and cannot "
                        "be checked; lower the exposure or the light until the brightest samples are below full "
                        "scale, and record the frame again",
                        calibration.saturated, calibration.found));
    }
    if (calibration.light_roughness > kMaxRoughness) {
        out.push_back(
            fmt::format("the light differs by {:.0f} % from lenslet to lenslet: a white frame is even; take "
                        "objects out of the light and clean the optics",
                        100 * calibration.light_roughness));
    }
    const LightFollowing& following = calibration.light_following;
    if (following.share > kMaxFollowed && following.px > kMinFollowed * calibration.pitch_px) {
        out.push_back(
            fmt::format("the centres follow the light, by {:.3f} px rms: something in the light is brighter on "
                        "one side of a lenslet; take objects out of the light",
                        following.px));
    }
    const SmoothResiduals& smooth = calibration.smooth_residuals;
    const double by_chance = kMaxAlikeDeviations / std::sqrt(2.0 * std::max(1, smooth.pairs));  // along x and y
    if (smooth.correlation > std::max(kMaxAlike, by_chance) && smooth.px > kMaxCommon * calibration.pitch_px) {
        out.push_back(fmt::format(
            "the centres are off the grid together with their neighbours, by {:.3f} px rms: lenslets are not "
            "misplaced so, bent light and light that is brighter on one side of the lenslets move centres "
            "so, and the grid may be off by ten times as much; take objects out of the light, and use "
            "diffuse or collimated light without other optics",
            smooth.px));
    }
    const RowShift& rows = calibration.row_shift;
    if (std::abs(rows.px) > std::max(kMaxRowShift, kMaxRowShiftDeviations * rows.sigma)) {
        out.push_back(fmt::format(
            "every second row of pixels is shifted along the rows, by {:.2f} px: two fields of the frame show the "
            "lenslets in two places, and the grid lies between them; read all rows at once (no interlacing), and keep "
            "array and light still",
            std::abs(rows.px)));
    }
    const bool interlaced = !out.empty() && out.back().starts_with("every second row");
    const CutLenslets& cut = calibration.cut;
    const EdgeBlur& edges = std::max(calibration.edge_blur, calibration.diagonal_blur,
                                     [](const auto& a, const auto& b) { return exposed_twice(a) < exposed_twice(b); });
    if (cut.elongated > kMaxElongated) {
        out.push_back(fmt::format(
            "all lenslets are longer in the same direction, by {:.0f} %: the frame may be exposed twice or blurred by "
            "motion, and the grid lies in the middle of that; keep array and light still, and record one exposure",
            100 * cut.elongated));
    } else if (!interlaced && exposed_twice(edges) > 1) {
        out.push_back(fmt::format(
            "the lenslets' edges are blurred in one direction and not across it, as by two exposures that lie about "
            "{:.1f} "
            "px apart: the grid lies in the middle of that; keep array and light still, and record one exposure",
            edges.apart_px()));
    } else if (!interlaced && calibration.shape.unequal > kMaxUnequal) {
        out.push_back(
            "the light between the lenslets differs from one direction to the other, as by two exposures that lie a "
            "part of a pitch apart: the grid lies in the middle of that; keep array and light still, and record one "
            "exposure");
    }
    const double narrower = narrower_than_whole(cut);
    if (narrower > 0) {
        out.push_back(fmt::format(
            "the lenslets are narrower outwards than across, by {:.1f} % at the corners: the stop of the "
            "optics cuts them, and their centres may be off by tenths of a pixel; stop the optics down until "
            "the corners' lenslets are whole, and compare the pitch",
            100 * narrower));
    } else if (cut.uneven > std::max(kMaxUneven, kMaxCutDeviations * cut.uneven_sigma)) {
        out.push_back(fmt::format(
            "the shape of the lenslets changes from border to border of the frame, by {:.1f} %: something on one side "
            "of the optics cuts their light, and the grid may be off by pixels; centre the array on the optics' axis "
            "and stop the optics down until the lenslets at all borders are whole",
            200 * cut.uneven));
    }
    if (calibration.one_sided > kMaxOneSided) {
        out.push_back(fmt::format(
            "all lenslets are brighter on the same side, by {:.0f} % at their rim: their centres may be off by tenths "
            "of a pixel; light the array evenly from all directions",
            100 * calibration.one_sided));
    }
    if (calibration.by_fall_off_px > kMaxByFallOff) {
        out.push_back(fmt::format(
            "the light falls off over the frame, and the lenslets' edges are too soft to measure that inside of them: "
            "centres are off by about {:.2f} px towards the light at the most; light the array evenly, or focus the "
            "sensor on the lenslets",
            calibration.by_fall_off_px));
    }
    const int rejected = calibration.rejected - calibration.beside_missing;
    if (rejected > kMaxOff * calibration.found) {
        out.push_back(
            fmt::format("{} of {} measured lenslets are off the grid: clean the array and the optics, or take "
                        "objects out of the light; centres.png shows where",
                        rejected, calibration.found));
    }
    const RegionCount worst = least_covered(calibration);
    const bool all_over = calibration.missing > kMaxMissing * calibration.complete ||
        rejected > kMaxOff * calibration.found;  // told above
    if (!all_over && worst.off() >= kFewestOff && worst.off() > kMaxOffOfRegion * worst.all()) {
        out.push_back(
            fmt::format("{} of {} lenslets {} have no centre or are off the grid: the grid there is only that of the "
                        "model; light the array evenly and in focus up to there, or use optics that distort less",
                        worst.off(), worst.all(), Regions(calibration).place(worst.region)));
    }
    // How far the selected polynomial leaves the best model of a lens, from their errors on unseen lenslets.
    const GridFit& fit = calibration.fit;
    if (fit.grid.model == algo::GridModelKind::cubic || fit.grid.model == algo::GridModelKind::quintic) {
        double best = std::numeric_limits<double>::infinity();
        for (const ModelReport& model : fit.candidates) {
            if (model.model < algo::GridModelKind::cubic)
                best = std::min(best, std::hypot(model.cv_x_rms_px, model.cv_y_rms_px));
        }
        const double bend =
            std::sqrt(std::max(0.0, best * best - std::pow(std::hypot(fit.cv_x_rms_px, fit.cv_y_rms_px), 2)));
        if (bend > kMaxBend * calibration.pitch_px) {
            out.push_back(
                fmt::format("the grid bends by {:.3f} px rms as no lens distorts: if the light on the array is "
                            "aberrated, its spots are not the lenslets' centres; use collimated or diffuse "
                            "light without other optics",
                            bend));
        }
    }
    return out;
}

}  // namespace hord::calib
