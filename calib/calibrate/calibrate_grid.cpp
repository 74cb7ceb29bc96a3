#include "calib/calibrate/calibrate_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "algo/frame/extents.h"
#include "calib/lattice/lenslet_coverage.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

constexpr double kMinMatch = 0.5;       // correlation with the profile of the frame's lenslets
constexpr double kMinAmplitude = 0.08;  // of the typical lenslet
constexpr double kMinNeighbours = 0.5;  // share of the neighbours of measured lenslets that are measured, too
// Cross-validated error an axis, over the pitch. Three standard deviations of a lenslet's position stay within half a
// bin of the finest decode, so that its centre bin is correct. Larger errors mean that the frame is no white frame:
// light with structure, such as through a part, moves centres by tenths of a pixel.
constexpr double kMaxError = 0.5 / algo::kMaxBins / 3;
// Of the frame's bright pixels. Light beside the grid is that of another pattern, such as through a part.
constexpr double kMinLightOnGrid = 0.85;
constexpr double kGrowCentres = 900;
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

struct Index {
    int m = 0, n = 0;
    PixelPoint at;  // position by a grid
};

// Every `every`-th row and column of the lenslets that `grid` places inside the frame. `steps` bounds the search: a
// polynomial may fold lenslets far outside, by the lattice's own steps, back into the frame.
std::vector<Index> lenslets_inside(const LensletGrid& grid, const LensletGrid& steps, const WhiteImage& image,
                                   double reach_px = 1e9, int every = 1) {
    const std::vector<double>& p = steps.parameters;  // affine
    const double determinant = p[2] * p[5] - p[3] * p[4];
    double low_u = 1e300, high_u = -1e300, low_v = 1e300, high_v = -1e300;
    const double margin_x = 0.1 * image.width_px() + p[2] / steps.span;
    const double margin_y = 0.1 * image.height_px() + p[5] / steps.span;
    for (const double x : {-margin_x, image.width_px() + margin_x}) {
        for (const double y : {-margin_y, image.height_px() + margin_y}) {
            const double u = (p[5] * (x - p[0]) - p[3] * (y - p[1])) / determinant;
            const double v = (p[2] * (y - p[1]) - p[4] * (x - p[0])) / determinant;
            low_u = std::min(low_u, u);
            high_u = std::max(high_u, u);
            low_v = std::min(low_v, v);
            high_v = std::max(high_v, v);
        }
    }
    // Distances from the seed, lenslet (0, 0), by `steps` and by the model differ by a third at most.
    const double reach = 1.4 * reach_px / std::hypot(p[2], p[4]);
    low_u = std::max(low_u, -reach);
    high_u = std::min(high_u, reach);
    low_v = std::max(low_v, -reach);
    high_v = std::min(high_v, reach);
    const double m_step = (steps.stagger == algo::Stagger::columns ? std::numbers::sqrt3 / 2 : 1) / steps.span;
    const double n_step = (steps.stagger == algo::Stagger::rows ? std::numbers::sqrt3 / 2 : 1) / steps.span;
    std::vector<Index> out;
    const auto first = [every](double low, double step) {
        return (static_cast<int>(std::floor(low / step)) - 1) / every * every;
    };
    for (int n = first(low_v, n_step); n <= static_cast<int>(std::ceil(high_v / n_step)) + 1; n += every) {
        for (int m = first(low_u, m_step); m <= static_cast<int>(std::ceil(high_u / m_step)) + 1; m += every) {
            const LensletGrid::Uv uv = grid.uv(m, n);
            if (uv.u < low_u || uv.u > high_u || uv.v < low_v || uv.v > high_v) continue;
            const PixelPoint at = grid.at(uv);
            if (grid.in_frame(at)) out.push_back({m, n, at});
        }
    }
    return out;
}

struct Growth {
    LensletGrid grid;
    CentreFinder finder;
};

std::optional<Observation> observe(const CentreFinder& finder, const Index& k, double most_px) {
    const auto spot = finder.measure(k.at, most_px);
    if (!spot || spot->match < kMinMatch || spot->amplitude_dn < kMinAmplitude * finder.typical_amplitude_dn())
        return std::nullopt;
    return Observation{k.m, k.n, spot->centre_px, true};
}

// Grows the grid from the seed: measures centres within reach, fits a smooth surface, extends the reach, until the
// frame is covered.
Result<Growth> grow(const WhiteImage& image, const Lattice& lattice) {
    const LensletGrid steps = grid_of(lattice, image);
    const double pitch = lattice.pitch_px();
    const std::vector<Index> all = lenslets_inside(steps, steps, image, lattice.reach_px);
    std::vector<PixelPoint> seeds;
    std::vector<std::pair<double, Index>> by_distance;
    for (const Index& k : all)
        by_distance.emplace_back(std::hypot(k.at.x_px - lattice.seed_px.x_px, k.at.y_px - lattice.seed_px.y_px), k);
    std::sort(by_distance.begin(), by_distance.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (const auto& [far, k] : by_distance) {
        if (far > 0.7 * lattice.reach_px || seeds.size() == 400) break;
        seeds.push_back(k.at);
    }
    auto finder = CentreFinder::learn(image, seeds, pitch);
    if (!finder) return tl::unexpected(finder.error());

    LensletGrid grid = steps;
    const double farthest = std::hypot(image.width_px(), image.height_px());
    for (double reach = std::max(0.7 * lattice.reach_px, 3 * pitch);; reach *= 1.6) {
        // A regular sample of the lenslets within reach.
        const double area =
            std::min(std::numbers::pi * reach * reach, static_cast<double>(image.width_px()) * image.height_px());
        const int every = std::max(1, static_cast<int>(std::sqrt(area / (pitch * pitch * kGrowCentres))));
        std::vector<Observation> seen;
        for (const Index& k : lenslets_inside(grid, steps, image, reach, every)) {
            if (std::hypot(k.at.x_px - lattice.seed_px.x_px, k.at.y_px - lattice.seed_px.y_px) > reach) continue;
            if (auto observation = observe(*finder, k, 0.3 * pitch)) seen.push_back(*observation);
        }
        const int order = seen.size() >= 200 ? 3 : seen.size() >= 60 ? 2 : 1;
        std::optional<LensletGrid> next = robust_polynomial(steps, seen, order);
        if (!next) {
            return fail(ErrorCode::refused, fmt::format("only {} lenslets can be measured", seen.size()),
                        "show at least three rows and three columns of evenly lit lenslets");
        }
        grid = *next;
        if (reach > farthest) break;
    }
    return Growth{std::move(grid), std::move(*finder)};
}

// Renumbers lenslets: (0, 0) is the first column and row with one inside the frame.
void count_from_zero(LensletGrid& grid, std::vector<Observation>& observations, const std::vector<Index>& all) {
    int low_m = all.front().m, high_m = low_m, low_n = all.front().n, high_n = low_n;
    for (const Index& k : all) {
        low_m = std::min(low_m, k.m);
        high_m = std::max(high_m, k.m);
        low_n = std::min(low_n, k.n);
        high_n = std::max(high_n, k.n);
    }
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

// The share of the complete neighbours of measured lenslets that is measured, too. It is high for a lattice, even if
// only a part of the frame is lit, and low for structures of a picture that resemble lenslets.
double neighbours_found(const LensletGrid& grid, const CentreFinder& finder,
                        const std::vector<Observation>& observations) {
    std::vector<bool> found(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
    for (const Observation& seen : observations) found[grid.index(seen.m, seen.n)] = true;
    std::int64_t neighbours = 0, measured = 0;
    for (const Observation& seen : observations) {
        for (const auto& [dm, dn] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
            const int m = seen.m + dm;
            const int n = seen.n + dn;
            if (!grid.contains(m, n) || !finder.complete(grid.centre_px(m, n))) continue;
            ++neighbours;
            if (found[grid.index(m, n)]) ++measured;
        }
    }
    return neighbours > 0 ? static_cast<double>(measured) / static_cast<double>(neighbours) : 0;
}

// Share of the frame's bright pixels, those with half the light of the measured lenslets or more, that lie in the cells
// of these lenslets. Low where the light of a region does not fit the grid of the others: a part bends it, and scales
// its pattern. A region without light has no bright pixels. Lenslets that the frame's border cuts are not measured:
// what lies within 1.5 pitches of it does not count. 1 for a frame without any other bright pixel.
double light_on_grid(const WhiteImage& image, const std::vector<Observation>& observations, double pitch) {
    const int width = image.width_px(), height = image.height_px();
    std::vector<std::uint8_t> covered(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    const double reach = pitch / std::numbers::sqrt2;  // the corners of a cell
    for (const Observation& seen : observations) {
        const PixelPoint at = seen.centre_px;
        const auto from = [&](double centre) { return std::max(0, static_cast<int>(std::ceil(centre - reach))); };
        for (int y = from(at.y_px); y < height && y <= at.y_px + reach; ++y) {
            for (int x = from(at.x_px); x < width && x <= at.x_px + reach; ++x) {
                if (std::hypot(x - at.x_px, y - at.y_px) <= reach)
                    covered[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                            static_cast<std::size_t>(x)] = 1;
            }
        }
    }
    const auto light_at = [&](std::size_t k) {
        return image.at(static_cast<int>(k % static_cast<std::size_t>(width)),
                        static_cast<int>(k / static_cast<std::size_t>(width)));
    };
    std::vector<float> cells;
    for (std::size_t k = 0; k < covered.size(); k += 3) {
        if (covered[k] != 0) cells.push_back(light_at(k));
    }
    if (cells.empty()) return 0;
    const auto quantile = [&](std::size_t percent) {
        const auto at = cells.begin() + static_cast<std::ptrdiff_t>(cells.size() * percent / 100);
        std::nth_element(cells.begin(), at, cells.end());
        return *at;
    };
    const float bright = (quantile(5) + quantile(95)) / 2;
    std::size_t all = 0, on_grid = 0;
    const int border = static_cast<int>(std::ceil(1.5 * pitch));
    for (int y = border; y < height - border; ++y) {
        for (int x = border; x < width - border; ++x) {
            if (image.at(x, y) < bright) continue;
            ++all;
            on_grid +=
                covered[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
        }
    }
    return all > 0 ? static_cast<double>(on_grid) / static_cast<double>(all) : 1;
}

// Measures all lenslets of `all`; a sample of them also by halves, for the shifts of single lenslets.
void measure_all(const WhiteImage& image, const CentreFinder& finder, const std::vector<Index>& all, double pitch,
                 GridCalibration& out) {
    for (const Index& k : all) {
        if (!finder.complete(k.at)) continue;
        if (auto seen = observe(finder, k, 0.25 * pitch)) {
            out.observations.push_back(*seen);
            if (image.any_saturated() && finder.saturated_share(seen->centre_px) > 0) ++out.saturated;
        }
    }
    const double window_px = std::numbers::pi * finder.window_radius_px() * finder.window_radius_px();
    const std::size_t split =
        std::clamp(static_cast<std::size_t>(kSplitPixels / window_px), kFewestSplit, kSplitCentres);
    const std::size_t every = std::max<std::size_t>(1, out.observations.size() / split);
    for (std::size_t k = 0; k < out.observations.size(); k += every)
        out.observations[k].split_px = finder.split(out.observations[k].centre_px);
}

// Finds the displaced lenslets among the outliers of the fit, and counts the fully lit lenslets.
void place_and_count(const CentreFinder& finder, GridCalibration& out) {
    for (Observation& seen : out.observations) {
        if (!seen.used && !seen.split_px) seen.split_px = finder.split(seen.centre_px);
    }
    const LensletGrid& grid = out.fit.grid;
    const std::vector<std::uint8_t> whole = lenslet_coverage(
        grid, out.observations, [&](PixelPoint at) { return finder.complete(at); },
        [&](PixelPoint at) { return finder.amplitude_dn(at); }, finder.typical_amplitude_dn());
    place_displaced(out.observations, whole, out.fit);
    out.whole = static_cast<int>(std::count(whole.begin(), whole.end(), 1));
    for (const Observation& seen : out.observations) {
        if (!grid.contains(seen.m, seen.n) || whole[grid.index(seen.m, seen.n)] == 0) continue;
        ++out.whole_found;
        if (seen.used || seen.displaced) ++out.whole_placed;
    }
}

}  // namespace

Result<GridCalibration> calibrate_grid(const FrameView& white, const std::optional<FrameView>& dark,
                                       const GridOptions& options) {
    const auto report = [&](double done) {
        if (options.progress) options.progress(done);
    };
    report(0);
    const auto image = WhiteImage::open(white, dark, options.flat);
    if (!image) return tl::unexpected(image.error());
    const auto lattice = find_lattice(*image, options.hint);
    if (!lattice) return tl::unexpected(lattice.error());
    report(0.2);
    auto grown = grow(*image, *lattice);
    if (!grown) return tl::unexpected(grown.error());
    report(0.4);

    GridCalibration out;
    out.lattice = *lattice;
    out.immunity = grown->finder.immunity();
    LensletGrid grid = grown->grid;
    const LensletGrid steps = grid_of(*lattice, *image);
    const std::vector<Index> all = lenslets_inside(grid, steps, *image);
    const double pitch = lattice->pitch_px();
    measure_all(*image, grown->finder, all, pitch, out);
    report(0.7);
    count_from_zero(grid, out.observations, all);
    const double together = neighbours_found(grid, grown->finder, out.observations);
    if (together < kMinNeighbours) {
        return fail(ErrorCode::refused,
                    fmt::format("the lenslets do not look like one another: only {:.0f} % of the neighbours of those "
                                "measured can be measured",
                                100 * together),
                    "record an evenly lit white frame, without a part and below saturation");
    }
    auto fit = fit_grid(grid, out.observations);
    if (!fit) return tl::unexpected(fit.error());
    out.fit = std::move(*fit);
    const double pitches = std::max(out.fit.cv_x_rms_px, out.fit.cv_y_rms_px) / pitch;
    if (!(pitches < kMaxError)) {
        return fail(ErrorCode::refused,
                    fmt::format("this is no white frame: its centres scatter about the best grid by {:.1f} % of a "
                                "pitch, {:.1f} % is the most",
                                100 * pitches, 100 * kMaxError),
                    "record evenly lit lenslets, without a part in the light, in focus");
    }
    if (const double on_grid = light_on_grid(*image, out.observations, pitch); on_grid < kMinLightOnGrid) {
        return fail(
            ErrorCode::refused,
            fmt::format("this is no white frame: only {:.0f} % of its light fits the grid, {:.0f} % is the least",
                        100 * on_grid, 100 * kMinLightOnGrid),
            "record evenly lit lenslets, without a part in the light, in focus");
    }
    place_and_count(grown->finder, out);
    report(0.95);

    const LensletGrid::Steps middle = out.fit.grid.steps_px({0, 0});
    out.pitch_px = middle.mean_px();
    out.rotation_rad = lattice->stagger == algo::Stagger::columns
        ? std::atan2(-middle.along_v.x_px, middle.along_v.y_px)
        : std::atan2(middle.along_u.y_px, middle.along_u.x_px);
    for (const GridCalibration::Node& node : out.nodes()) {
        ++out.inside;
        if (grown->finder.complete(node.centre_px)) ++out.complete;
    }
    out.found = static_cast<int>(out.observations.size());
    out.missing = std::max(0, out.complete - out.found);
    out.displaced = out.fit.displaced;
    out.rejected = out.fit.rejected;
    report(1);
    return out;
}

}  // namespace hord::calib
