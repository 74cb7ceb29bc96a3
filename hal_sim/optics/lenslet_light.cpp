#include "hal_sim/optics/lenslet_light.h"

#include <algorithm>
#include <cmath>

namespace hord::sim {
namespace {

constexpr double kSmallest = 1e-3;       // share of a bin that a cell may decide by its nine rays alone
constexpr double kSmallestNear = 1e-4;   // the same, next to a defect
constexpr double kStraight = 0.01;       // bins: bent more than this besides linearly, a cell is not smooth
constexpr double kEven = 0.01;           // the same for the light's weight
constexpr double kShift = 0.7;           // bins: a smooth cell over which the source moves further is halved
constexpr double kFocus = 0.8;           // bins: half sides of a box of slopes in which edges are looked for
constexpr int kDeepest = 64;

constexpr int kAxes = 4;  // x, y, u, v
constexpr int kCorners = 8;
constexpr int kSigns[kCorners][kAxes] = {{-1, -1, -1, -1}, {1, -1, -1, 1}, {-1, 1, -1, 1}, {1, 1, -1, -1},
                                         {-1, -1, 1, 1},   {1, -1, 1, -1}, {-1, 1, 1, -1}, {1, 1, 1, 1}};

double distance_of_segments(const Vec3& a, const Vec3& b, const Feature& feature) {
    // To a point exactly; to a longer one by the least over points no further apart than its reach.
    const double span = length(feature.to - feature.from);
    const int steps = span > 0 ? std::min(64, 1 + static_cast<int>(2 * span / feature.reach)) : 0;
    double least = distance_to_segment(feature.from, a, b);
    for (int k = 1; k <= steps; ++k) {
        const Vec3 p = feature.from + (static_cast<double>(k) / steps) * (feature.to - feature.from);
        least = std::min(least, distance_to_segment(p, a, b));
    }
    return steps > 0 ? least - 0.5 * span / steps : least;
}

}  // namespace

struct LensletLight::Cell {
    double x, y, hx, hy;  // centre and half sides, mm
    SlopeBox box;
    double lenslet_area;
    int depth;

    [[nodiscard]] double u() const { return 0.5 * (box.u0 + box.u1); }
    [[nodiscard]] double v() const { return 0.5 * (box.v0 + box.v1); }
    [[nodiscard]] double hu() const { return 0.5 * (box.u1 - box.u0); }
    [[nodiscard]] double hv() const { return 0.5 * (box.v1 - box.v0); }
    [[nodiscard]] double share() const { return 4 * hx * hy / lenslet_area; }
};

// Corner k's ray at [k], the centre's at [kCorners].
struct LensletLight::Samples {
    double s[kCorners + 1], t[kCorners + 1];    // slope at the source, bins
    double du[kCorners + 1], dv[kCorners + 1];  // and how far that is from the slope as seen
    double weight[kCorners + 1];
    std::uint64_t path[kCorners + 1];
    bool one_path = true;

    [[nodiscard]] double effect(const double* of, int axis) const {
        double sum = 0;
        for (int k = 0; k < kCorners; ++k) sum += kSigns[k][axis] * of[k];
        return sum / kCorners;
    }
};

LensletLight::LensletLight(const Scene& scene)
    : extents_(scene.camera.extents),
      camera_(scene),
      body_(body_of(scene, true)),
      clean_(body_of(scene, false)),
      source_radius_(scene.light.source_radius_bins),
      bin_rad_(scene.camera.bin_pitch_rad) {
    clean_.low = body_.low;
    clean_.high = body_.high;
}

void LensletLight::collect(int m, int n, double* bins) const {
    std::fill_n(bins, extents_.bins(), 0.0);
    const double half = 0.5 * camera_.pitch_mm();
    const Cell whole{camera_.lenslet_x_mm(m), camera_.lenslet_y_mm(n), half, half,
                     {camera_.left_of(0), camera_.left_of(extents_.i), camera_.top_of(0), camera_.top_of(extents_.j)},
                     4 * half * half, 0};
    std::vector<const Feature*> near;
    for (const Feature& feature : body_.features) near.push_back(&feature);
    collect(whole, near, bins);
}

LensletLight::Samples LensletLight::sample(const Cell& cell) const {
    Samples out;
    for (int k = 0; k <= kCorners; ++k) {
        double x = cell.x, y = cell.y, u = cell.u(), v = cell.v();
        if (k < kCorners) {
            x += kSigns[k][0] * cell.hx;
            y += kSigns[k][1] * cell.hy;
            u += kSigns[k][2] * cell.hu();
            v += kSigns[k][3] * cell.hv();
        }
        const Arrival arrival = trace(body_, camera_.to_part(x, y, u, v));
        camera_.to_camera(arrival.u, arrival.v, out.s[k], out.t[k]);
        out.du[k] = out.s[k] - u;
        out.dv[k] = out.t[k] - v;
        out.weight[k] = arrival.weight;
        out.path[k] = arrival.weight > 0 ? arrival.path : 0;
        out.one_path = out.one_path && out.path[k] == out.path[0];
    }
    return out;
}

// Whether a ray of the cell may meet the feature, judged by the clean part's way of its central ray.
bool LensletLight::is_near(const Cell& cell, const Feature& feature) const {
    Way way;
    trace(clean_, camera_.to_part(cell.x, cell.y, cell.u(), cell.v()), &way);
    const double depth = std::max(std::abs(feature.from.z), std::abs(feature.to.z)) + feature.reach;
    const double spread = std::hypot(cell.hx, cell.hy) + std::hypot(cell.hu(), cell.hv()) * bin_rad_ * depth;
    for (int k = 1; k < way.count; ++k) {
        if (distance_of_segments(way.points[k - 1], way.points[k], feature) < feature.reach + 1.5 * spread) return true;
    }
    return false;
}

// The part of the box that some path may bring to the source: by each path's own deflections, widened.
SlopeBox LensletLight::shrink(const Cell& cell, const Samples& samples) const {
    SlopeBox lit{1, -1, 1, -1};
    bool any = false;
    for (int k = 0; k <= kCorners; ++k) {
        if (samples.path[k] == 0) continue;
        bool first = true;
        for (int e = 0; e < k; ++e) first = first && samples.path[e] != samples.path[k];
        if (!first) continue;
        double u0 = samples.du[k], u1 = u0, v0 = samples.dv[k], v1 = v0;
        for (int e = k + 1; e <= kCorners; ++e) {
            if (samples.path[e] != samples.path[k]) continue;
            u0 = std::min(u0, samples.du[e]), u1 = std::max(u1, samples.du[e]);
            v0 = std::min(v0, samples.dv[e]), v1 = std::max(v1, samples.dv[e]);
        }
        // A path seen by all nine rays is known at its extremes; one seen by a few may reach further.
        const double least = samples.one_path ? 0.05 : 0.3, more = samples.one_path ? 0.25 : 0.5;
        const double mu = source_radius_ + least + more * (u1 - u0), mv = source_radius_ + least + more * (v1 - v0);
        const SlopeBox box{std::max(cell.box.u0, -u1 - mu), std::min(cell.box.u1, -u0 + mu), std::max(cell.box.v0, -v1 - mv),
                           std::min(cell.box.v1, -v0 + mv)};
        if (box.is_empty()) continue;
        lit = any ? SlopeBox{std::min(lit.u0, box.u0), std::max(lit.u1, box.u1), std::min(lit.v0, box.v0), std::max(lit.v1, box.v1)}
                  : box;
        any = true;
    }
    return lit;
}

void LensletLight::collect(const Cell& cell, const std::vector<const Feature*>& near_before, double* bins) const {
    const Samples samples = sample(cell);
    std::vector<const Feature*> near;
    bool coarse = false;
    const double steep = std::max(cell.hu(), cell.hv()) * bin_rad_;
    double lever = 0.5 * (body_.high.z - body_.low.z);
    for (const Feature* feature : near_before) {
        if (!is_near(cell, *feature)) continue;
        near.push_back(feature);
        lever = std::max(std::abs(feature->from.z), std::abs(feature->to.z));
        coarse = coarse || std::max(cell.hx, cell.hy) + steep * lever > feature->resolution;
    }
    const double weight = cell.share() * cell.box.area();
    const bool smallest = cell.depth >= kDeepest || weight < (near.empty() ? kSmallest : kSmallestNear);

    if (!coarse) {
        const SlopeBox lit = shrink(cell, samples);
        if (lit.is_empty()) return;
        if (lit.area() < 0.6 * cell.box.area()) {
            Cell narrower = cell;
            narrower.box = lit;
            ++narrower.depth;
            collect(narrower, near, bins);
            return;
        }
    }

    int axis = -1;
    if (samples.one_path && samples.path[0] == 0) {
        if (!coarse) return;
    } else if (samples.one_path && !coarse) {
        // Straightness: what the four linear effects do not explain.
        double worst = 0, effects_s[kAxes], effects_t[kAxes], uneven = 0;
        double mean_s = 0, mean_t = 0;
        for (int k = 0; k < kCorners; ++k) mean_s += samples.s[k] / kCorners, mean_t += samples.t[k] / kCorners;
        for (int a = 0; a < kAxes; ++a) effects_s[a] = samples.effect(samples.s, a), effects_t[a] = samples.effect(samples.t, a);
        for (int k = 0; k <= kCorners; ++k) {
            double s = mean_s, t = mean_t;
            for (int a = 0; a < kAxes && k < kCorners; ++a) s += kSigns[k][a] * effects_s[a], t += kSigns[k][a] * effects_t[a];
            worst = std::max({worst, std::abs(samples.s[k] - s), std::abs(samples.t[k] - t)});
            uneven = std::max(uneven, std::abs(samples.weight[k] - samples.weight[kCorners]));
        }
        const double shift_x = std::hypot(effects_s[0], effects_t[0]), shift_y = std::hypot(effects_s[1], effects_t[1]);
        if ((worst < kStraight && uneven < kEven && shift_x + shift_y < kShift)) {
            add_smooth(cell, samples, bins);
            return;
        }
        // Halve where the deflection changes most.
        double most = -1;
        for (int a = 0; a < kAxes; ++a) {
            const double change = std::hypot(samples.effect(samples.du, a), samples.effect(samples.dv, a));
            if (change > most) most = change, axis = a;
        }
    } else if (!samples.one_path && std::max(cell.hu(), cell.hv()) > kFocus) {
        axis = cell.hu() >= cell.hv() ? 2 : 3;  // few slopes are lit: find them before looking for the edge
    } else if (!samples.one_path) {
        // Halve where it tells the paths apart best.
        int most = 0;
        for (int a = 0; a < kAxes; ++a) {
            int balance = 0;
            for (int k = 0; k < kCorners; ++k) balance += samples.path[k] == samples.path[kCorners] ? kSigns[k][a] : 0;
            if (std::abs(balance) > most) most = std::abs(balance), axis = a;
        }
    }
    if (smallest) {
        add_rays(cell, samples, bins);
        return;
    }
    if (axis < 0 || coarse) {
        const double sides[kAxes] = {cell.hx, cell.hy, cell.hu() * bin_rad_ * lever, cell.hv() * bin_rad_ * lever};
        axis = static_cast<int>(std::max_element(sides, sides + kAxes) - sides);
    }
    Cell a = cell, b = cell;
    a.depth = b.depth = cell.depth + 1;
    switch (axis) {
        case 0: a.hx = b.hx = 0.5 * cell.hx, a.x -= a.hx, b.x += b.hx; break;
        case 1: a.hy = b.hy = 0.5 * cell.hy, a.y -= a.hy, b.y += b.hy; break;
        case 2: a.box.u1 = b.box.u0 = cell.u(); break;
        default: a.box.v1 = b.box.v0 = cell.v(); break;
    }
    collect(a, near, bins);
    collect(b, near, bins);
}

void LensletLight::add_smooth(const Cell& cell, const Samples& samples, double* bins) const {
    double mean_s = 0, mean_t = 0, weight = samples.weight[kCorners];
    for (int k = 0; k < kCorners; ++k) {
        mean_s += samples.s[k] / kCorners, mean_t += samples.t[k] / kCorners;
        weight += samples.weight[k];
    }
    weight /= kCorners + 1;
    SlopeMap map;
    map.at_u = cell.u(), map.at_v = cell.v();
    // A square's mean is a third of its value at the corners.
    const double s = samples.s[kCorners] + (mean_s - samples.s[kCorners]) / 3;
    const double t = samples.t[kCorners] + (mean_t - samples.t[kCorners]) / 3;
    map.s_u = samples.effect(samples.s, 2) / cell.hu(), map.s_v = samples.effect(samples.s, 3) / cell.hv();
    map.t_u = samples.effect(samples.t, 2) / cell.hu(), map.t_v = samples.effect(samples.t, 3) / cell.hv();
    const double sx = samples.effect(samples.s, 0), tx = samples.effect(samples.t, 0);
    const double sy = samples.effect(samples.s, 1), ty = samples.effect(samples.t, 1);

    // Over positions by Gauss and Legendre, the finer the further the source moves.
    static constexpr double kAt[4][4] = {{0}, {-0.57735026918962576, 0.57735026918962576}, {-0.77459666924148338, 0, 0.77459666924148338},
                                         {-0.86113631159405258, -0.33998104358485626, 0.33998104358485626, 0.86113631159405258}};
    static constexpr double kShare[4][4] = {{1}, {0.5, 0.5}, {5.0 / 18, 8.0 / 18, 5.0 / 18},
                                            {0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693}};
    const auto order = [](double shift) { return shift < 0.005 ? 1 : shift < 0.1 ? 2 : shift < 0.25 ? 3 : 4; };
    const int nx = order(std::hypot(sx, tx)), ny = order(std::hypot(sy, ty));
    for (int b = 0; b < ny; ++b) {
        for (int a = 0; a < nx; ++a) {
            const double x = kAt[nx - 1][a], y = kAt[ny - 1][b];
            map.s = s + x * sx + y * sy;
            map.t = t + x * tx + y * ty;
            add_source(extents_, map, source_radius_, cell.box, cell.share() * weight * kShare[nx - 1][a] * kShare[ny - 1][b], bins);
        }
    }
}

void LensletLight::add_rays(const Cell& cell, const Samples& samples, double* bins) const {
    for (int k = 0; k <= kCorners; ++k) {
        if (samples.path[k] == 0) continue;
        SlopeMap map;  // slopes pass unchanged but for the deflection seen
        map.s = samples.du[k], map.t = samples.dv[k];
        add_source(extents_, map, source_radius_, cell.box, cell.share() * samples.weight[k] / (kCorners + 1), bins);
    }
}

}  // namespace hord::sim
