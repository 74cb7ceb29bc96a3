#include "hal_sim/optics/camera/lenslet_light.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/optics/camera/lenslet_cell.h"

namespace hord::sim {
namespace {

// A cell that is not smooth is sampled if it holds less than this share of a bin; else it is halved.
constexpr double kSampledShare = 0.25, kSampledShareNear = 0.01;   // kSampledShareNear: next to a defect
constexpr double kEdgeShare = 0.05;                                // at the edge of an obstacle
constexpr double kRays = 500, kRaysNear = 3000, kRaysEdge = 2000;  // rays a bin in sampled cells
constexpr int kMinRays = 16;                                       // of a sampled cell
constexpr double kGhostImportance = 0.01;  // weight of ghosts' cells: ghosts hold less than a hundredth of the light

// A cell is smooth up to these limits.
constexpr double kMaxBend = 0.01;        // deviation from a linear map to the source, bins
constexpr double kMaxUneven = 0.01;      // range of the light's weights
constexpr double kMaxUnevenWide = 1e-4;  // the same, for a cell whose box is wider than the light in it
constexpr double kMaxShift = 0.7;        // motion of the source over half the cell, bins

constexpr double kMaxMixedBox = 1.2;  // bins: a box with larger half sides is halved where the rays' paths differ

// The search for light reflected by a wall: rays of a batch, and batches as long as such light is found.
constexpr int kMirrorRays = 256, kMirrorBatches = 4;
constexpr double kMirrorNear = 0.5;  // bins from the source: reflected rays this close count

// Whether a feature comes within `reach` of the segment a..b. Exact for a point; for a segment by points at most one
// reach of the feature apart, never false where it should be true.
bool comes_within(double reach, const Vec3& a, const Vec3& b, const Feature& feature) {
    const Vec3 way = feature.to - feature.from;
    const double span = length(way);
    if (span == 0) return distance_to_segment(feature.from, a, b) < reach;
    const double middle = distance_to_segment(feature.from + 0.5 * way, a, b);
    if (middle > (1 + 1e-9) * (reach + span)) return false;  // no point of it can be that near
    const int steps = std::min(64, 1 + static_cast<int>(2 * span / feature.reach));
    const double between = 0.5 * span / steps;
    for (int k = 0; k <= steps; ++k) {
        if (distance_to_segment(feature.from + (static_cast<double>(k) / steps) * way, a, b) - between < reach)
            return true;
    }
    return false;
}

bool is_smooth(const CellSamples& samples) {
    return samples.nonlinearity() < kMaxBend && samples.unevenness() < kMaxUneven && samples.shift() < kMaxShift;
}

}  // namespace

// One pass over one lenslet.
class LensletLight::Gathering {
  public:
    // `body`: the pass's part, or it with other transmissions.
    Gathering(const LensletLight& in, const Pass& pass, const Body& body, const SlopeGrid& grid,
              const LensletCell& whole, double* cells)
        : camera_(in.camera_), obstacles_(in.obstacles_), body_(body), clean_(pass.optics->clean), pass_(pass),
          bin_rad_(in.bin_rad_), importance_(pass.ghost.is_one() ? kGhostImportance : 1), grid_(grid), whole_(whole),
          cells_(cells) {}

    void collect(const std::vector<const Feature*>& near) { collect(whole_, near); }
    [[nodiscard]] bool may_meet(const Feature& feature) const {
        std::vector<const Feature*> near;
        keep_near(whole_, {&feature}, near);
        return !near.empty();
    }

  private:
    struct Mirror {
        std::uint64_t path;
        SlopeBox lit;
        int rays;
    };
    void collect(const LensletCell& cell, const std::vector<const Feature*>& near);
    void find_mirrors(const LensletCell& whole);
    [[nodiscard]] CameraRay ray_at(double x, double y, double u, double v) const {
        return camera_.to_part(x - pass_.shift_x, y - pass_.shift_y, u, v);
    }
    [[nodiscard]] CellSamples sample(const LensletCell& cell) const;
    void keep_near(const LensletCell& cell, const std::vector<const Feature*>& before,
                   std::vector<const Feature*>& near) const;
    [[nodiscard]] SlopeBox shrink(const LensletCell& cell, const CellSamples& samples) const;
    void add_smooth(const LensletCell& cell, const SlopeBox& lit, const CellSamples& samples, double transmission);
    void add_sampled(const LensletCell& cell, double rays_per_bin);
    void halve(const LensletCell& cell, int axis, const std::vector<const Feature*>& near);

    const CameraGeometry& camera_;
    const Obstacles& obstacles_;
    const Body& body_;
    const Body& clean_;
    const Pass& pass_;
    double bin_rad_, importance_;
    const SlopeGrid& grid_;
    const LensletCell& whole_;
    double* cells_;
    bool mirrors_searched_ = false;
    std::vector<Mirror> mirrors_;
};

void LensletLight::collect(const CameraGeometry::Place& lenslet, const SlopeGrid& grid, const SlopeBox& range,
                           double* cells) const {
    std::fill_n(cells, grid.cells(), 0.0);
    const LensletCell whole{lenslet.x_mm,      lenslet.y_mm, lenslet.half_x_mm,
                            lenslet.half_y_mm, range,        4 * lenslet.half_x_mm * lenslet.half_y_mm};
    std::vector<const Feature*> near;
    std::vector<double> fine;
    for (std::size_t k = 0; k < passes_.size(); ++k) {
        const Pass& pass = passes_[k];
        near.clear();
        for (const Feature& feature : pass.optics->body.features) near.push_back(&feature);
        const Body& body = pass.optics->body;
        if (!pass.optics->diffraction) {
            Gathering light(*this, pass, body, grid, whole, cells);
            if (pass.optics->scattering && light.may_meet(pass.optics->scattering->haze))
                add_scattered(pass, grid, whole, near, cells);
            else light.collect(near);
            continue;
        }
        const SlopeGrid sharp = pass.optics->diffraction->fine(grid);
        if (k == 0 || passes_[k - 1].optics != pass.optics) fine.assign(static_cast<std::size_t>(sharp.cells()), 0.0);
        Gathering(*this, pass, body, sharp, whole, fine.data()).collect(near);
        if (k + 1 == passes_.size() || passes_[k + 1].optics != pass.optics)
            pass.optics->diffraction->blur(grid, fine.data(), cells);
    }
}

// What passes the haze is the part's light less the light of the part with opaque haze.
void LensletLight::add_scattered(const Pass& pass, const SlopeGrid& grid, const LensletCell& whole,
                                 const std::vector<const Feature*>& near, double* cells) const {
    const Scattering& scattering = *pass.optics->scattering;
    const SlopeGrid fine = scattering.blur.fine(grid);
    std::vector<double> hazy(static_cast<std::size_t>(fine.cells())), beside(hazy.size());
    Gathering(*this, pass, pass.optics->body, fine, whole, hazy.data()).collect(near);
    Gathering(*this, pass, scattering.opaque, fine, whole, beside.data()).collect(near);
    for (std::size_t k = 0; k < hazy.size(); ++k) hazy[k] = std::max(0.0, hazy[k] - beside[k]);
    Gathering(*this, pass, scattering.opaque, grid, whole, cells).collect(near);
    scattering.blur.blur(grid, hazy.data(), cells);
}

CellSamples LensletLight::Gathering::sample(const LensletCell& cell) const {
    double u[kCorners + 1], v[kCorners + 1];
    CameraRay rays[kCorners + 1];
    for (int k = 0; k < kCorners; ++k) {
        u[k] = cell.u() + kSigns[k][2] * cell.hu(), v[k] = cell.v() + kSigns[k][3] * cell.hv();
        rays[k] = ray_at(cell.x + kSigns[k][0] * cell.hx, cell.y + kSigns[k][1] * cell.hy, u[k], v[k]);
    }
    u[kCorners] = cell.u(), v[kCorners] = cell.v();
    rays[kCorners] = ray_at(cell.x, cell.y, u[kCorners], v[kCorners]);
    Arrival arrivals[kCorners + 1];
    trace_many(body_, rays, arrivals, pass_.ghost);
    CellSamples out;
    for (int k = 0; k <= kCorners; ++k) {
        const Arrival& arrival = arrivals[k];
        camera_.to_camera(arrival.u, arrival.v, out.s[k], out.t[k]);
        out.du[k] = out.s[k] - u[k];
        out.dv[k] = out.t[k] - v[k];
        out.weight[k] = arrival.weight;
        out.path[k] = arrival.weight > 0 ? arrival.path : 0;
        out.one_path = out.one_path && out.path[k] == out.path[0];
    }
    return out;
}

// Keeps the features that a ray of the cell may meet, by the path of the central ray through the clean part.
void LensletLight::Gathering::keep_near(const LensletCell& cell, const std::vector<const Feature*>& before,
                                        std::vector<const Feature*>& near) const {
    if (before.empty()) return;
    RayPolyline way;
    trace(clean_, ray_at(cell.x, cell.y, cell.u(), cell.v()), &way, pass_.ghost);
    const double across = std::hypot(cell.hx, cell.hy), aslant = std::hypot(cell.hu(), cell.hv()) * bin_rad_;
    // Refraction moves a ray's foot on the measurement plane in proportion to its slope.
    const double foot = (1 - 1 / body_.part_index()) * std::max(std::abs(body_.low.z), std::abs(body_.high.z));
    for (const Feature* feature : before) {
        const double depth = std::max(std::abs(feature->from.z), std::abs(feature->to.z)) + feature->reach + foot;
        const double reach = feature->reach + 1.5 * (across + aslant * depth);
        for (int k = 1; k < way.count; ++k) {
            if (!comes_within(reach, way.points[k - 1], way.points[k], *feature)) continue;
            near.push_back(feature);
            break;
        }
    }
}

// The part of the box whose slopes some path may bring to the source, by the deflection of each path.
SlopeBox LensletLight::Gathering::shrink(const LensletCell& cell, const CellSamples& samples) const {
    const auto lit = [&](double u0, double u1, double v0, double v1) {
        const double r = pass_.radius, s = pass_.s, t = pass_.t;
        return SlopeBox{std::max(cell.box.u0, s - u1 - r), std::min(cell.box.u1, s - u0 + r),
                        std::max(cell.box.v0, t - v1 - r), std::min(cell.box.v1, t - v0 + r)};
    };
    if (samples.one_path) {  // the linear effects and the deviation from them
        if (samples.path[0] == 0) return {};
        double du = 0, dv = 0;
        const double more = 0.02 + 2 * samples.nonlinearity();
        for (int a = 0; a < kAxes; ++a) {
            du += std::abs(samples.effect(samples.du, a));
            dv += std::abs(samples.effect(samples.dv, a));
        }
        const double u = samples.mean(samples.du), v = samples.mean(samples.dv);
        return lit(u - du - more, u + du + more, v - dv - more, v + dv + more);
    }
    // Free light may pass beside any edge; its slope is the one seen by the camera.
    SlopeBox all = lit(-camera_.offset(cell.x + cell.hx) - 0.1, -camera_.offset(cell.x - cell.hx) + 0.1,
                       -camera_.offset(cell.y + cell.hy) - 0.1, -camera_.offset(cell.y - cell.hy) + 0.1);
    const auto add = [&](const SlopeBox& box) {
        if (box.is_empty()) return;
        all = all.is_empty() ? box
                             : SlopeBox{std::min(all.u0, box.u0), std::max(all.u1, box.u1), std::min(all.v0, box.v0),
                                        std::max(all.v1, box.v1)};
    };
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
        // A path that only a few rays took may reach further than these.
        const double mu = 0.3 + 0.5 * (u1 - u0), mv = 0.3 + 0.5 * (v1 - v0);
        add(lit(u0 - mu, u1 + mu, v0 - mv, v1 + mv));
    }
    for (const Mirror& mirror : mirrors_) {
        add({std::max(cell.box.u0, mirror.lit.u0), std::min(cell.box.u1, mirror.lit.u1),
             std::max(cell.box.v0, mirror.lit.v0), std::min(cell.box.v1, mirror.lit.v1)});
    }
    return all;
}

// Finds light that a wall along the light reflects. This path lies between the free light and the glass, too narrow for
// nine rays, at slopes far from theirs. Runs once a lenslet, and not near defects, whose cells are small anyway.
void LensletLight::Gathering::find_mirrors(const LensletCell& whole) {
    double u[kMirrorRays], v[kMirrorRays], at[kAxes];
    CameraRay rays[kMirrorRays];
    Arrival arrivals[kMirrorRays];
    first_point(whole, at);
    const double near = pass_.radius + kMirrorNear, far = pass_.radius + 4 * kMirrorNear;
    bool any = true;  // whether reflected rays came near, by a wider limit that fewer rays reach
    for (int batch = 0; batch < kMirrorBatches && any; ++batch) {
        for (int k = 0; k < kMirrorRays; ++k) {
            next_point(at);
            u[k] = whole.box.u0 + at[2] * (whole.box.u1 - whole.box.u0),
            v[k] = whole.box.v0 + at[3] * (whole.box.v1 - whole.box.v0);
            rays[k] = ray_at(whole.x + (2 * at[0] - 1) * whole.hx, whole.y + (2 * at[1] - 1) * whole.hy, u[k], v[k]);
        }
        trace_many(body_, rays, arrivals, pass_.ghost);
        any = false;
        for (int k = 0; k < kMirrorRays; ++k) {
            if (!(arrivals[k].weight > 0) || (arrivals[k].path & kMirrored) == 0) continue;
            double s = 0, t = 0;
            camera_.to_camera(arrivals[k].u, arrivals[k].v, s, t);
            const double off = std::hypot(s - pass_.s, t - pass_.t);
            any = any || off < far;
            if (off > near) continue;
            auto known = std::find_if(mirrors_.begin(), mirrors_.end(),
                                      [&](const Mirror& mirror) { return mirror.path == arrivals[k].path; });
            if (known == mirrors_.end())
                known = mirrors_.insert(known, {arrivals[k].path, {u[k], u[k], v[k], v[k]}, 0});
            SlopeBox& lit = known->lit;
            lit = {std::min(lit.u0, u[k]), std::max(lit.u1, u[k]), std::min(lit.v0, v[k]), std::max(lit.v1, v[k])};
            ++known->rays;
        }
    }
    for (Mirror& mirror : mirrors_) {
        constexpr int kFew = 6;
        const double more = mirror.rays < kFew ? near : 0.5 * near;
        mirror.lit = {mirror.lit.u0 - more, mirror.lit.u1 + more, mirror.lit.v0 - more, mirror.lit.v1 + more};
    }
}

void LensletLight::Gathering::collect(const LensletCell& cell, const std::vector<const Feature*>& near_before) {
    std::vector<const Feature*> near;
    double lever = 0.5 * (body_.high.z - body_.low.z);
    const auto sides = [&](int axis) {  // extent of the cell's rays on the part along each axis, mm
        return axis == 0 ? cell.hx : axis == 1 ? cell.hy : bin_rad_ * lever * (axis == 2 ? cell.hu() : cell.hv());
    };
    bool coarse = false;
    keep_near(cell, near_before, near);
    for (const Feature* feature : near) {
        lever = std::max(std::abs(feature->from.z), std::abs(feature->to.z));
        coarse = coarse || std::max(cell.hx, cell.hy) + std::max(sides(2), sides(3)) > feature->resolution;
    }
    const double weight = cell.share() * cell.box.area() * importance_;
    const bool small = weight < (near.empty() ? kSampledShare : kSampledShareNear);
    if (small && coarse) return add_sampled(cell, kRaysNear);
    if (coarse) {
        int axis = 0;
        for (int a = 1; a < kAxes; ++a) axis = sides(a) > sides(axis) ? a : axis;
        return halve(cell, axis, near);
    }

    const CellSamples samples = sample(cell);
    // With different paths in a wide box the nine rays may miss a third path: first narrow the slopes.
    if (!samples.one_path && std::max(cell.hu(), cell.hv()) > kMaxMixedBox)
        return halve(cell, cell.hu() >= cell.hv() ? 2 : 3, near);
    if (!samples.one_path && near.empty() && !mirrors_searched_ && !pass_.ghost.is_one())
        mirrors_searched_ = true, find_mirrors(whole_);
    const SlopeBox lit = shrink(cell, samples);
    if (lit.is_empty()) return;
    const double transmission = obstacles_.empty() ? 1 : obstacles_.transmission(cell.x, cell.y, cell.hx, cell.hy, lit);
    if (transmission == 0) return;
    const bool edge = transmission < 0;  // of an obstacle
    if (near.empty() && samples.one_path && !edge && samples.path[0] != kFreePath && is_smooth(samples) &&
        samples.unevenness() < kMaxUnevenWide)
        return add_smooth(cell, lit, samples, transmission);
    if (lit.area() < 0.6 * cell.box.area()) {
        LensletCell narrower = cell;
        narrower.box = lit;
        return collect(narrower, near);
    }
    if (samples.one_path && !edge && is_smooth(samples)) return add_smooth(cell, lit, samples, transmission);
    if (edge ? weight < kEdgeShare : small)
        return add_sampled(cell, edge ? kRaysEdge : near.empty() ? kRays : kRaysNear);

    // Halve along the axis in which the rays' paths or deflections differ most; at an obstacle the longest side.
    if (edge && samples.one_path && is_smooth(samples)) {
        const double u = cell.hu() * camera_.pitch_mm(),
                     v = cell.hv() * camera_.pitch_mm();  // a bin as long as a lenslet
        return halve(
            cell, std::max(u, v) > std::max(cell.hx, cell.hy) ? (u >= v ? 2 : 3) : (cell.hx >= cell.hy ? 0 : 1), near);
    }
    int axis = 0;
    double most = -1;
    for (int a = 0; a < kAxes; ++a) {
        double difference = 0;
        if (samples.one_path) {
            difference = std::hypot(samples.effect(samples.du, a), samples.effect(samples.dv, a));
        } else {
            for (int k = 0; k < kCorners; ++k)
                difference += samples.path[k] == samples.path[kCorners] ? kSigns[k][a] : 0;
            difference = std::abs(difference) + 1e-3 * sides(a) / (sides(0) + sides(1));  // tie: the widest side
        }
        if (difference > most) most = difference, axis = a;
    }
    halve(cell, axis, near);
}

void LensletLight::Gathering::halve(const LensletCell& cell, int axis, const std::vector<const Feature*>& near) {
    LensletCell a = cell, b = cell;
    switch (axis) {
        case 0: a.hx = b.hx = 0.5 * cell.hx, a.x -= a.hx, b.x += b.hx; break;
        case 1: a.hy = b.hy = 0.5 * cell.hy, a.y -= a.hy, b.y += b.hy; break;
        case 2: a.box.u1 = b.box.u0 = cell.u(); break;
        default: a.box.v1 = b.box.v0 = cell.v(); break;
    }
    collect(a, near);
    collect(b, near);
}

void LensletLight::Gathering::add_smooth(const LensletCell& cell, const SlopeBox& lit, const CellSamples& samples,
                                         double transmission) {
    const double weight = pass_.power * transmission *
        (samples.weight[kCorners] + kCorners * samples.mean(samples.weight)) / (kCorners + 1);
    SlopeMap map;
    map.at_u = cell.u(), map.at_v = cell.v();
    // The mean of a square over [-1, 1] is a third of its value at the ends.
    const double s = samples.s[kCorners] + (samples.mean(samples.s) - samples.s[kCorners]) / 3;
    const double t = samples.t[kCorners] + (samples.mean(samples.t) - samples.t[kCorners]) / 3;
    map.s_u = samples.effect(samples.s, 2) / cell.hu(), map.s_v = samples.effect(samples.s, 3) / cell.hv();
    map.t_u = samples.effect(samples.t, 2) / cell.hu(), map.t_v = samples.effect(samples.t, 3) / cell.hv();
    const double sx = samples.effect(samples.s, 0), tx = samples.effect(samples.t, 0);
    const double sy = samples.effect(samples.s, 1), ty = samples.effect(samples.t, 1);

    // Gauss-Legendre quadrature over positions; its order grows with the motion of the source.
    static constexpr double kAt[4][4] = {
        {0},
        {-0.57735026918962576, 0.57735026918962576},
        {-0.77459666924148338, 0, 0.77459666924148338},
        {-0.86113631159405258, -0.33998104358485626, 0.33998104358485626, 0.86113631159405258}};
    static constexpr double kShare[4][4] = {
        {1},
        {0.5, 0.5},
        {5.0 / 18, 8.0 / 18, 5.0 / 18},
        {0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693}};
    const auto order = [](double shift) { return shift < 0.005 ? 1 : shift < 0.1 ? 2 : shift < 0.25 ? 3 : 4; };
    const int nx = order(std::hypot(sx, tx)), ny = order(std::hypot(sy, ty));
    for (int b = 0; b < ny; ++b) {
        for (int a = 0; a < nx; ++a) {
            const double x = kAt[nx - 1][a], y = kAt[ny - 1][b];
            map.s = s + x * sx + y * sy - pass_.s;
            map.t = t + x * tx + y * ty - pass_.t;
            add_source(grid_, map, pass_.radius, lit, cell.share() * weight * kShare[nx - 1][a] * kShare[ny - 1][b],
                       cells_);
        }
    }
}

void LensletLight::Gathering::add_sampled(const LensletCell& cell, double rays_per_bin) {
    const double weight = pass_.power * cell.share() * cell.box.area();
    const int count = std::max(kMinRays, static_cast<int>(rays_per_bin * importance_ * cell.share() * cell.box.area()));
    double at[kAxes];
    first_point(cell, at);
    constexpr int kBatch = 128;
    CameraRay rays[kBatch];
    Arrival arrivals[kBatch];
    struct {
        double u, v, passes;
    } seen[kBatch];
    for (int done = 0; done < count; done += kBatch) {
        std::size_t batch = 0;
        for (int k = done; k < std::min(count, done + kBatch); ++k) {
            next_point(at);
            const double u = cell.box.u0 + at[2] * (cell.box.u1 - cell.box.u0),
                         v = cell.box.v0 + at[3] * (cell.box.v1 - cell.box.v0);
            const double x = cell.x + (2 * at[0] - 1) * cell.hx, y = cell.y + (2 * at[1] - 1) * cell.hy;
            const double passes = obstacles_.empty() ? 1 : obstacles_.transmission(x, y, u, v);
            if (passes == 0) continue;
            seen[batch] = {u, v, passes};
            rays[batch++] = ray_at(x, y, u, v);
        }
        trace_many(body_, {rays, batch}, arrivals, pass_.ghost);
        for (std::size_t k = 0; k < batch; ++k) {
            if (!(arrivals[k].weight > 0)) continue;
            double s = 0, t = 0;
            camera_.to_camera(arrivals[k].u, arrivals[k].v, s, t);
            s -= pass_.s, t -= pass_.t;
            if (s * s + t * t >= pass_.radius * pass_.radius) continue;
            cells_[grid_.row(seen[k].v) * grid_.i + grid_.column(seen[k].u)] +=
                seen[k].passes * arrivals[k].weight * weight / count;
        }
    }
}

}  // namespace hord::sim
