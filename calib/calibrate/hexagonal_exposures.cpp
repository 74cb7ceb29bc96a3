#include "calib/calibrate/hexagonal_exposures.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <vector>

#include <Eigen/Dense>

#include "calib/calibrate/cell_light.h"
#include "calib/lattice/round_lenslet.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

constexpr std::size_t kLenslets = 300, kMinLenslets = 8;
constexpr double kMaxMisfit = 0.01;  // RMS, of the light's contrast, as for round lenslets (calib/lattice)
// Misfit of the best lenslets of one exposure, over that of the best of two: noise and structure leave as much of both.
constexpr double kMinBetter = 2;
constexpr double kMinEdgePx2 = 0.36;  // sharper edges count as these, as for round lenslets
constexpr double kMinEdgePx = 0.2;
constexpr double kInterpolationPx2 = 1.0 / 6;  // variance of the triangle that light_about() blurs with
constexpr int kMaxRounds = 20, kFirstRounds = 3, kWays = 6;
constexpr int kEvery = 2;                               // of the places along each step, while starts are compared
constexpr double kMaxSigmas = 5;                        // of an edge: beyond them it has no light (3e-7 of it)
constexpr double kFirstApart = 0.2, kFirstEdge = 0.08;  // of a pitch, of the first guess

// A lenslet's light: half of it lies `apart / 2` to either side of the centre.
enum class Kind { disc, square };
struct Shape {
    Kind kind = Kind::disc;
    bool twice = false;
    // Half sides (a disc's radius is the first), edge, turn of the sides; the way between the exposures.
    std::array<double, 6> of{};
    enum Part : std::uint8_t { half, other_half, edge, turn, apart_x, apart_y };
    [[nodiscard]] double at(Part part) const { return of[part]; }

    // Which parts are fitted.
    [[nodiscard]] std::vector<Part> free() const {
        std::vector<Part> out{half, edge};
        if (kind == Kind::square) out.insert(out.end(), {other_half, turn});
        if (twice) out.insert(out.end(), {apart_x, apart_y});
        return out;
    }
    [[nodiscard]] double light(double x, double y) const {
        const double soft = std::numbers::sqrt2 * at(edge);
        if (kind == Kind::disc) return 0.5 * std::erfc((std::hypot(x, y) - at(half)) / soft);
        const double cosine = std::cos(at(turn)), sine = std::sin(at(turn));
        const auto strip = [&](double place, double side) {
            if (std::abs(place) > side + kMaxSigmas * at(edge)) return 0.0;
            return 0.5 * (std::erf((place + side) / soft) - std::erf((place - side) / soft));
        };
        const double along = strip(cosine * x + sine * y, at(half));
        return along > 0 ? along * strip(cosine * y - sine * x, at(other_half)) : 0;
    }
    // Farther than this from the centre there is none.
    [[nodiscard]] double reach() const {
        const double side = kind == Kind::disc ? at(half) : std::hypot(at(half), at(other_half));
        return side + kMaxSigmas * at(edge) + (twice ? std::hypot(at(apart_x), at(apart_y)) / 2 : 0);
    }
    [[nodiscard]] double exposed(double x, double y) const {
        if (!twice) return light(x, y);
        const double dx = at(apart_x) / 2, dy = at(apart_y) / 2;
        return 0.5 * (light(x - dx, y - dy) + light(x + dx, y + dy));
    }
};

// Places about a lenslet's centre, of one half of the window: the other half is alike, turned; and the mean light
// there.
struct Seen {
    std::vector<PixelPoint> places;
    Eigen::VectorXd light;
    Neighbours neighbours;
    double pitch_px = 0;
};
// The mean light of some lenslets; none of fewer than 8.
std::optional<CellLight> mean_light(const WhiteImage& image, const LensletGrid& grid,
                                    std::span<const Observation> observations) {
    CellLight sum = CellLight::Zero();
    std::size_t count = 0;
    const std::size_t every = std::max<std::size_t>(1, observations.size() / kLenslets);
    for (std::size_t k = 0; k < observations.size(); k += every) {
        const Observation& seen = observations[k];
        if (!seen.used) continue;
        const auto light = light_about(image, seen.centre_px, grid.steps_px(grid.uv(seen.m, seen.n)));
        if (!light) continue;
        sum += *light;
        ++count;
    }
    if (count < kMinLenslets) return std::nullopt;
    return sum / static_cast<double>(count);
}
// Every how many places along each step are taken.
Seen seen_of(const CellLight& mean, const LensletGrid::Steps& steps, algo::Stagger stagger, int every) {
    Seen out;
    out.neighbours = neighbours_of(steps, stagger);
    out.pitch_px = steps.mean_px();
    const CellLight even = (mean + mean.reverse()) / 2;
    out.light.resize(mean.size() / 2 / (every * every));
    for (Eigen::Index row = 0; row < kCells / 2; row += every) {
        for (Eigen::Index column = 0; column < kCells; column += every) {
            const double u = place_of(column), v = place_of(row);
            out.light(static_cast<Eigen::Index>(out.places.size())) = even(row, column);
            out.places.push_back(
                {u * steps.along_u.x_px + v * steps.along_v.x_px, u * steps.along_u.y_px + v * steps.along_v.y_px});
        }
    }
    return out;
}

// What is left of the light after the best height and level; RMS over the light's contrast in `misfit`, infinite if the
// shape's light would be dark.
struct Left {
    Eigen::VectorXd of;
    double misfit = std::numeric_limits<double>::infinity();
};
Left left_by(const Shape& shape, const Seen& seen) {
    const auto rows = seen.light.size();
    const double reach = shape.reach();
    Eigen::MatrixXd model(rows, 2);
    for (Eigen::Index k = 0; k < rows; ++k) {
        const PixelPoint at = seen.places[static_cast<std::size_t>(k)];
        double sum = shape.exposed(at.x_px, at.y_px);
        for (int j = 0; j < seen.neighbours.count; ++j) {
            const PixelPoint& to = seen.neighbours.to[static_cast<std::size_t>(j)];
            const double x = at.x_px - to.x_px, y = at.y_px - to.y_px;
            if (x * x + y * y < reach * reach) sum += shape.exposed(x, y);
        }
        model.row(k) << sum, 1;
    }
    const Eigen::Vector2d best = model.colPivHouseholderQr().solve(seen.light);
    Left out{.of = seen.light - model * best};
    const double contrast = seen.light.maxCoeff() - seen.light.minCoeff();
    if (best(0) > 0 && contrast > 0)
        out.misfit = std::sqrt(out.of.squaredNorm() / static_cast<double>(rows)) / contrast;
    return out;
}

struct Fitted {
    Shape shape;
    double misfit = std::numeric_limits<double>::infinity();
};

// Levenberg-Marquardt, by differences. Sharp edges far from their places have no slope, so that the first guess is
// soft.
Fitted fitted(Shape shape, const Seen& seen, int rounds) {
    constexpr double kStep = 0.01;  // px, and rad
    constexpr double kFirstDamping = 0.01, kMaxDamping = 100, kFactor = 10;
    const std::vector<Shape::Part> free = shape.free();
    const auto parts = static_cast<Eigen::Index>(free.size());
    Left left = left_by(shape, seen);
    double damping = kFirstDamping;
    for (int round = 0; round < rounds && damping <= kMaxDamping; ++round) {
        Eigen::MatrixXd slopes(left.of.size(), parts);
        for (Eigen::Index k = 0; k < parts; ++k) {
            Shape next = shape;
            next.of[free[static_cast<std::size_t>(k)]] += kStep;
            slopes.col(k) = (left_by(next, seen).of - left.of) / kStep;
        }
        const Eigen::MatrixXd normal = slopes.transpose() * slopes;
        const double before = left.misfit;
        for (; damping <= kMaxDamping && left.misfit == before; damping *= kFactor) {
            Eigen::MatrixXd damped = normal;
            damped.diagonal() *= 1 + damping;
            const Eigen::VectorXd change = -damped.ldlt().solve(slopes.transpose() * left.of);
            Shape next = shape;
            for (Eigen::Index k = 0; k < parts; ++k) next.of[free[static_cast<std::size_t>(k)]] += change(k);
            next.of[Shape::edge] = std::max(kMinEdgePx, next.of[Shape::edge]);
            Left then = left_by(next, seen);
            if (then.misfit < left.misfit) shape = next, left = std::move(then);
        }
        damping /= kFactor * kFactor;
        if (left.misfit > 0.999 * before) break;
    }
    return {shape, left.misfit};
}

// The best of both kinds of lenslets. Of the starts of each kind, the best after some rounds is followed to its end, on
// few places; only the best of both is fitted to all.
Fitted best_of(bool twice, double turn, const Seen& few, const Seen& all) {
    Fitted best;
    for (const Kind kind : {Kind::disc, Kind::square}) {
        const double half = (kind == Kind::disc ? 0.42 : 0.37) * all.pitch_px;
        Fitted ahead;
        for (int way = 0; way < (twice ? kWays : 1); ++way) {
            const double angle = std::numbers::pi * way / kWays, apart = twice ? kFirstApart * all.pitch_px : 0;
            const Fitted of = fitted(
                {.kind = kind,
                 .twice = twice,
                 .of = {half, half, kFirstEdge * all.pitch_px, turn, apart * std::cos(angle), apart * std::sin(angle)}},
                few, kFirstRounds);
            if (of.misfit < ahead.misfit) ahead = of;
        }
        ahead = fitted(ahead.shape, few, kMaxRounds);
        if (ahead.misfit < best.misfit) best = ahead;
    }
    return fitted(best.shape, all, kMaxRounds);
}

}  // namespace

std::optional<EdgeBlur> hexagonal_exposures(const WhiteImage& image, const LensletGrid& grid,
                                            std::span<const Observation> observations, std::complex<double> lobes) {
    const auto mean = mean_light(image, grid, observations);
    if (!mean) return std::nullopt;
    const LensletGrid::Steps steps = grid.steps_px({0, 0});
    const Seen few = seen_of(*mean, steps, grid.stagger, kEvery), all = seen_of(*mean, steps, grid.stagger, 1);
    const double turn = (std::arg(lobes) + std::numbers::pi) / 4;  // corners lie half a right angle from the sides
    const Fitted once = best_of(false, turn, few, all), twice = best_of(true, turn, few, all);
    if (!(std::min(once.misfit, twice.misfit) <= kMaxMisfit)) return std::nullopt;
    const double edge_px2 = std::pow(twice.shape.at(Shape::edge), 2) - kInterpolationPx2;
    EdgeBlur out{.own_px2 = std::max(kMinEdgePx2, edge_px2)};
    if (once.misfit > kMinBetter * twice.misfit) {
        out.more_px2 = (std::pow(twice.shape.at(Shape::apart_x), 2) + std::pow(twice.shape.at(Shape::apart_y), 2)) / 4;
    }
    return out;
}

}  // namespace hord::calib
