#include "calib/fit/lenslet_model.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include "calib/fit/cross_validation.h"
#include "calib/fit/grid_solver.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr double kNeededGain = 2.0;  // standard errors, as for every model
constexpr double kMinShift =
    1.0 / 32 / 3.4641016151377544;  // px: rms rounding error of positions in algo/frame/resample.h
constexpr int kMinBlocks = 9;
constexpr double kMinDisplaced = 0.002, kMaxDisplaced = 0.05;  // of a pitch: less is noise or too small to matter
constexpr double kMaxDisagreement = 0.5;  // of a displacement: distance of each half from it, along it
constexpr double kUnit = 0.001;           // px: resolution of shifts in the calibration file
constexpr int kNear = 2;                  // columns and rows
constexpr std::size_t kFewest = 5;        // neighbours to compare with
constexpr double kDeviations = 5;         // as for outliers of the fit
constexpr double kRayleigh = 1.1774;      // median of a distance, over the standard deviation along an axis

// Residuals of both halves of one point along one axis.
struct Halves {
    double a, b;
};
Halves halves_of(const Validation& validation, const std::vector<Point>& points, std::size_t point, int axis) {
    const double left = -validation.off(static_cast<Eigen::Index>(2 * point) + axis);
    const double split = axis == 0 ? points[point].split.x_px : points[point].split.y_px;
    return {left + split, left - split};
}

// Sums over one block.
struct Sums {
    double common = 0, power = 0;  // a b, and (a^2 + b^2) / 2
};

void make_room_for_shifts(algo::LensletGrid& grid) {
    grid.shifts_px.resize(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
}
double whole_units(double shift_px) { return std::round(shift_px / kUnit) * kUnit; }

// Adds the lenslets' shifts to the grid.
void add_shifts(std::span<const Observation> observations, GridFit& fit) {
    make_room_for_shifts(fit.grid);
    for (const Observation& seen : observations) {
        if (!seen.used || !fit.grid.contains(seen.m, seen.n)) continue;
        const algo::PixelPoint model_px = fit.grid.at(fit.grid.uv(seen.m, seen.n));
        fit.grid.shifts_px[fit.grid.index(seen.m, seen.n)] = {
            whole_units(fit.shifts.share * (seen.centre_px.x_px - model_px.x_px)),
            whole_units(fit.shifts.share * (seen.centre_px.y_px - model_px.y_px))};
    }
}

}  // namespace

void select_lenslet_shifts(std::span<const Observation> observations, GridFit& fit) {
    ModelReport& report = fit.candidates.emplace_back();
    report.model = fit.grid.model;
    report.single_lenslets = true;
    report.rms_px = std::sqrt(0.5 * (fit.rms_x_px * fit.rms_x_px + fit.rms_y_px * fit.rms_y_px));
    report.cv_x_rms_px = report.cv_y_rms_px = std::numeric_limits<double>::infinity();
    std::vector<Point> points;
    for (const Observation& seen : observations) {
        if (seen.used && seen.split_px) points.push_back({fit.grid.uv(seen.m, seen.n), seen.centre_px, *seen.split_px});
    }
    const Blocks blocks = sort_into_blocks(points);
    if (points.size() < 4 * fit.grid.parameters.size() || blocks.count() < kMinBlocks || blocks.first[1] == 1) {
        report.verdict = "not tried: too few lenslets";
        return;
    }
    const auto solved = solve(fit.grid, points);
    const Validation validation = solved ? leave_blocks_out(*solved, blocks) : Validation{};
    if (validation.squared.empty()) {
        report.verdict = "not taken: the fit did not settle";
        return;
    }
    const auto count = static_cast<std::size_t>(blocks.count());
    std::vector<Sums> sums(count);
    Sums all;
    double common[2] = {}, noise[2] = {};  // sums of S and N, an axis
    for (std::size_t b = 0; b < count; ++b) {
        for (std::size_t k = blocks.first[b]; k < blocks.first[b + 1]; ++k) {
            for (const int axis : {0, 1}) {
                const Halves h = halves_of(validation, points, k, axis);
                sums[b].common += h.a * h.b;
                sums[b].power += 0.5 * (h.a * h.a + h.b * h.b);
                common[axis] += h.a * h.b;
                noise[axis] += 0.25 * (h.a - h.b) * (h.a - h.b);
            }
        }
        all.common += sums[b].common;
        all.power += sums[b].power;
    }
    Validation without, with;
    without.squared.resize(count);
    with.squared.resize(count);
    for (std::size_t b = 0; b < count; ++b) {
        const double share = std::max(0.0, (all.common - sums[b].common) / std::max(all.power - sums[b].power, 1e-300));
        for (std::size_t k = blocks.first[b]; k < blocks.first[b + 1]; ++k) {
            for (const int axis : {0, 1}) {
                const Halves h = halves_of(validation, points, k, axis);
                without.squared[b] += h.a * h.a + h.b * h.b;
                with.squared[b] +=
                    (h.b - share * h.a) * (h.b - share * h.a) + (h.a - share * h.b) * (h.a - share * h.b);
            }
        }
    }
    report.gain_t = gain_of(without, with);
    const auto n = static_cast<double>(points.size());
    LensletShifts shifts;
    shifts.rms_px = std::sqrt(std::max(0.0, all.common / (2 * n)));
    shifts.share = std::max(0.0, all.common / std::max(all.common + noise[0] + noise[1], 1e-300));
    // Error of a centre in another frame: that of the model, less the known shift.
    const auto left = [&](double cv, double of_axis) {
        return std::sqrt(std::max(0.0, cv * cv - shifts.share * std::max(0.0, of_axis / n)));
    };
    shifts.left_x_px = report.cv_x_rms_px = left(fit.cv_x_rms_px, common[0]);
    shifts.left_y_px = report.cv_y_rms_px = left(fit.cv_y_rms_px, common[1]);
    report.parameters = static_cast<int>(fit.grid.parameters.size()) + 2 * fit.used;
    const std::string agree =
        fmt::format("both halves of a lenslet's light agree on shifts of {:.4f} px, {:.1f} standard errors",
                    shifts.rms_px, report.gain_t);
    if (!(report.gain_t > kNeededGain) || !(shifts.rms_px > kMinShift)) {
        report.verdict = fmt::format("not needed: {}, of {:.0f} and {:.4f} px needed", agree, kNeededGain, kMinShift);
        return;
    }
    report.verdict = "needed: " + agree;
    for (ModelReport& model : fit.candidates) model.chosen = false;
    report.chosen = true;
    fit.shifts = shifts;
    add_shifts(observations, fit);
    fit.reason += fmt::format("; and every lenslet's own shift: {}, {:.0f} % of a residual is taken for true", agree,
                              100 * shifts.share);
}

namespace {

// What of the measured lenslets lies around each one.
class Surroundings {
  public:
    Surroundings(std::span<const Observation> observations, const algo::LensletGrid& grid)
        : grid_(grid), off_model_(grid.index(0, grid.rows)), distance_(off_model_.size(), -1),
          light_(distance_.size()) {
        for (const Observation& seen : observations) {
            if (!grid.contains(seen.m, seen.n)) continue;
            const std::size_t k = grid.index(seen.m, seen.n);
            const algo::PixelPoint at = grid.at(grid.uv(seen.m, seen.n));
            if (seen.used) distance_[k] = std::hypot(seen.centre_px.x_px - at.x_px, seen.centre_px.y_px - at.y_px);
            else off_model_[k] = 1;
            light_[k] = seen.light_dn;
        }
    }

    // Where light falls off, centres are noisier than elsewhere: an outlier of the frame may be none of its neighbours.
    [[nodiscard]] bool stands_out(const Observation& seen, double off) const {
        std::vector<double> near, near_light;
        for_each(seen, kNear, [&](std::size_t k) {
            if (distance_[k] < 0) return;
            near.push_back(distance_[k]);
            near_light.push_back(light_[k]);
        });
        if (near.size() < kFewest) return false;
        // Noise and the light of neighbours move a centre by the more the less light it has of its own.
        const double dim = std::min(1.0, seen.light_dn / common::upper_median(std::span(near_light)));
        return dim * off > kDeviations / kRayleigh * common::upper_median(std::span(near));
    }
    // None of its eight neighbours is off the model.
    [[nodiscard]] bool alone(const Observation& seen) const {
        int off = 0;
        for_each(seen, 1, [&](std::size_t k) { off += off_model_[k]; });
        return off == 1;
    }

  private:
    template <class Visit>
    void for_each(const Observation& seen, int reach, Visit visit) const {
        for (int n = std::max(0, seen.n - reach); n <= std::min(grid_.rows - 1, seen.n + reach); ++n) {
            for (int m = std::max(0, seen.m - reach); m <= std::min(grid_.columns - 1, seen.m + reach); ++m)
                visit(grid_.index(m, n));
        }
    }
    const algo::LensletGrid& grid_;
    std::vector<std::uint8_t> off_model_;
    std::vector<double> distance_;  // of used lenslets from the model; below 0: of the others
    std::vector<double> light_;
};

}  // namespace

void place_displaced(std::span<Observation> observations, std::span<const std::uint8_t> whole, GridFit& fit) {
    algo::LensletGrid& grid = fit.grid;
    const double pitch = grid.steps_px({0, 0}).mean_px();
    const Surroundings around(observations, grid);
    for (Observation& seen : observations) {
        if (seen.used || seen.blemished || !seen.split_px || !grid.contains(seen.m, seen.n) ||
            whole[grid.index(seen.m, seen.n)] == 0)
            continue;
        const algo::PixelPoint model_px = grid.at(grid.uv(seen.m, seen.n));
        const double off_x = seen.centre_px.x_px - model_px.x_px;
        const double off_y = seen.centre_px.y_px - model_px.y_px;
        const double off = std::hypot(off_x, off_y);
        const double along = std::abs(seen.split_px->x_px * off_x + seen.split_px->y_px * off_y) / off;
        if (!(off >= kMinDisplaced * pitch) || !(along <= kMaxDisagreement * off) || !around.stands_out(seen, off))
            continue;
        if (off > kMaxDisplaced * pitch || !around.alone(seen)) {
            seen.unplaced = true;
            continue;
        }
        make_room_for_shifts(grid);
        grid.shifts_px[grid.index(seen.m, seen.n)] = {whole_units(off_x), whole_units(off_y)};
        seen.displaced = true;
        ++fit.displaced;
        --fit.rejected;
    }
}

}  // namespace hord::calib
