// White frames with known truth, drawn from the formulas of the optics. The code is independent of the fitter.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "calib/calibrate/calibrate_grid.h"
#include "common/frame.h"

namespace hord::calib::test {

// Text for a test's RecordProperty; docs/results/calibration.md shows it.
inline std::string text(double value) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.4f", value);
    return digits;
}

// A small generator with the same numbers on every machine.
class Random {
  public:
    explicit Random(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15U + 1) {}
    double uniform() {
        state_ ^= state_ << 13U;
        state_ ^= state_ >> 7U;
        state_ ^= state_ << 17U;
        return static_cast<double>(state_ >> 11U) * 0x1p-53;
    }
    // Sum of twelve: mean 0, variance 1, tails cut at 6.
    double normal() {
        double sum = -6;
        for (int k = 0; k < 12; ++k) sum += uniform();
        return sum;
    }

  private:
    std::uint64_t state_;
};

struct White {
    int width_px = 400, height_px = 400;
    bool hexagonal = false;
    double pitch_px = 20, rotation_deg = 0, shear = 0;
    double perspective_x = 0, perspective_y = 0, k1 = 0;  // at half the longer side from the middle
    // Barrel distortion (below 0) that never folds: r = 2 r0 / (1 + sqrt(1 - 4 division r0^2)), unit as of k1.
    double division = 0;
    bool to_scale = false;  // the distortion also scales the lenslets' discs, as a relay lens does
    double offset_x_px = 0.3, offset_y_px = -0.4;  // of a lenslet from the middle
    double disc_radius_px = 0;                     // 0: 0.42 pitch; negative: a Gaussian spot of that sigma
    double edge_px = 0.8;                          // blur of the disc's edge, sigma
    bool square = false;      // lenslets are squares along the lattice, edge_px wide at their edges
    int subpixels = 1;        // samples a side averaged per pixel; sharp edges need more than one
    double misplaced_px = 0;  // independent shift of each lenslet along x and y, sigma
    // Relative change of light from the middle of a lenslet to its rim, at the frame's corner; brighter outwards.
    double vignetting = 0;
    // The same along x and y at a place in the frame, beside `vignetting`; empty: none.
    std::function<std::pair<double, double>(double x, double y)> gradient = nullptr;
    double peak_dn = 20000, background_dn = 200;
    double electrons_per_dn = 1, read_e = 3;
    bool noise = true;
    double dead_share = 0;
    std::uint64_t seed = 1;
    int bits = 16;
    // Shift of a lenslet's light from its centre at a place in the frame, px; empty: no shift.
    std::function<std::pair<double, double>(double x, double y)> deflect = nullptr;
    // Cat's-eye vignetting: a disc of the lenslets' radius lies over each, shifted by this at a place in the frame, px.
    // Of discs only; empty: none.
    std::function<std::pair<double, double>(double x, double y)> stop = nullptr;
    // Light at a place in the frame, 0..1; empty: 1 everywhere.
    std::function<double(double x, double y)> light = nullptr;
    // Light of the lenslet at a place in the frame, without that of its neighbours there; empty: 1.
    std::function<double(double x, double y)> own_light = nullptr;
};

struct TruePoint {
    double x = 0, y = 0;
    bool dead = false;
};
struct Drawn {
    Frame frame;
    std::vector<TruePoint> truth;  // every lenslet whose centre lies inside the frame
};

// Long because its three steps (places, light, noise) share their local variables.
inline Drawn draw(const White& w) {
    Random random(w.seed);
    const double middle_x = 0.5 * (w.width_px - 1);
    const double middle_y = 0.5 * (w.height_px - 1);
    const double half = 0.5 * std::max(w.width_px, w.height_px);
    const double angle = w.rotation_deg * 3.14159265358979323846 / 180;
    const double radius = w.disc_radius_px == 0 ? 0.42 * w.pitch_px : w.disc_radius_px;
    const double reach =
        (w.to_scale ? 1.6 : 1) * (radius > 0 ? (w.square ? 1.5 : 1) * radius + 6 * w.edge_px : -6 * radius);
    std::vector<float> light(static_cast<std::size_t>(w.width_px) * static_cast<std::size_t>(w.height_px), 0.0F);
    Drawn out;
    // Squared distance of the farthest lenslet from the middle before distortion: strong barrel distortion draws
    // lenslets into the corners from farther away, at the most from where it folds.
    const bool barrel = w.k1 < -0.02 || w.division < -0.02;
    const double farthest = !barrel ? 2.5 : std::min(6.0, w.k1 < 0 ? 0.9 / (-3 * w.k1) : 6.0);
    const int most = static_cast<int>((barrel ? 1.3 * std::sqrt(farthest) : 1.6) * half / w.pitch_px) + 3;
    for (int n = -most; n <= most; ++n) {
        for (int m = -most; m <= most; ++m) {
            double u = w.pitch_px * m;
            double v = w.pitch_px * n;
            if (w.hexagonal) {
                u += (n % 2 != 0) ? 0.5 * w.pitch_px : 0.0;
                v *= std::sqrt(3.0) / 2;
            }
            u += w.shear * v;
            double x = std::cos(angle) * u - std::sin(angle) * v + w.offset_x_px;
            double y = std::sin(angle) * u + std::cos(angle) * v + w.offset_y_px;
            const double depth = 1 + (w.perspective_x * x + w.perspective_y * y) / half;
            x /= depth;
            y /= depth;
            const double r2 = (x * x + y * y) / (half * half);
            if (r2 > farthest) continue;
            double scale = 1 + w.k1 * r2, along = 1 + 3 * w.k1 * r2;  // tangential and radial magnification
            if (w.division != 0) {
                const double root = std::sqrt(1 - 4 * w.division * r2);
                scale = 2 / (1 + root);
                along = scale / root;
            }
            if (!w.to_scale) along = 1;
            const double across = w.to_scale ? scale : 1;
            const double out_x = r2 > 0 ? x / (half * std::sqrt(r2)) : 1,
                         out_y = r2 > 0 ? y / (half * std::sqrt(r2)) : 0;
            x = middle_x + x * scale;
            y = middle_y + y * scale;
            const bool dead = random.uniform() < w.dead_share;
            if (w.misplaced_px > 0) {
                x += w.misplaced_px * random.normal();
                y += w.misplaced_px * random.normal();
            }
            if (x >= -0.5 && y >= -0.5 && x < w.width_px - 0.5 && y < w.height_px - 0.5)
                out.truth.push_back({x, y, dead});
            if (dead) continue;
            if (w.deflect) {
                const auto [dx, dy] = w.deflect(x, y);
                x += dx;
                y += dy;
            }
            const double own_light = w.own_light ? w.own_light(x, y) : 1.0;
            const double g = w.vignetting / std::sqrt(2.0) / half;
            const auto [more_x, more_y] = w.gradient ? w.gradient(x, y) : std::pair(0.0, 0.0);
            const double gx = g * (x - middle_x) + more_x;
            const double gy = g * (y - middle_y) + more_y;
            const auto [stop_x, stop_y] = w.stop ? w.stop(x, y) : std::pair(0.0, 0.0);
            const auto disc = [&](double r) { return 0.5 * std::erfc((r - radius) / (std::sqrt(2.0) * w.edge_px)); };
            for (int py = std::max(0, static_cast<int>(std::ceil(y - reach)));
                 py <= std::min<double>(w.height_px - 1, y + reach); ++py) {
                for (int px = std::max(0, static_cast<int>(std::ceil(x - reach)));
                     px <= std::min<double>(w.width_px - 1, x + reach); ++px) {
                    double value = 0;
                    for (int s = 0; s < w.subpixels * w.subpixels; ++s) {
                        const int column = s % w.subpixels, row = s / w.subpixels;
                        const double dx = px + (column + 0.5) / w.subpixels - 0.5 - x;
                        const double dy = py + (row + 0.5) / w.subpixels - 0.5 - y;
                        const double r = w.to_scale
                            ? std::hypot((dx * out_x + dy * out_y) / along, (dy * out_x - dx * out_y) / across)
                            : std::sqrt(dx * dx + dy * dy);
                        const auto edge = [&](double at) {
                            return std::clamp((radius - std::abs(at)) / w.edge_px + 0.5, 0.0, 1.0);
                        };
                        double here = w.square ? edge(std::cos(angle) * dx + std::sin(angle) * dy) *
                                edge(std::cos(angle) * dy - std::sin(angle) * dx)
                            : radius > 0 ? disc(r)
                                         : std::exp(-0.5 * r * r / (radius * radius));
                        if (w.stop) here *= disc(std::hypot(dx - stop_x, dy - stop_y));
                        here *= 1 + (gx * dx + gy * dy) / (radius > 0 ? radius : -2 * radius);
                        value += own_light * here / (w.subpixels * w.subpixels);
                    }
                    light[static_cast<std::size_t>(py) * static_cast<std::size_t>(w.width_px) +
                          static_cast<std::size_t>(px)] += static_cast<float>(value);
                }
            }
        }
    }
    out.frame = Frame(w.width_px, w.height_px, w.bits);
    const double top = static_cast<double>((1U << static_cast<unsigned>(w.bits)) - 1U);
    for (int y = 0; y < w.height_px; ++y) {
        for (int x = 0; x < w.width_px; ++x) {
            double dn = light[static_cast<std::size_t>(y) * static_cast<std::size_t>(w.width_px) +
                              static_cast<std::size_t>(x)] *
                w.peak_dn;
            if (w.light) dn *= w.light(x, y);
            dn += w.background_dn;
            if (w.noise)
                dn += random.normal() * std::sqrt(dn * w.electrons_per_dn + w.read_e * w.read_e) / w.electrons_per_dn;
            out.frame.set(x, y, static_cast<std::uint32_t>(std::clamp(std::round(dn), 0.0, top)));
        }
    }
    return out;
}

// How far the fitted grid is from the truth, matched by place: every true lenslet against the nearest grid node.
struct Comparison {
    double rms_px = 0, max_px = 0;
    int unmatched_truth = 0;  // true lenslets without a grid node within a quarter pitch
    int invented = 0;         // centres measured where the truth has no lenslet or a dead one
    int found_alive = 0, alive_complete = 0;
};

inline Comparison compare(const Drawn& drawn, const GridCalibration& calibration, double pitch) {
    Comparison out;
    const auto nodes = calibration.nodes();
    // A coarse hash of the truth, one pitch a cell.
    const int columns = static_cast<int>(drawn.frame.width_px() / pitch) + 3;
    const int rows = static_cast<int>(drawn.frame.height_px() / pitch) + 3;
    std::vector<std::vector<std::size_t>> cells(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
    const auto cell = [&](double x, double y) {
        const int cx = std::clamp(static_cast<int>((x + pitch) / pitch), 0, columns - 1);
        const int cy = std::clamp(static_cast<int>((y + pitch) / pitch), 0, rows - 1);
        return std::pair{cx, cy};
    };
    for (std::size_t k = 0; k < drawn.truth.size(); ++k) {
        const auto [cx, cy] = cell(drawn.truth[k].x, drawn.truth[k].y);
        cells[static_cast<std::size_t>(cy * columns + cx)].push_back(k);
    }
    const auto nearest = [&](double x, double y) {
        const auto [cx, cy] = cell(x, y);
        std::pair<double, std::size_t> best{1e9, 0};
        for (int dy = -1; dy <= 1; ++dy) {
            for (int dx = -1; dx <= 1; ++dx) {
                if (cx + dx < 0 || cy + dy < 0 || cx + dx >= columns || cy + dy >= rows) continue;
                for (const std::size_t k : cells[static_cast<std::size_t>((cy + dy) * columns + cx + dx)]) {
                    best = std::min(best, {std::hypot(x - drawn.truth[k].x, y - drawn.truth[k].y), k});
                }
            }
        }
        return best;
    };
    double sum = 0;
    int matched = 0;
    std::vector<bool> hit(drawn.truth.size());
    for (const auto& node : nodes) {
        const auto [far, k] = nearest(node.centre_px.x_px, node.centre_px.y_px);
        if (far > 0.25 * pitch || hit[k]) continue;
        hit[k] = true;
        ++matched;
        sum += far * far;
        out.max_px = std::max(out.max_px, far);
    }
    out.rms_px = matched > 0 ? std::sqrt(sum / matched) : 1e9;
    out.unmatched_truth = static_cast<int>(drawn.truth.size()) - matched;
    for (const Observation& seen : calibration.observations) {
        const auto [far, k] = nearest(seen.centre_px.x_px, seen.centre_px.y_px);
        if (far > 0.25 * pitch || drawn.truth[k].dead) ++out.invented;
        else ++out.found_alive;
    }
    const double margin = 0.5 * pitch;
    for (const TruePoint& p : drawn.truth) {
        if (!p.dead && p.x > margin && p.y > margin && p.x < drawn.frame.width_px() - 1 - margin &&
            p.y < drawn.frame.height_px() - 1 - margin)
            ++out.alive_complete;
    }
    return out;
}

}  // namespace hord::calib::test
