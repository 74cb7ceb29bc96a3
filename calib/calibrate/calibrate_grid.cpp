#include "calib/calibrate/calibrate_grid.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include <Eigen/Dense>
#include <fmt/format.h>

#include "algo/frame/extents.h"
#include "calib/calibrate/blemished_lenslets.h"
#include "calib/calibrate/cut_lenslets.h"
#include "calib/calibrate/diagonal_blur.h"
#include "calib/calibrate/fall_off.h"
#include "calib/calibrate/hexagonal_exposures.h"
#include "calib/calibrate/lenslet_chain.h"
#include "calib/calibrate/lenslet_shape.h"
#include "calib/calibrate/missing_neighbours.h"
#include "calib/calibrate/neighbour_statistics.h"
#include "calib/calibrate/pattern_shape.h"
#include "calib/calibrate/white_frame_checks.h"
#include "calib/lattice/centre_weights.h"
#include "calib/lattice/lenslet_coverage.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

constexpr double kMinNeighbours = 0.5;  // share of the neighbours of measured lenslets that are measured, too
// Cross-validated error an axis, over the pitch. Three standard deviations of a lenslet's position stay within half a
// bin of the finest decode, so that its centre bin is correct. Larger errors mean that the frame is no white frame:
// light with structure, such as through a part, moves centres by tenths of a pixel.
constexpr double kMaxError = 0.5 / algo::kMaxBins / 3;
// Straight edges lie alike on the pixels along their whole length, and pixels sample the narrow weight coarsely:
// centres of lenslets with corners are off by up to 0.13 px. So such frames are smoothed.
constexpr double kMaxCorners = 0.01;
constexpr int kForShape = 100;  // lenslets
constexpr double kSmooth = 1;   // px, sigma
// Fall-off that moves centres by less is left. RMS, px: what rounding adds to the positions that lenslets are decoded
// at (1/32 px, algo/frame/resample.h).
constexpr double kMinByFallOff = 1.0 / 32 / (2 * std::numbers::sqrt3);
// Of a pitch: a blemish that can move a centre by less does not matter, as displacements do not (place_displaced).
constexpr double kMinByBlemish = 0.002;
constexpr std::size_t kSplitCentres = 1500, kFewestSplit = 250;
constexpr double kSplitPixels = 400'000;  // of all their windows together, to limit the time

// A grid with the lattice's steps, lenslet (0, 0) at the seed; u and v are about 1 at the frame's corners.
LensletGrid grid_of(const Lattice& lattice, const WhiteImage& image) {
    LensletGrid grid;
    grid.kind = lattice.kind;
    grid.stagger = lattice.stagger;
    grid.width_px = image.width_px();
    grid.height_px = image.height_px();
    grid.middle_x_px = 0.5 * (image.width_px() - 1);
    grid.middle_y_px = 0.5 * (image.height_px() - 1);
    grid.radius_px = 0.5 * std::max(image.width_px(), image.height_px());
    grid.span = std::max(1.0, grid.radius_px / lattice.pitch_px());
    grid.columns = grid.rows = 1;
    grid.model = algo::GridModelKind::affine;
    const double s = grid.span;
    grid.parameters = {lattice.seed_px.x_px,    lattice.seed_px.y_px,    s * lattice.step_u.x_px,
                       s * lattice.step_v.x_px, s * lattice.step_u.y_px, s * lattice.step_v.y_px};
    return grid;
}

// The places of lenslets near the seed, the nearest first.
std::vector<PixelPoint> near_seed(const Lattice& lattice, const LensletGrid& steps) {
    std::vector<std::pair<double, PixelPoint>> by_distance;
    for (const LensletPlace& place : lenslets_inside(steps, steps, lattice.reach_px)) {
        by_distance.emplace_back(std::hypot(place.at.x_px - lattice.seed_px.x_px, place.at.y_px - lattice.seed_px.y_px),
                                 place.at);
    }
    std::sort(by_distance.begin(), by_distance.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<PixelPoint> places;
    for (const auto& [far, at] : by_distance) {
        if (far > 0.7 * lattice.reach_px || places.size() == 400) break;
        places.push_back(at);
    }
    return places;
}

// How far the lenslets near the seed have corners: the part of their light with lobes (CentreFinder::lobes), four of a
// square lattice and six of a hexagonal one that lie between the neighbours. Square lenslets on a hexagonal lattice
// have four lobes, whichever way their sides lie; 0 for round ones, below 0 for crosses and stars towards the
// neighbours.
double corners_of(const CentreFinder& finder, const Lattice& lattice, std::span<const PixelPoint> places) {
    const bool square = lattice.kind == algo::LatticeKind::square;
    const int count = square ? 4 : 6;
    // Spots have no straight edges, and soft ones need no smoothing (it hides the inside of lenslets from fall_off()).
    const bool sharp = finder.weights().plateau && finder.edge_variance_px2() < kSmooth * kSmooth;
    const PixelPoint to_neighbour = lattice.stagger == algo::Stagger::columns ? lattice.step_v : lattice.step_u;
    std::complex<double> sum, four;
    int measured = 0;
    for (const PixelPoint& place : places) {
        const auto spot = finder.measure(place, 0.3 * lattice.pitch_px());
        const auto lobes = spot ? finder.lobes(spot->centre_px, count) : std::nullopt;
        if (!lobes) continue;
        sum += *lobes;
        if (!square && sharp) four += finder.lobes(spot->centre_px, 4).value_or(0.0);
        if (++measured == kForShape) break;
    }
    if (measured == 0) return 0;
    const double between = -(sum * std::polar(1.0, -count * std::atan2(to_neighbour.y_px, to_neighbour.x_px))).real();
    return (square ? between : std::max(between, std::abs(four))) / measured;
}

// What is left of the shift that straight edges cause: it depends on where between the pixels a lenslet lies. Learned
// from the residuals and subtracted. The place is that of the grid, with the lenslet's own shift if it has one:
// the noise of a centre moves it between the pixels, so that the measured place would explain the noise as well. Where
// all lenslets lie alike between pixels, there is nothing to learn from.
void remove_pixel_phase(const LensletGrid& grid, std::vector<Observation>& observations) {
    for (double PixelPoint::*axis : {&PixelPoint::x_px, &PixelPoint::y_px}) {
        const auto waves = [&](const Observation& seen) {
            const double turn = 2 * std::numbers::pi * grid.centre_px(seen.m, seen.n).*axis;
            return Eigen::Vector2d(std::sin(turn), std::sin(2 * turn));
        };
        Eigen::Matrix2d normal = 1e-3 * static_cast<double>(observations.size()) * Eigen::Matrix2d::Identity();
        Eigen::Vector2d right = Eigen::Vector2d::Zero();
        for (const Observation& seen : observations) {
            if (!seen.used) continue;
            const Eigen::Vector2d here = waves(seen);
            normal += here * here.transpose();
            right += (seen.centre_px.*axis - grid.at(grid.uv(seen.m, seen.n)).*axis) * here;
        }
        const Eigen::Vector2d height = normal.ldlt().solve(right);
        for (Observation& seen : observations) seen.centre_px.*axis -= height.dot(waves(seen));
    }
}

// Renumbers lenslets: (0, 0) is the first column and row with one inside the frame.
void count_from_zero(LensletGrid& grid, std::vector<Observation>& observations, const IndexRange& inside) {
    const auto [low_m, high_m, low_n, high_n] = inside;
    const bool by_rows = grid.stagger == algo::Stagger::rows;
    const int turned = by_rows ? low_n : low_m;
    // Counting from an odd row (or column) exchanges the shifted ones, which moves the whole grid by half a pitch.
    const LensletGrid::Uv before = grid.uv(low_m, low_n);
    if (grid.stagger != algo::Stagger::none) grid.parity = (grid.parity + turned) & 1;
    const LensletGrid::Uv after = grid.uv(0, 0);
    grid.origin_u += (after.u - before.u) * grid.span;
    grid.origin_v += (after.v - before.v) * grid.span;
    grid.columns = high_m - low_m + 1;
    grid.rows = high_n - low_n + 1;
    for (Observation& seen : observations) {
        seen.m -= low_m;
        seen.n -= low_n;
    }
}

// Extends the grid to all lenslets that its model places inside the frame: barrel distortion brings some into the
// corners from columns and rows beyond those measured. What the model folds back into the frame is none of them.
void extend_to_frame(LensletGrid& grid, std::vector<Observation>& observations) {
    const double middle = grid.steps_px({0, 0}).area_px2();
    const auto reaches = [&](int first_m, int last_m, int first_n, int last_n) {
        for (int n = first_n; n <= last_n; ++n) {
            for (int m = first_m; m <= last_m; ++m) {
                const LensletGrid::Uv uv = grid.uv(m, n);
                if (grid.in_frame(grid.at(uv)) && grid.steps_px(uv).area_px2() * middle > 0) return true;
            }
        }
        return false;
    };
    IndexRange all{0, grid.columns - 1, 0, grid.rows - 1};
    for (bool grown = true; grown && all.high_m - all.low_m < 2 * grid.columns;) {
        const IndexRange before = all;
        const auto [low_m, high_m, low_n, high_n] =
            IndexRange{all.low_m - 1, all.high_m + 1, all.low_n - 1, all.high_n + 1};
        if (reaches(low_m, low_m, low_n, high_n)) all.low_m = low_m;
        if (reaches(high_m, high_m, low_n, high_n)) all.high_m = high_m;
        if (reaches(low_m, high_m, low_n, low_n)) all.low_n = low_n;
        if (reaches(low_m, high_m, high_n, high_n)) all.high_n = high_n;
        grown = all != before;
    }
    const LensletGrid old = grid;
    count_from_zero(grid, observations, all);
    if (old.shifts_px.empty()) return;
    grid.shifts_px.assign(grid.index(0, grid.rows), {});
    for (int n = 0; n < old.rows; ++n) {
        for (int m = 0; m < old.columns; ++m)
            grid.shifts_px[grid.index(m - all.low_m, n - all.low_n)] = old.shifts_px[old.index(m, n)];
    }
}

// The share of the complete neighbours of measured lenslets that is measured, too. It is high for a lattice, even if
// only a part of the frame is lit, and low for structures of a picture that resemble lenslets.
double neighbours_found(const LensletGrid& grid, const CentreFinder& finder,
                        const std::vector<Observation>& observations) {
    std::vector<std::uint8_t> found(grid.index(0, grid.rows)), complete(found);
    for (const Observation& seen : observations) found[grid.index(seen.m, seen.n)] = 1;
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m)
            complete[grid.index(m, n)] = finder.complete(grid.centre_px(m, n)) ? 1 : 0;
    }
    std::int64_t neighbours = 0, measured = 0;
    for (const Observation& seen : observations) {
        for (const auto& [dm, dn] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
            const int m = seen.m + dm;
            const int n = seen.n + dn;
            if (!grid.contains(m, n) || complete[grid.index(m, n)] == 0) continue;
            ++neighbours;
            measured += found[grid.index(m, n)];
        }
    }
    return neighbours > 0 ? static_cast<double>(measured) / static_cast<double>(neighbours) : 0;
}

// The finder for lenslets of the size of (m, n).
const CentreFinder& finder_for(const LocalFinders& finders, const LensletGrid& grid, double pitch, int m, int n) {
    if (finders.count() == 1) return finders.middle();
    return finders.at(grid.steps_px(grid.uv(m, n)).mean_px() / pitch);
}

// Counts saturated lenslets, and measures a sample of the lenslets by halves, for the shifts of single ones.
void measure_more(const WhiteImage& image, const LocalFinders& finders, const LensletGrid& grid, double pitch,
                  GridCalibration& out) {
    const CentreFinder& finder = finders.middle();
    if (image.any_saturated()) {
        out.saturated = static_cast<int>(
            std::count_if(out.observations.begin(), out.observations.end(),
                          [&](const Observation& seen) { return finder.saturated_share(seen.centre_px) > 0; }));
    }
    const double window_px = std::numbers::pi * finder.window_radius_px() * finder.window_radius_px();
    const std::size_t split =
        std::clamp(static_cast<std::size_t>(kSplitPixels / window_px), kFewestSplit, kSplitCentres);
    const std::size_t every = std::max<std::size_t>(1, out.observations.size() / split);
    for (std::size_t k = 0; k < out.observations.size(); k += every)
        out.observations[k].split_px = finder_for(finders, grid, pitch, out.observations[k].m, out.observations[k].n)
                                           .split(out.observations[k].centre_px);
}

// CentreFinder::light_noise() of the lenslets that were measured by halves.
std::vector<double> light_noise(const LocalFinders& finders, double pitch, const GridCalibration& of) {
    std::vector<double> out;
    for (const Observation& seen : of.observations) {
        if (!seen.used || !seen.split_px) continue;
        const auto noise = finder_for(finders, of.fit.grid, pitch, seen.m, seen.n).light_noise(seen.centre_px);
        if (noise) out.push_back(*noise);
    }
    return out;
}

// Counts the lenslets inside the frame, and those of them that are complete, measured and missing.
void count_lenslets(const LocalFinders& finders, double pitch, GridCalibration& out) {
    const LensletGrid& grid = out.fit.grid;
    std::vector<std::uint8_t> measured(grid.index(0, grid.rows)), missing(measured);
    for (const Observation& seen : out.observations) {
        if (grid.contains(seen.m, seen.n)) measured[grid.index(seen.m, seen.n)] = 1;
    }
    for (const GridCalibration::Node& node : out.nodes()) {
        ++out.inside;
        if (!finder_for(finders, grid, pitch, node.m, node.n).complete(node.centre_px)) continue;
        ++out.complete;
        if (measured[grid.index(node.m, node.n)] != 0) continue;
        out.missing_px.push_back(node.centre_px);
        missing[grid.index(node.m, node.n)] = 1;
    }
    out.beside_missing =
        mark_beside_missing(grid, out.observations, [&](int m, int n) { return missing[grid.index(m, n)] != 0; });
    out.found = static_cast<int>(out.observations.size());
    out.missing = static_cast<int>(out.missing_px.size());
    out.displaced = out.fit.displaced;
    out.rejected = out.fit.rejected;
}

// Finds the blemished and the displaced lenslets among the outliers of the fit, and counts the fully lit lenslets.
void place_and_count(const LocalFinders& finders, double pitch, GridCalibration& out) {
    const CentreFinder& finder = finders.middle();
    const LensletGrid& grid = out.fit.grid;
    for (Observation& seen : out.observations) {
        if (!seen.used && !seen.split_px)
            seen.split_px = finder_for(finders, grid, pitch, seen.m, seen.n).split(seen.centre_px);
    }
    const std::vector<std::uint8_t> whole = lenslet_coverage(
        grid, out.observations,
        [&](int m, int n) { return finder_for(finders, grid, pitch, m, n).complete(grid.centre_px(m, n)); },
        [&](PixelPoint at) { return finder.amplitude_dn(at); }, finder.typical_amplitude_dn());
    const double shift_px = kMinByBlemish * pitch, least_unlike = shift_px * shift_px * finder.unlike_by_shift_px2();
    // At the edge of the light, lenslets differ in shape without dust on them.
    mark_blemished(
        out.observations,
        [&](const Observation& seen) -> std::optional<Unlike> {
            if (whole[grid.index(seen.m, seen.n)] == 0) return std::nullopt;
            return finder_for(finders, grid, pitch, seen.m, seen.n).unlike(seen.centre_px);
        },
        least_unlike, out.fit);
    out.blemished = static_cast<int>(std::ranges::count_if(out.observations, &Observation::blemished));
    place_displaced(out.observations, whole, out.fit);
    out.whole = static_cast<int>(std::count(whole.begin(), whole.end(), 1));
    for (const Observation& seen : out.observations) {
        if (!grid.contains(seen.m, seen.n) || whole[grid.index(seen.m, seen.n)] == 0) continue;
        ++out.whole_found;
        if (seen.used || seen.displaced) ++out.whole_placed;
    }
}

// Measures all lenslets, numbers them and fits the grid: the first fields of the result.
Result<GridCalibration> measure_grid(const WhiteImage& image, const Lattice& lattice, LocalFinders& finders,
                                     bool corners) {
    const LensletGrid steps = grid_of(lattice, image);
    const double pitch = lattice.pitch_px();
    auto chain = follow_chains(image, finders, steps, pitch);
    if (!chain) return tl::unexpected(chain.error());
    const CentreFinder& finder = finders.middle();
    GridCalibration out;
    out.lattice = lattice;
    out.immunity = finder.immunity();
    out.observations = std::move(chain->observations);
    out.apart = chain->apart;
    out.torn = chain->torn;
    LensletGrid grid = std::move(chain->smooth);
    measure_more(image, finders, grid, pitch, out);
    count_from_zero(grid, out.observations, chain->inside);
    const double together = neighbours_found(grid, finder, out.observations);
    if (together < kMinNeighbours) {
        return fail(ErrorCode::refused,
                    fmt::format("the lenslets do not look like one another: only {:.0f} % of the neighbours of those "
                                "measured can be measured",
                                100 * together),
                    "record an evenly lit white frame, without a part and below saturation");
    }
    auto fit = fit_grid(grid, out.observations);
    if (fit && corners) {
        remove_pixel_phase(fit->grid, out.observations);
        fit = fit_grid(grid, out.observations);
    }
    if (!fit) return tl::unexpected(fit.error());
    out.fit = std::move(*fit);
    return out;
}

// Measures again with a weight that is immune to gradients of the light, if the light falls off so that centres move.
void measure_against_fall_off(const WhiteImage& image, std::span<const PixelPoint> places, bool corners,
                              LocalFinders& finders, GridCalibration& out) {
    const FallOff light = fall_off(out.observations);
    const double by_fall_off_px = finders.middle().shift_by_gradient_px2() * light.rms_per_px;
    out.by_fall_off_px = finders.middle().shift_by_gradient_px2() * light.max_per_px;
    if (by_fall_off_px < kMinByFallOff) return;
    auto profile = CentreFinder::learn(image, places, out.lattice.pitch_px(), AgainstGradients::always);
    if (!profile || !profile->immunity().vignetting) return;
    LocalFinders immune(std::move(*profile));
    auto again = measure_grid(image, out.lattice, immune, corners);
    if (!again || again->observations.size() < out.observations.size() - out.observations.size() / 100) return;
    if (!replaces(out, *again, by_fall_off_px)) return;
    finders = std::move(immune);
    out = std::move(*again);
    out.by_fall_off_px = finders.middle().shift_by_gradient_px2() * light.max_per_px;
}

}  // namespace

Result<GridCalibration> calibrate_grid(const FrameView& white, const std::optional<FrameView>& dark,
                                       const GridOptions& options) {
    const auto report = [&](double done) {
        if (options.progress) options.progress(done);
    };
    report(0);
    auto image = WhiteImage::open(white, dark, options.flat);
    if (!image) return tl::unexpected(image.error());
    const RowShift rows = row_shift(*image);
    const auto lattice = find_lattice(*image, options.hint);
    if (!lattice) return tl::unexpected(lattice.error());
    report(0.2);
    const LensletGrid steps = grid_of(*lattice, *image);
    const double pitch = lattice->pitch_px();
    const std::vector<PixelPoint> places = near_seed(*lattice, steps);
    auto profile = CentreFinder::learn(*image, places, pitch);
    if (!profile) return tl::unexpected(profile.error());
    const double corners = corners_of(*profile, *lattice, places);
    std::optional<WhiteImage> smoothed;
    if (corners > kMaxCorners) {
        smoothed = image->smoothed(kSmooth);
        profile = CentreFinder::learn(*smoothed, places, pitch);
        if (!profile) return tl::unexpected(profile.error());
    }
    const WhiteImage& light = smoothed ? *smoothed : *image;
    LocalFinders finders(std::move(*profile));
    auto measured = measure_grid(light, *lattice, finders, corners > kMaxCorners);
    if (!measured) return tl::unexpected(measured.error());
    GridCalibration out = std::move(*measured);
    report(0.7);
    measure_against_fall_off(light, places, corners > kMaxCorners, finders, out);
    const CentreFinder& finder = finders.middle();
    const double pitches = std::max(out.fit.cv_x_rms_px, out.fit.cv_y_rms_px) / pitch;
    if (!(pitches < kMaxError)) {
        return fail(
            ErrorCode::refused,
            fmt::format("this is no white frame: its centres scatter about the best grid by {:.1f} % of a pitch, "
                        "{:.1f} % is the most",
                        100 * pitches, 100 * kMaxError),
            "record evenly lit lenslets in one exposure, without a part in the light, in focus; if they are, raise the "
            "light or the exposure time, and light the array evenly up to the corners or give a flat frame");
    }
    extend_to_frame(out.fit.grid, out.observations);
    place_and_count(finders, pitch, out);
    report(0.95);

    const LensletGrid::Steps middle = out.fit.grid.steps_px({0, 0});
    out.pitch_px = middle.mean_px();
    out.rotation_rad = lattice->stagger == algo::Stagger::columns
        ? std::atan2(-middle.along_v.x_px, middle.along_v.y_px)
        : std::atan2(middle.along_u.y_px, middle.along_u.x_px);
    count_lenslets(finders, pitch, out);
    out.shape = shape_of(*image, out);
    out.shape.corners = corners;
    out.light_roughness = light_roughness(out.fit.grid, out.observations, light_noise(finders, pitch, out));
    out.light_following = light_following(out.fit.grid, out.observations);
    out.smooth_residuals = smooth_residuals(out.fit.grid, out.observations);
    out.cut = cut_lenslets(light, out.fit.grid, out.observations, finder,
                           [&](const Observation& seen) -> const CentreFinder& {
                               return finder_for(finders, out.fit.grid, pitch, seen.m, seen.n);
                           });
    out.one_sided = one_sided(finder, out.observations);
    out.edge_blur = edge_blur(finder, *lattice, out.observations);
    if (const auto lobes = four_lobes(finder, out.observations)) {
        out.diagonal_blur =
            diagonal_blur(light, out.fit.grid, out.observations, *lobes, smoothed ? kSmooth * kSmooth : 0.0);
        if (lattice->kind == algo::LatticeKind::hexagonal) {
            if (const auto blur = hexagonal_exposures(*image, out.fit.grid, out.observations, *lobes))
                out.edge_blur = *blur;
        }
    }
    out.row_shift = rows;
    if (auto fine = check_white_frame(*image, out); !fine) return tl::unexpected(fine.error());
    out.warnings = warnings_about(out);
    report(1);
    return out;
}

}  // namespace hord::calib
