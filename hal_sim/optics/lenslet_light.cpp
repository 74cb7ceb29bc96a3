#include "hal_sim/optics/lenslet_light.h"

#include <algorithm>
#include <cmath>

namespace hord::sim {
namespace {

constexpr double kSampled = 0.25;        // share of a bin: a smaller cell that is not smooth is sampled
constexpr double kSampledNear = 0.01;    // the same, next to a defect
constexpr double kRays = 500;            // a bin, in sampled cells
constexpr double kRaysNear = 3000;       // the same, next to a defect
constexpr int kFewestRays = 16;
constexpr double kStraight = 0.01;       // bins: bent more than this besides linearly, a cell is not smooth
constexpr double kEven = 0.01;           // the same for the light's weight
constexpr double kShift = 0.7;           // bins: a smooth cell over which the source moves further is halved
constexpr double kFocus = 1.2;           // bins: half sides of a box of slopes in which edges are looked for

// The additive recurrence of the root of x^5 = x + 1: evenly spread points in four dimensions (M. Roberts, "The unreasonable
// effectiveness of quasirandom sequences", 2018).
constexpr double kStep[4] = {0.85667488385450287, 0.73389185662712604, 0.62870672103780871, 0.53859725722361015};

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

    [[nodiscard]] double mean(const double* of) const {
        double sum = 0;
        for (int k = 0; k < kCorners; ++k) sum += of[k];
        return sum / kCorners;
    }
    // How far from linear the map to the source is, bins; how uneven the light's weight.
    [[nodiscard]] double bent() const { return std::max(misfit(s), misfit(t)); }
    [[nodiscard]] double uneven() const {
        const auto [low, high] = std::minmax_element(weight, weight + kCorners + 1);
        return *high - *low;
    }
    [[nodiscard]] double misfit(const double* of) const {
        const double centre = mean(of);
        double effects[kAxes], worst = std::abs(of[kCorners] - centre);
        for (int a = 0; a < kAxes; ++a) effects[a] = effect(of, a);
        for (int k = 0; k < kCorners; ++k) {
            double fit = centre;
            for (int a = 0; a < kAxes; ++a) fit += kSigns[k][a] * effects[a];
            worst = std::max(worst, std::abs(of[k] - fit));
        }
        return worst;
    }
    // What half a side of the cell along an axis changes.
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
                     4 * half * half};
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

// The part of the box that some path may bring to the source, by how far each path bends.
SlopeBox LensletLight::shrink(const Cell& cell, const Samples& samples) const {
    const auto lit = [&](double u0, double u1, double v0, double v1) {
        const double r = source_radius_;
        return SlopeBox{std::max(cell.box.u0, -u1 - r), std::min(cell.box.u1, -u0 + r), std::max(cell.box.v0, -v1 - r),
                        std::min(cell.box.v1, -v0 + r)};
    };
    if (samples.one_path) {  // the four effects, and what they do not explain
        if (samples.path[0] == 0) return {};
        double du = 0, dv = 0;
        const double more = 0.02 + 2 * samples.bent();
        for (int a = 0; a < kAxes; ++a) {
            du += std::abs(samples.effect(samples.du, a));
            dv += std::abs(samples.effect(samples.dv, a));
        }
        const double u = samples.mean(samples.du), v = samples.mean(samples.dv);
        return lit(u - du - more, u + du + more, v - dv - more, v + dv + more);
    }
    SlopeBox all = lit(-0.1, 0.1, -0.1, 0.1);  // light that meets nothing may pass any edge
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
        // Seen by a few rays only, a path may reach further than they say.
        const double mu = 0.3 + 0.5 * (u1 - u0), mv = 0.3 + 0.5 * (v1 - v0);
        const SlopeBox box = lit(u0 - mu, u1 + mu, v0 - mv, v1 + mv);
        if (box.is_empty()) continue;
        all = all.is_empty() ? box
                             : SlopeBox{std::min(all.u0, box.u0), std::max(all.u1, box.u1), std::min(all.v0, box.v0), std::max(all.v1, box.v1)};
    }
    return all;
}

void LensletLight::collect(const Cell& cell, const std::vector<const Feature*>& near_before, double* bins) const {
    std::vector<const Feature*> near;
    double lever = 0.5 * (body_.high.z - body_.low.z);
    const auto sides = [&](int axis) {  // how much of the part the cell's rays cover, along each axis
        return axis == 0 ? cell.hx : axis == 1 ? cell.hy : bin_rad_ * lever * (axis == 2 ? cell.hu() : cell.hv());
    };
    bool coarse = false;
    for (const Feature* feature : near_before) {
        if (!is_near(cell, *feature)) continue;
        near.push_back(feature);
        lever = std::max(std::abs(feature->from.z), std::abs(feature->to.z));
        coarse = coarse || std::max(cell.hx, cell.hy) + std::max(sides(2), sides(3)) > feature->resolution;
    }
    const double weight = cell.share() * cell.box.area();
    const bool small = weight < (near.empty() ? kSampled : kSampledNear);
    if (small && coarse) return add_sampled(cell, kRaysNear, bins);
    if (coarse) {
        int axis = 0;
        for (int a = 1; a < kAxes; ++a) axis = sides(a) > sides(axis) ? a : axis;
        return halve(cell, axis, near, bins);
    }

    const Samples samples = sample(cell);
    // Rays of different paths in a wide box may have missed a third path between them: first find the lit slopes.
    if (!samples.one_path && std::max(cell.hu(), cell.hv()) > kFocus) return halve(cell, cell.hu() >= cell.hv() ? 2 : 3, near, bins);
    const SlopeBox lit = shrink(cell, samples);
    if (lit.is_empty()) return;
    if (lit.area() < 0.6 * cell.box.area()) {
        Cell narrower = cell;
        narrower.box = lit;
        return collect(narrower, near, bins);
    }
    if (samples.one_path) {
        const double shift_x = std::hypot(samples.effect(samples.s, 0), samples.effect(samples.t, 0));
        const double shift_y = std::hypot(samples.effect(samples.s, 1), samples.effect(samples.t, 1));
        if (samples.bent() < kStraight && samples.uneven() < kEven && shift_x + shift_y < kShift) return add_smooth(cell, samples, bins);
    }
    if (small) return add_sampled(cell, near.empty() ? kRays : kRaysNear, bins);

    // Halve where the rays differ most: in the path they take, or in how far they are bent.
    int axis = 0;
    double most = -1;
    for (int a = 0; a < kAxes; ++a) {
        double difference = 0;
        if (samples.one_path) {
            difference = std::hypot(samples.effect(samples.du, a), samples.effect(samples.dv, a));
        } else {
            for (int k = 0; k < kCorners; ++k) difference += samples.path[k] == samples.path[kCorners] ? kSigns[k][a] : 0;
            difference = std::abs(difference) + 1e-3 * sides(a) / (sides(0) + sides(1));  // undecided: where it is widest
        }
        if (difference > most) most = difference, axis = a;
    }
    halve(cell, axis, near, bins);
}

void LensletLight::halve(const Cell& cell, int axis, const std::vector<const Feature*>& near, double* bins) const {
    Cell a = cell, b = cell;
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
    const double weight = (samples.weight[kCorners] + kCorners * samples.mean(samples.weight)) / (kCorners + 1);
    SlopeMap map;
    map.at_u = cell.u(), map.at_v = cell.v();
    // A square's mean is a third of its value at the corners.
    const double s = samples.s[kCorners] + (samples.mean(samples.s) - samples.s[kCorners]) / 3;
    const double t = samples.t[kCorners] + (samples.mean(samples.t) - samples.t[kCorners]) / 3;
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

void LensletLight::add_sampled(const Cell& cell, double rays_per_bin, double* bins) const {
    const double weight = cell.share() * cell.box.area();
    const int count = std::max(kFewestRays, static_cast<int>(rays_per_bin * weight));
    double at[kAxes] = {0.5, 0.5, 0.5, 0.5};
    for (int k = 0; k < count; ++k) {
        for (int a = 0; a < kAxes; ++a) {
            at[a] += kStep[a];
            if (at[a] >= 1) at[a] -= 1;
        }
        const double u = cell.box.u0 + at[2] * (cell.box.u1 - cell.box.u0), v = cell.box.v0 + at[3] * (cell.box.v1 - cell.box.v0);
        const Arrival arrival =
            trace(body_, camera_.to_part(cell.x + (2 * at[0] - 1) * cell.hx, cell.y + (2 * at[1] - 1) * cell.hy, u, v));
        if (!(arrival.weight > 0)) continue;
        double s = 0, t = 0;
        camera_.to_camera(arrival.u, arrival.v, s, t);
        if (s * s + t * t >= source_radius_ * source_radius_) continue;
        const int i = std::clamp(static_cast<int>(std::floor(u - camera_.left_of(0))), 0, extents_.i - 1);
        const int j = std::clamp(static_cast<int>(std::floor(v - camera_.top_of(0))), 0, extents_.j - 1);
        bins[j * extents_.i + i] += arrival.weight * weight / count;
    }
}

}  // namespace hord::sim
