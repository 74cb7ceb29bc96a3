#include "hal_sim/optics/camera/lenslet_light.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace hord::sim {
namespace {

constexpr double kSampled = 0.25;      // share of a bin: a smaller cell that is not smooth is sampled
constexpr double kSampledNear = 0.01;  // the same, next to a defect
constexpr double kRays = 500;          // a bin, in sampled cells
constexpr double kRaysNear = 3000;     // the same, next to a defect
constexpr double kSampledEdge = 0.05;  // the same, where the edge of an obstacle runs through it
constexpr double kRaysEdge = 2000;
constexpr int kFewestRays = 16;
constexpr double kGhostly =
    0.01;  // how much less closely ghosts are looked at: they hold less than a hundredth of the light
constexpr double kStraight = 0.01;  // bins: bent more than this besides linearly, a cell is not smooth
constexpr double kEven = 0.01;      // the same for the light's weight
constexpr double kUniform = 1e-4;   // the same, for a cell whose box is wider than the light in it
constexpr double kShift = 0.7;      // bins: a smooth cell over which the source moves further is halved
constexpr double kFocus = 1.2;      // bins: half sides of a box of slopes in which edges are looked for
constexpr int kMirrorRays =
    256;  // of a lenslet on a rim, for light reflected by a wall; so many times, where there is some
constexpr int kMirrorBatches = 4;
constexpr double kMirrorNear = 0.5;  // bins: this close to the source, they say that there is some

// The additive recurrence of the root of x^5 = x + 1: evenly spread points in four dimensions (M. Roberts, "The
// unreasonable effectiveness of quasirandom sequences", 2018).
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

struct Cell {
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
struct Samples {
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
    // How far the source moves over half the cell.
    [[nodiscard]] double shift() const {
        return std::hypot(effect(s, 0), effect(t, 0)) + std::hypot(effect(s, 1), effect(t, 1));
    }
    // What half a side of the cell along an axis changes.
    [[nodiscard]] double effect(const double* of, int axis) const {
        double sum = 0;
        for (int k = 0; k < kCorners; ++k) sum += kSigns[k][axis] * of[k];
        return sum / kCorners;
    }
};

bool is_smooth(const Samples& samples) {
    return samples.bent() < kStraight && samples.uneven() < kEven && samples.shift() < kShift;
}

// Where a cell's sequence of points begins: elsewhere in every cell, so that their errors are not alike and do not add
// up.
void shifted_start(const Cell& cell, double (&at)[kAxes]) {
    const auto bits = [](double value) { return std::bit_cast<std::uint64_t>(value); };
    std::uint64_t hash = 0;
    for (const double value : {cell.x, cell.y, cell.box.u0, cell.box.v0, cell.box.u1}) {
        hash = (hash ^ bits(value)) * 0x9E3779B97F4A7C15ULL;
        hash ^= hash >> 29;
    }
    for (double& x : at) {
        hash *= 0xBF58476D1CE4E5B9ULL;
        hash ^= hash >> 31;
        x = static_cast<double>(hash >> 11) * 0x1p-53;
    }
}

void step(double (&at)[kAxes]) {
    for (int a = 0; a < kAxes; ++a) {
        at[a] += kStep[a];
        if (at[a] >= 1) at[a] -= 1;
    }
}

// As many places of the part as keep it from moving more than a quarter of a lenslet between them.
int places_of(const Motion& motion, double pitch_mm) {
    const double way = std::hypot(motion.way_x_mm(), motion.way_y_mm());
    return way > 0 ? std::max(2, static_cast<int>(std::ceil(4 * way / pitch_mm))) : 1;
}

// An even spectrum by Gauss and Legendre's three wavelengths.
struct Line {
    double wavelength_nm, share;
};
std::vector<Line> spectrum_of(const Collimator& source) {
    if (!(source.bandwidth_nm > 0)) return {{source.wavelength_nm, 1}};
    const double off = 0.77459666924148338 * 0.5 * source.bandwidth_nm;
    return {{source.wavelength_nm - off, 5.0 / 18},
            {source.wavelength_nm, 8.0 / 18},
            {source.wavelength_nm + off, 5.0 / 18}};
}

}  // namespace

LensletLight::LensletLight(const Scene& scene, const SlopeGrid& grid)
    : extents_(scene.camera.extents), camera_(scene), obstacles_(scene), bin_rad_(scene.camera.bin_pitch_rad) {
    const auto optics_at = [&](double wavelength_nm) {
        // Without dispersion and diffraction all wavelengths are alike.
        const bool same = !is_dispersive(scene) && !scene.effects.diffraction;
        for (const auto& known : optics_) {
            if (same || known->wavelength_nm == wavelength_nm) return known.get();
        }
        auto made = std::make_unique<Optics>(
            Optics{wavelength_nm, body_of(scene, true, wavelength_nm), body_of(scene, false, wavelength_nm), nullptr});
        made->clean.low = made->body.low;
        made->clean.high = made->body.high;
        if (scene.effects.diffraction) {
            const double first_zero = wavelength_nm * 1e-6 / camera_.pitch_mm() / bin_rad_;
            made->diffraction = std::make_unique<Diffraction>(first_zero, grid.step, std::max(grid.i, grid.j));
        }
        optics_.push_back(std::move(made));
        return optics_.back().get();
    };
    std::vector<Ghost> ways{{}};
    constexpr int kFaces = 5;  // light reflected at later ones is not followed
    if (scene.effects.ghosts) {
        for (int first = 1; first < kFaces; ++first) {
            for (int second = first + 1; second <= kFaces; ++second) ways.push_back({first, second});
        }
    }
    const int places = places_of(scene.motion, camera_.pitch_mm());
    for (const Collimator& source : collimators_of(scene)) {
        for (const Line& line : spectrum_of(source)) {
            const Optics* const optics = optics_at(line.wavelength_nm);
            for (int k = 0; k < places; ++k) {
                const double moved = (k + 0.5) / places - 0.5;
                for (const Ghost& way : ways) {
                    passes_.push_back({optics, source.direction_x_rad / bin_rad_, source.direction_y_rad / bin_rad_,
                                       source.radius_rad / bin_rad_, source.power * line.share / places,
                                       moved * scene.motion.way_x_mm(), moved * scene.motion.way_y_mm(), way});
                }
            }
        }
    }
    std::stable_sort(passes_.begin(), passes_.end(),
                     [](const Pass& a, const Pass& b) { return a.optics->wavelength_nm < b.optics->wavelength_nm; });
}

// One pass over one lenslet.
class LensletLight::Gathering {
  public:
    Gathering(const LensletLight& in, const Pass& pass, const SlopeGrid& grid, const Cell& whole, double* cells)
        : camera_(in.camera_), obstacles_(in.obstacles_), body_(pass.optics->body), clean_(pass.optics->clean),
          pass_(pass), bin_rad_(in.bin_rad_), importance_(pass.ghost.is_one() ? kGhostly : 1), grid_(grid),
          whole_(whole), cells_(cells) {}

    void collect(const std::vector<const Feature*>& near) { collect(whole_, near); }

  private:
    struct Mirror {
        std::uint64_t path;
        SlopeBox lit;
        int rays;
    };
    void collect(const Cell& cell, const std::vector<const Feature*>& near);
    void look_for_mirrors(const Cell& whole);
    [[nodiscard]] CameraRay ray_at(double x, double y, double u, double v) const {
        return camera_.to_part(x - pass_.shift_x, y - pass_.shift_y, u, v);
    }
    [[nodiscard]] Samples sample(const Cell& cell) const;
    void keep_near(const Cell& cell, const std::vector<const Feature*>& before,
                   std::vector<const Feature*>& near) const;
    [[nodiscard]] SlopeBox shrink(const Cell& cell, const Samples& samples) const;
    void add_smooth(const Cell& cell, const SlopeBox& lit, const Samples& samples, double transmission);
    void add_sampled(const Cell& cell, double rays_per_bin);
    void halve(const Cell& cell, int axis, const std::vector<const Feature*>& near);

    const CameraGeometry& camera_;
    const Obstacles& obstacles_;
    const Body& body_;
    const Body& clean_;
    const Pass& pass_;
    double bin_rad_, importance_;
    const SlopeGrid& grid_;
    const Cell& whole_;
    double* cells_;
    bool looked_ = false;
    std::vector<Mirror> mirrors_;
};

void LensletLight::collect(const CameraGeometry::Place& lenslet, const SlopeGrid& grid, const SlopeBox& range,
                           double* cells) const {
    std::fill_n(cells, grid.cells(), 0.0);
    const Cell whole{lenslet.x_mm,      lenslet.y_mm, lenslet.half_x_mm,
                     lenslet.half_y_mm, range,        4 * lenslet.half_x_mm * lenslet.half_y_mm};
    std::vector<const Feature*> near;
    std::vector<double> fine;
    for (std::size_t k = 0; k < passes_.size(); ++k) {
        const Pass& pass = passes_[k];
        near.clear();
        for (const Feature& feature : pass.optics->body.features) near.push_back(&feature);
        if (!pass.optics->diffraction) {
            Gathering(*this, pass, grid, whole, cells).collect(near);
            continue;
        }
        const SlopeGrid sharp = pass.optics->diffraction->fine(grid);
        if (k == 0 || passes_[k - 1].optics != pass.optics) fine.assign(static_cast<std::size_t>(sharp.cells()), 0.0);
        Gathering(*this, pass, sharp, whole, fine.data()).collect(near);
        if (k + 1 == passes_.size() || passes_[k + 1].optics != pass.optics)
            pass.optics->diffraction->blur(grid, fine.data(), cells);
    }
}

void LensletLight::collect(int m, int n, double* bins) const {
    const SlopeGrid grid = SlopeGrid::of(extents_);
    collect(camera_.place_of(m, n), grid, grid.box(), bins);
}

Samples LensletLight::Gathering::sample(const Cell& cell) const {
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
    Samples out;
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

// Those features that a ray of the cell may meet, judged by the clean part's way of its central ray.
void LensletLight::Gathering::keep_near(const Cell& cell, const std::vector<const Feature*>& before,
                                        std::vector<const Feature*>& near) const {
    if (before.empty()) return;
    RayPolyline way;
    trace(clean_, ray_at(cell.x, cell.y, cell.u(), cell.v()), &way, pass_.ghost);
    const double across = std::hypot(cell.hx, cell.hy), aslant = std::hypot(cell.hu(), cell.hv()) * bin_rad_;
    // Glass moves a ray's foot on the measurement plane by its slope, too.
    const double foot = (1 - 1 / body_.part_index()) * std::max(std::abs(body_.low.z), std::abs(body_.high.z));
    for (const Feature* feature : before) {
        const double depth = std::max(std::abs(feature->from.z), std::abs(feature->to.z)) + feature->reach + foot;
        const double reach = feature->reach + 1.5 * (across + aslant * depth);
        for (int k = 1; k < way.count; ++k) {
            if (distance_of_segments(way.points[k - 1], way.points[k], *feature) >= reach) continue;
            near.push_back(feature);
            break;
        }
    }
}

// The part of the box that some path may bring to the source, by how far each path bends.
SlopeBox LensletLight::Gathering::shrink(const Cell& cell, const Samples& samples) const {
    const auto lit = [&](double u0, double u1, double v0, double v1) {
        const double r = pass_.radius, s = pass_.s, t = pass_.t;
        return SlopeBox{std::max(cell.box.u0, s - u1 - r), std::min(cell.box.u1, s - u0 + r),
                        std::max(cell.box.v0, t - v1 - r), std::min(cell.box.v1, t - v0 + r)};
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
    // Light that meets nothing may pass any edge; as seen, it comes from where the camera puts it.
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
        // Seen by a few rays only, a path may reach further than they say.
        const double mu = 0.3 + 0.5 * (u1 - u0), mv = 0.3 + 0.5 * (v1 - v0);
        add(lit(u0 - mu, u1 + mu, v0 - mv, v1 + mv));
    }
    for (const Mirror& mirror : mirrors_) {
        add({std::max(cell.box.u0, mirror.lit.u0), std::min(cell.box.u1, mirror.lit.u1),
             std::max(cell.box.v0, mirror.lit.v0), std::min(cell.box.v1, mirror.lit.v1)});
    }
    return all;
}

// Next to a wall along the light, some is reflected by it: a way between the free light and the glass's, too narrow for
// nine rays, and in slopes far from theirs, for a mirror turns with the slope that it is seen with. Once a lenslet, and
// not near defects, whose cells are small anyway.
void LensletLight::Gathering::look_for_mirrors(const Cell& whole) {
    double u[kMirrorRays], v[kMirrorRays], at[kAxes];
    CameraRay rays[kMirrorRays];
    Arrival arrivals[kMirrorRays];
    shifted_start(whole, at);
    const double near = pass_.radius + kMirrorNear, far = pass_.radius + 4 * kMirrorNear;
    bool any = true;  // further off, where it takes fewer rays to see one
    for (int batch = 0; batch < kMirrorBatches && any; ++batch) {
        for (int k = 0; k < kMirrorRays; ++k) {
            step(at);
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

void LensletLight::Gathering::collect(const Cell& cell, const std::vector<const Feature*>& near_before) {
    std::vector<const Feature*> near;
    double lever = 0.5 * (body_.high.z - body_.low.z);
    const auto sides = [&](int axis) {  // how much of the part the cell's rays cover, along each axis
        return axis == 0 ? cell.hx : axis == 1 ? cell.hy : bin_rad_ * lever * (axis == 2 ? cell.hu() : cell.hv());
    };
    bool coarse = false;
    keep_near(cell, near_before, near);
    for (const Feature* feature : near) {
        lever = std::max(std::abs(feature->from.z), std::abs(feature->to.z));
        coarse = coarse || std::max(cell.hx, cell.hy) + std::max(sides(2), sides(3)) > feature->resolution;
    }
    const double weight = cell.share() * cell.box.area() * importance_;
    const bool small = weight < (near.empty() ? kSampled : kSampledNear);
    if (small && coarse) return add_sampled(cell, kRaysNear);
    if (coarse) {
        int axis = 0;
        for (int a = 1; a < kAxes; ++a) axis = sides(a) > sides(axis) ? a : axis;
        return halve(cell, axis, near);
    }

    const Samples samples = sample(cell);
    // Rays of different paths in a wide box may have missed a third path between them: first find the lit slopes.
    if (!samples.one_path && std::max(cell.hu(), cell.hv()) > kFocus)
        return halve(cell, cell.hu() >= cell.hv() ? 2 : 3, near);
    if (!samples.one_path && near.empty() && !looked_ && !pass_.ghost.is_one())
        looked_ = true, look_for_mirrors(whole_);
    const SlopeBox lit = shrink(cell, samples);
    if (lit.is_empty()) return;
    const double transmission = obstacles_.empty() ? 1 : obstacles_.transmission(cell.x, cell.y, cell.hx, cell.hy, lit);
    if (transmission == 0) return;
    const bool edge = transmission < 0;  // of an obstacle
    if (near.empty() && samples.one_path && !edge && samples.path[0] != kFreePath && is_smooth(samples) &&
        samples.uneven() < kUniform)
        return add_smooth(cell, lit, samples, transmission);
    if (lit.area() < 0.6 * cell.box.area()) {
        Cell narrower = cell;
        narrower.box = lit;
        return collect(narrower, near);
    }
    if (samples.one_path && !edge && is_smooth(samples)) return add_smooth(cell, lit, samples, transmission);
    if (edge ? weight < kSampledEdge : small)
        return add_sampled(cell, edge ? kRaysEdge : near.empty() ? kRays : kRaysNear);

    // Halve where the rays differ most: in the path they take, or in how far they are bent; the longest side at an
    // obstacle.
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
            difference =
                std::abs(difference) + 1e-3 * sides(a) / (sides(0) + sides(1));  // undecided: where it is widest
        }
        if (difference > most) most = difference, axis = a;
    }
    halve(cell, axis, near);
}

void LensletLight::Gathering::halve(const Cell& cell, int axis, const std::vector<const Feature*>& near) {
    Cell a = cell, b = cell;
    switch (axis) {
        case 0: a.hx = b.hx = 0.5 * cell.hx, a.x -= a.hx, b.x += b.hx; break;
        case 1: a.hy = b.hy = 0.5 * cell.hy, a.y -= a.hy, b.y += b.hy; break;
        case 2: a.box.u1 = b.box.u0 = cell.u(); break;
        default: a.box.v1 = b.box.v0 = cell.v(); break;
    }
    collect(a, near);
    collect(b, near);
}

void LensletLight::Gathering::add_smooth(const Cell& cell, const SlopeBox& lit, const Samples& samples,
                                         double transmission) {
    const double weight = pass_.power * transmission *
        (samples.weight[kCorners] + kCorners * samples.mean(samples.weight)) / (kCorners + 1);
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

void LensletLight::Gathering::add_sampled(const Cell& cell, double rays_per_bin) {
    const double weight = pass_.power * cell.share() * cell.box.area();
    const int count =
        std::max(kFewestRays, static_cast<int>(rays_per_bin * importance_ * cell.share() * cell.box.area()));
    double at[kAxes];
    shifted_start(cell, at);
    constexpr int kBatch = 128;
    CameraRay rays[kBatch];
    Arrival arrivals[kBatch];
    struct {
        double u, v, passes;
    } seen[kBatch];
    for (int done = 0; done < count; done += kBatch) {
        std::size_t batch = 0;
        for (int k = done; k < std::min(count, done + kBatch); ++k) {
            step(at);
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
