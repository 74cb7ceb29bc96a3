#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "calib/calibrate/frame_regions.h"
#include "calib/calibrate/white_frame_checks.h"

namespace hord::calib {
namespace {

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
// OddLight::left_share. Real white frames have at most 0.0022 (spots), but for one of dim, dusty lenslets (0.011);
// drawn ones of one exposure 0.0006.
constexpr double kMaxLeft = 0.004;
constexpr double kMaxRoughness = 0.08;
constexpr double kMaxFollowed = 0.3;     // of the residuals' power: what gradients of the light explain
constexpr double kMinFollowed = 0.0002;  // of a pitch: explained residuals that matter
// LightFollowing::slope_px, of a pitch. A gradient of light moves even a centre of gravity by that gradient times the
// lenslet's second moment: at most p^2 / 12, that of a square that fills its cell. Centres that move by more, or away
// from the light, do not follow it: misplaced lenslets that nearly touch lie in the light of their neighbours, and
// change it.
constexpr double kMaxFollowingSlope = 1.0 / 12;
constexpr double kMaxOff = 0.08;      // of the found lenslets
constexpr double kMaxUnplaced = 0.1;  // px: of a lenslet without a place of its own; below, neighbours of dark ones are
constexpr double kMaxBend = 0.005;    // of a pitch: by polynomials beyond every lens model
// Of neighbours' residuals, and in standard deviations of that of independent pairs: frames of few lenslets.
constexpr double kMaxAlike = 0.2, kMaxAlikeDeviations = 4;
constexpr double kMaxCommon = 0.0002;  // of a pitch: the common part of residuals
// CutLenslets::Beyond::narrower, and in its standard errors. These are too small by half where neighbouring regions
// differ from the law alike: 8 are 4 then.
constexpr double kMaxCut = 0.002, kMaxCutDeviations = 8;
constexpr double kMaxUneven = 0.012;     // CutLenslets::Beyond::uneven; a real white frame has 0.9 %
constexpr double kMaxMissing = 0.1;      // of the complete lenslets
constexpr double kMaxSaturated = 0.1;    // of the found lenslets
constexpr double kMaxOffOfRegion = 0.2;  // of a region's lenslets: missing or rejected
constexpr int kMinOffOfRegion = 5;       // of them: fewer may be dust

using Warning = std::optional<std::string>;

Warning lenslets_apart(const GridCalibration& of) {
    if (of.apart == 0) return std::nullopt;
    return fmt::format(
        "{} lenslets are apart from the others: no chain of lit neighbours says which ones they are; light the whole "
        "array, or check them in centres.png",
        of.apart);
}

bool many_missing(const GridCalibration& of) { return of.missing > kMaxMissing * of.complete; }
Warning missing_lenslets(const GridCalibration& of) {
    if (!many_missing(of)) return std::nullopt;
    return fmt::format(
        "{} of {} lenslets have no centre: the grid there is only that of the model; if the light should reach them, "
        "record the frame again, without a part in the light",
        of.missing, of.complete);
}

Warning saturated_lenslets(const GridCalibration& of) {
    if (!(of.saturated > kMaxSaturated * of.found)) return std::nullopt;
    return fmt::format(
        "{} of {} measured lenslets are saturated: what is uneven in their light is cut off and cannot be checked; "
        "lower the exposure or the light until the brightest samples are below full scale, and record the frame again",
        of.saturated, of.found);
}

Warning rough_light(const GridCalibration& of) {
    if (!(of.light_roughness > kMaxRoughness)) return std::nullopt;
    return fmt::format(
        "the light differs by {:.0f} % from lenslet to lenslet: a white frame is even; take objects out of the light "
        "and clean the optics",
        100 * of.light_roughness);
}

Warning centres_follow_the_light(const GridCalibration& of) {
    const LightFollowing& following = of.light_following;
    if (!(following.share > kMaxFollowed && following.px > kMinFollowed * of.pitch_px)) return std::nullopt;
    if (!(following.slope_px > 0 && following.slope_px < kMaxFollowingSlope * of.pitch_px)) return std::nullopt;
    return fmt::format(
        "the centres follow the light, by {:.3f} px rms: something in the light is brighter on one side of a lenslet; "
        "take objects out of the light",
        following.px);
}

Warning centres_off_together(const GridCalibration& of) {
    const SmoothResiduals& smooth = of.smooth_residuals;
    const double by_chance = kMaxAlikeDeviations / std::sqrt(2.0 * std::max(1, smooth.pairs));  // along x and y
    if (!(smooth.correlation > std::max(kMaxAlike, by_chance) && smooth.px > kMaxCommon * of.pitch_px))
        return std::nullopt;
    return fmt::format(
        "the centres are off the grid together with their neighbours, by {:.3f} px rms: lenslets are not misplaced so, "
        "bent light and light that is brighter on one side of the lenslets move centres so, and the grid may be off by "
        "ten times as much; take objects out of the light, and use diffuse or collimated light without other optics",
        smooth.px);
}

bool interlaced(const GridCalibration& of) {
    const RowShift& rows = of.row_shift;
    return std::abs(rows.px) > std::max(kMaxRowShift, kMaxRowShiftDeviations * rows.sigma);
}
Warning interlaced_rows(const GridCalibration& of) {
    if (!interlaced(of)) return std::nullopt;
    return fmt::format(
        "every second row of pixels is shifted along the rows, by {:.2f} px: two fields of the frame show the lenslets "
        "in two places, and the grid lies between them; read all rows at once (no interlacing), and keep array and "
        "light still",
        std::abs(of.row_shift.px));
}

// How much more lenslets are blurred one way than what is no second exposure: above 1 is one. 0 if not measured.
double exposed_twice(const EdgeBlur& of) {
    const double most = std::max(kMaxEdgeBlur * of.own_px2, kMaxEdgeDeviations * of.sigma_px2);
    return most > 0 ? of.more_px2 / most : 0;
}
// Two fields of interlaced rows are two exposures, too, and told as such.
Warning two_exposures(const GridCalibration& of) {
    if (of.cut.elongated > kMaxElongated) {
        return fmt::format(
            "all lenslets are longer in the same direction, by {:.0f} %: the frame may be exposed twice or blurred by "
            "motion, and the grid lies in the middle of that; keep array and light still, and record one exposure",
            100 * of.cut.elongated);
    }
    if (interlaced(of)) return std::nullopt;
    const EdgeBlur& edges = std::max(of.edge_blur, of.diagonal_blur,
                                     [](const auto& a, const auto& b) { return exposed_twice(a) < exposed_twice(b); });
    if (exposed_twice(edges) > 1) {
        return fmt::format(
            "the lenslets' edges are blurred in one direction and not across it, as by two exposures that lie about "
            "{:.1f} px apart: the grid lies in the middle of that; keep array and light still, and record one exposure",
            edges.apart_px());
    }
    if (of.odd_light.left_share > kMaxLeft && !(of.one_sided > kMaxOneSided)) {
        return "the lenslets' light differs from itself turned by half a turn, and light that is brighter on one side "
               "does not explain it: a second, weaker exposure lies beside the first, or the light is aberrated, and "
               "the grid lies between both; keep array and light still, and record one exposure";
    }
    if (!(of.shape.unequal > kMaxUnequal)) return std::nullopt;
    return "the light between the lenslets differs from one direction to the other, as by two exposures that lie a "
           "part of a pitch apart: the grid lies in the middle of that; keep array and light still, and record one "
           "exposure";
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
// How much more evenly the lenslets' shape changes over the frame than that of whole lenslets of either kind; 0 if that
// is within the errors.
double more_uneven_than_whole(const CutLenslets& cut) {
    const CutLenslets::Beyond& least = cut.one_size.uneven < cut.scaled.uneven ? cut.one_size : cut.scaled;
    return least.uneven > std::max(kMaxUneven, kMaxCutDeviations * least.uneven_sigma) ? least.uneven : 0;
}
Warning cut_by_a_stop(const GridCalibration& of) {
    const double narrower = narrower_than_whole(of.cut);
    if (narrower > 0) {
        return fmt::format(
            "the lenslets are narrower outwards than across, by {:.1f} % at the corners: the stop of the optics cuts "
            "them, and their centres may be off by tenths of a pixel; stop the optics down until the corners' lenslets "
            "are whole, and compare the pitch",
            100 * narrower);
    }
    const double uneven = more_uneven_than_whole(of.cut);
    if (uneven == 0) return std::nullopt;
    return fmt::format(
        "the shape of the lenslets changes from border to border of the frame, by {:.1f} %: something on one side of "
        "the optics cuts their light, and the grid may be off by pixels; centre the array on the optics' axis and stop "
        "the optics down until the lenslets at all borders are whole; in a frame that was cut out beside the axis, "
        "the distortion may change them so, too: record the whole frame",
        200 * uneven);
}

Warning light_on_one_side(const GridCalibration& of) {
    if (of.one_sided > kMaxOneSided) {
        return fmt::format(
            "all lenslets are brighter on the same side, by {:.0f} % at their rim: their centres may be off by tenths "
            "of a pixel; light the array evenly from all directions",
            100 * of.one_sided);
    }
    const OddLight& odd = of.odd_light;
    if (odd.known() ? odd.unsure_px > kMaxByFallOff : odd.by_light() && odd.shift() > kMaxByFallOff) {
        return fmt::format(
            "all lenslets are brighter on the same side, and their edges are too soft to measure well how far that "
            "moves their centres: about {:.2f} px, which {}; a second, weaker exposure beside the first looks alike; "
            "light the array evenly from all directions, focus the sensor on the lenslets, keep array and light "
            "still, and record one exposure",
            odd.shift(),
            odd.known() ? fmt::format("was taken off, and may be wrong by {:.2f} px", odd.unsure_px) : "is left");
    }
    return std::nullopt;
}

Warning light_falls_off(const GridCalibration& of) {
    if (!(of.by_fall_off_px > kMaxByFallOff)) return std::nullopt;
    return fmt::format(
        "the light falls off over the frame, and the lenslets' edges are too soft to measure that inside of them: "
        "centres are off by about {:.2f} px towards the light at the most; light the array evenly, or focus the sensor "
        "on the lenslets",
        of.by_fall_off_px);
}

// Without those that a missing neighbour moves.
int off_the_grid(const GridCalibration& of) { return of.rejected - of.beside_missing; }
bool many_off(const GridCalibration& of) { return off_the_grid(of) > kMaxOff * of.found; }
Warning lenslets_off_the_grid(const GridCalibration& of) {
    if (!many_off(of)) return std::nullopt;
    return fmt::format(
        "{} of {} measured lenslets are off the grid: clean the array and the optics, or take objects out of the "
        "light; centres.png shows where",
        off_the_grid(of), of.found);
}

// Lenslets whose light says that they are not where the grid is, and that have no place of their own.
Warning lenslets_without_their_place(const GridCalibration& of) {
    int count = 0;
    double most = 0;
    for (const Observation& seen : of.observations) {
        if (!seen.unplaced || seen.beside_missing) continue;
        const algo::PixelPoint at = of.fit.grid.at(of.fit.grid.uv(seen.m, seen.n));
        const double off = std::hypot(seen.centre_px.x_px - at.x_px, seen.centre_px.y_px - at.y_px);
        if (!(off > kMaxUnplaced)) continue;
        ++count;
        most = std::max(most, off);
    }
    if (count == 0 || many_off(of)) return std::nullopt;
    return fmt::format(
        "{} lenslets are off the grid by up to {:.2f} px, side by side or too far to be placed there: something in the "
        "light moves them, or they are misplaced; the grid has them in its own places; take drops, bubbles and dust "
        "off the array, and if they stay there, leave these lenslets out (centres.png shows where)",
        count, most);
}

// The region with the largest share of lenslets that are missing or rejected: there the grid is that of the model.
RegionCount least_covered(const GridCalibration& calibration) {
    RegionCount worst;
    for (const RegionCount& count : count_regions(calibration)) {
        if (count.all() < kMinOfRegion) continue;
        if (worst.all() == 0 || count.off() * worst.all() > worst.off() * count.all()) worst = count;
    }
    return worst;
}
Warning uncovered_region(const GridCalibration& of) {
    if (many_missing(of) || many_off(of)) return std::nullopt;  // told of the whole frame
    const RegionCount worst = least_covered(of);
    if (worst.off() < kMinOffOfRegion || !(worst.off() > kMaxOffOfRegion * worst.all())) return std::nullopt;
    return fmt::format(
        "{} of {} lenslets {} have no centre or are off the grid: the grid there is only that of the model; light the "
        "array evenly and in focus up to there, without dark lenslets or dead rows of pixels, or use optics that "
        "distort less",
        worst.off(), worst.all(), Regions(of).place(worst.region));
}

// How far the selected polynomial leaves the best model of a lens, from their errors on unseen lenslets.
Warning bent_grid(const GridCalibration& of) {
    const GridFit& fit = of.fit;
    if (fit.grid.model != algo::GridModelKind::cubic && fit.grid.model != algo::GridModelKind::quintic)
        return std::nullopt;
    double best = std::numeric_limits<double>::infinity();
    for (const ModelReport& model : fit.candidates) {
        if (model.model < algo::GridModelKind::cubic)
            best = std::min(best, std::hypot(model.cv_x_rms_px, model.cv_y_rms_px));
    }
    const double bend =
        std::sqrt(std::max(0.0, best * best - std::pow(std::hypot(fit.cv_x_rms_px, fit.cv_y_rms_px), 2)));
    if (!(bend > kMaxBend * of.pitch_px)) return std::nullopt;
    return fmt::format(
        "the grid bends by {:.3f} px rms as no lens distorts: if the light on the array is aberrated, its spots are "
        "not the lenslets' centres; use collimated or diffuse light without other optics",
        bend);
}

}  // namespace

std::vector<std::string> warnings_about(const GridCalibration& calibration) {
    std::vector<std::string> out;
    for (const auto warning :
         {lenslets_apart, missing_lenslets, saturated_lenslets, rough_light, centres_follow_the_light,
          centres_off_together, interlaced_rows, two_exposures, cut_by_a_stop, light_on_one_side, light_falls_off,
          lenslets_off_the_grid, lenslets_without_their_place, uncovered_region, bent_grid}) {
        if (auto text = warning(calibration)) out.push_back(std::move(*text));
    }
    return out;
}

}  // namespace hord::calib
