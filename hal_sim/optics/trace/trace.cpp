#include "hal_sim/optics/trace/trace.h"

#include <algorithm>

#include "hal_sim/optics/scene/exact_math.h"
#include "hal_sim/optics/trace/refraction.h"
#include "hal_sim/optics/trace/walk.h"

namespace hord::sim {
namespace {

// Distance along the ray to where it has left the box for good; negative when it never meets it.
double leaves_box(const Body& body, const Ray& ray) {
    double in = 0, out = kNever;
    const auto slab = [&](double o, double d, double low, double high) {
        if (d == 0) {
            if (o < low || o > high) out = -1;
            return;
        }
        const double per = 1 / d, a = (low - o) * per, b = (high - o) * per;
        in = std::max(in, std::min(a, b));
        out = std::min(out, std::max(a, b));
    };
    slab(ray.origin.x, ray.direction.x, body.low.x, body.high.x);
    slab(ray.origin.y, ray.direction.y, body.low.y, body.high.y);
    slab(ray.origin.z, ray.direction.z, body.low.z, body.high.z);
    return out >= in ? out : -1;
}

// Light that passes the discs between two points of the ray.
void pass_discs(const Body& body, const Ray& ray, double to, double& weight, std::uint64_t& path) {
    for (std::size_t k = 0; k < body.discs.size(); ++k) {
        const Disc& disc = body.discs[k];
        const double t = (disc.centre.z - ray.origin.z) / ray.direction.z;
        if (!(t >= 0 && t < to)) continue;
        const double x = ray.origin.x + t * ray.direction.x - disc.centre.x;
        const double y = ray.origin.y + t * ray.direction.y - disc.centre.y;
        if (x * x + y * y >= disc.radius * disc.radius) continue;
        weight *= disc.transmission;
        path = mix(path, met_disc(k));
    }
}

void note(Way* way, const Vec3& point, bool in_part) {
    if (!way || way->count == Way::kMaxPoints) return;
    way->points[way->count] = point;
    way->in_part[way->count++] = in_part;
}

// `kLosses`: light may be lost at faces or in glass, or be a ghost; what no scene names is not even asked for.
template <bool kLosses>
bool follow(const Body& body, Walk& walk, Way* way, [[maybe_unused]] Ghost ghost) {
    Ray& ray = walk.ray;
    const std::size_t count = body.surfaces.size();
    double next[Body::kMaxSurfaces];
    for (;; ++walk.step) {
        std::size_t first = 0;
        double t = kNever;
        for (std::size_t s = 0; s < count; ++s) {
            next[s] = next_crossing(body.surfaces[s], ray, ((walk.state >> s) & 1U) != 0,
                                    ((walk.standing_on >> s) & 1U) != 0);
            if (next[s] < t) t = next[s], first = s;
        }
        if (t > walk.leaves) {
            if (kLosses && walk.faces <= ghost.second) return false;
            break;
        }
        if (walk.step == kMaxCrossings || !(t < kNever)) return false;  // inside for ever: only by rounding
        // Faces that coincide, within the bounds on both, are crossed as one.
        std::uint64_t crossed = std::uint64_t{1} << first;
        for (std::size_t s = 0; s < count; ++s) {
            if (s == first || next[s] - t > kClose * body.size)
                continue;  // far from it: no need to work out the bounds
            const double errors =
                crossing_error(body.surfaces[s], ray, next[s]) + crossing_error(body.surfaces[first], ray, t);
            if (next[s] - t <= errors) crossed |= std::uint64_t{1} << s;
        }
        if (!body.discs.empty()) pass_discs(body, ray, t, walk.weight, walk.path);

        const std::uint8_t beyond = body.medium(walk.state ^ crossed);
        const double index_before = body.index(walk.medium), index_after = body.index(beyond);
        const Foot foot = foot_of(body.surfaces[first], ray.origin + t * ray.direction);
        ray.origin = foot.point;
        walk.standing_on = crossed;
        note(way, ray.origin, walk.medium != 0);
        bool through = true;
        if constexpr (kLosses) {
            if (body.absorbs && body.absorption(walk.medium) > 0)
                walk.weight *= exact::exp(-body.absorption(walk.medium) * t);
            if (walk.weight < kMin) return false;
        }
        if (index_before != index_after) {
            Refraction bent = refract(ray.direction, foot.normal, index_before, index_after);
            if constexpr (kLosses) {
                const double passes = body.fresnel ? fresnel_transmission(bent, index_before, index_after) : 1;
                const int face = walk.faces++;
                if (face == ghost.first || face == ghost.second) {
                    if (bent.reflected) return false;  // all of it: the way of another ray
                    walk.weight *= 1 - passes;
                    bent.direction = mirrored(ray.direction, foot.normal);
                    bent.reflected = true;
                } else if (!bent.reflected) {
                    walk.weight *= passes;
                }
            }
            ray.direction = bent.direction;
            walk.path = mix(walk.path, met_surface(first, bent.reflected));
            through = !bent.reflected;
        }
        if (through) {
            walk.state ^= crossed;
            const bool out = walk.medium != 0 && beyond == 0;
            walk.medium = beyond;
            if (out && body.convex) {
                if (kLosses && walk.faces <= ghost.second) return false;
                walk.leaves = 0;
                break;
            }
        }
        walk.leaves = walk.medium == 0 ? leaves_box(body, ray) : kNever;
    }
    if (!body.discs.empty()) pass_discs(body, ray, kNever, walk.weight, walk.path);
    note(way, ray.origin + (walk.leaves > 0 && walk.leaves < kNever ? walk.leaves : body.size) * ray.direction, false);
    return true;
}

// From outside the box on: false when the ray is lost on the way.
bool pass(const Body& body, Walk& walk, Way* way, Ghost ghost) {
    const Ray& ray = walk.ray;
    if (way) *way = Way{};
    note(way, ray.origin, false);
    walk.leaves = leaves_box(body, ray);
    if (walk.leaves < 0) {
        if (ghost.is_one() && body.has_losses()) return false;
        note(way, ray.origin + (2 * (body.high.z - body.low.z)) * ray.direction, false);
        return true;
    }
    for (std::size_t s = 0; s < body.surfaces.size(); ++s)
        walk.state |= std::uint64_t{is_inside(body.surfaces[s], ray.origin)} << s;
    walk.medium = body.medium(walk.state);
    if (walk.medium != 0) walk.leaves = kNever;
    return go_on(body, walk, way, ghost);
}

}  // namespace

bool go_on(const Body& body, Walk& walk, Way* way, Ghost ghost) {
    return body.has_losses() ? follow<true>(body, walk, way, ghost) : follow<false>(body, walk, way, {});
}

Arrival trace(const Body& body, const CameraRay& from, Way* way, Ghost ghost) {
    const double start = body.high.z;
    Walk walk;
    walk.ray = {{from.x + from.u * start, from.y + from.v * start, start}, unit({-from.u, -from.v, -1})};
    return pass(body, walk, way, ghost) ? arrival_of(walk, from) : Arrival{};
}

Landing shine(const Body& body, double x, double y, Way* way) {
    Walk walk;
    walk.ray = {{x, y, body.low.z}, {0, 0, 1}};
    const Vec3 &o = walk.ray.origin, &d = walk.ray.direction;
    if (!pass(body, walk, way, {}) || d.z <= 0) return {};
    const double u = d.x / d.z, v = d.y / d.z;
    return {o.x - u * o.z, o.y - v * o.z, u, v, walk.weight, walk.path};
}

}  // namespace hord::sim
