#include "calib/calibrate/calibrate_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "algo/frame/extents.h"
#include "calib/calibrate/cut_lenslets.h"
#include "calib/calibrate/diagonal_blur.h"
#include "calib/calibrate/fall_off.h"
#include "calib/calibrate/hexagonal_exposures.h"
#include "calib/calibrate/lenslet_chain.h"
#include "calib/calibrate/lenslet_counts.h"
#include "calib/calibrate/lenslet_shape.h"
#include "calib/calibrate/local_finders.h"
#include "calib/calibrate/neighbour_statistics.h"
#include "calib/calibrate/odd_light.h"
#include "calib/calibrate/pattern_shape.h"
#include "calib/calibrate/straight_edges.h"
#include "calib/calibrate/white_frame_checks.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

constexpr double kMinNeighbours = 0.5;  // share of the neighbours of measured lenslets that are measured, too
// Cross-validated error an axis, over the pitch. Three standard deviations of a lenslet's position stay within half a
// bin of the finest decode, so that its centre bin is correct. Larger errors mean that the frame is no white frame:
// light with structure, such as through a part, moves centres by tenths of a pixel.
constexpr double kMaxError = 0.5 / algo::kMaxBins / 3;
// Fall-off that moves centres by less is left. RMS, px: what rounding adds to the positions that lenslets are decoded
// at (1/32 px, algo/frame/resample.h).
constexpr double kMinByFallOff = 1.0 / 32 / (2 * std::numbers::sqrt3);

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

// Counts the lenslets and measures what their light looks like: what the frame is judged by. `light`: the image, or
// that smoothed.
void look_at_lenslets(const WhiteImage& image, const WhiteImage& light, const LocalFinders& finders, double corners,
                      GridCalibration& out) {
    const CentreFinder& finder = finders.middle();
    const double pitch = out.lattice.pitch_px();
    count_lenslets(finders, pitch, out);
    out.shape = shape_of(image, out);
    out.shape.corners = corners;
    out.light_roughness = light_roughness(out.fit.grid, out.observations, light_noise(finders, pitch, out));
    out.light_following = light_following(out.fit.grid, out.observations);
    out.smooth_residuals = smooth_residuals(out.fit.grid, out.observations);
    out.cut = cut_lenslets(light, out.fit.grid, out.observations, finder,
                           [&](const Observation& seen) -> const CentreFinder& {
                               return finder_for(finders, out.fit.grid, pitch, seen.m, seen.n);
                           });
    out.one_sided = one_sided(finder, out);
    out.edge_blur = edge_blur(finder, out.lattice, out.observations);
    if (const auto lobes = four_lobes(finder, out.observations)) {
        out.diagonal_blur =
            diagonal_blur(light, out.fit.grid, out.observations, *lobes, light.smoothed_px() * light.smoothed_px());
        if (out.lattice.kind == algo::LatticeKind::hexagonal) {
            if (const auto blur = hexagonal_exposures(image, out.fit.grid, out.observations, *lobes))
                out.edge_blur = *blur;
        }
    }
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
            "light or the exposure time, and light the array evenly up to the corners or give a flat frame; if sharp, "
            "bright frames scatter alike, the array's own lenslets are misplaced by too much: use another array");
    }
    extend_to_frame(out.fit.grid, out.observations);
    place_and_count(finders, pitch, out);
    report(0.95);

    const LensletGrid::Steps middle = out.fit.grid.steps_px({0, 0});
    out.pitch_px = middle.mean_px();
    out.rotation_rad = lattice->stagger == algo::Stagger::columns
        ? std::atan2(-middle.along_v.x_px, middle.along_v.y_px)
        : std::atan2(middle.along_u.y_px, middle.along_u.x_px);
    out.odd_light = odd_light(light, finder, out.observations);
    if (out.odd_light.known()) move_to_lenslets(out);
    look_at_lenslets(*image, light, finders, corners, out);
    out.row_shift = rows;
    if (auto fine = check_white_frame(*image, out); !fine) return tl::unexpected(fine.error());
    out.warnings = warnings_about(out);
    report(1);
    return out;
}

}  // namespace hord::calib
