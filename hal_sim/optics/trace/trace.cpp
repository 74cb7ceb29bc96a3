#include "hal_sim/optics/trace/trace.h"

#include <algorithm>

#include "hal_sim/optics/scene/exact_math.h"
#include "hal_sim/optics/trace/ray_state.h"
#include "hal_sim/optics/trace/refraction.h"

namespace hord::sim {
namespace {

// Distance along the ray to where it leaves the box for good; negative if it never meets the box.
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

// Attenuates the light by the discs between the ray's origin and distance `to`.
void pass_discs(const Body& body, const Ray& ray, double to, double& weight, std::uint64_t& path) {
    for (std::size_t k = 0; k < body.discs.size(); ++k) {
        const Disc& disc = body.discs[k];
        const double t = (disc.centre.z - ray.origin.z) / ray.direction.z;
        if (!(t >= 0 && t < to)) continue;
        const double x = ray.origin.x + t * ray.direction.x - disc.centre.x;
        const double y = ray.origin.y + t * ray.direction.y - disc.centre.y;
        if (x * x + y * y >= disc.radius * disc.radius) continue;
        weight *= disc.transmission;
        path = extend_path(path, disc_step(k));
    }
}

void add_corner(RayPolyline* polyline, const Vec3& point, bool in_part) {
    if (!polyline || polyline->count == RayPolyline::kMaxPoints) return;
    polyline->points[polyline->count] = point;
    polyline->in_part[polyline->count++] = in_part;
}

// kLosses: the scene has absorption, Fresnel losses or ghosts; without them their code is compiled out.
template <bool kLosses>
bool follow(const Body& body, RayState& state, RayPolyline* polyline, [[maybe_unused]] Ghost ghost) {
    Ray& ray = state.ray;
    const std::size_t count = body.surfaces.size();
    const int most = max_crossings(body);
    double next[Body::kMaxSurfaces];
    for (;; ++state.step) {
        std::size_t first = 0;
        double t = kNever;
        for (std::size_t s = 0; s < count; ++s) {
            next[s] = next_crossing(body.surfaces[s], ray, ((state.inside_bits >> s) & 1U) != 0,
                                    ((state.on_bits >> s) & 1U) != 0);
            if (next[s] < t) t = next[s], first = s;
        }
        if (t > state.leaves) {
            if (kLosses && state.faces <= ghost.second) return false;
            break;
        }
        if (state.step == most || !(t < kNever)) return false;  // never leaves: caused by rounding only
        // Faces that coincide within their error bounds are crossed together.
        std::uint64_t crossed = std::uint64_t{1} << first;
        for (std::size_t s = 0; s < count; ++s) {
            if (s == first || next[s] - t > kCoincident * body.size) continue;  // far away: skips the bounds
            const double errors =
                crossing_error(body.surfaces[s], ray, next[s]) + crossing_error(body.surfaces[first], ray, t);
            if (next[s] - t <= errors) crossed |= std::uint64_t{1} << s;
        }
        if (!body.discs.empty()) pass_discs(body, ray, t, state.weight, state.path);

        const std::uint8_t beyond = body.medium(state.inside_bits ^ crossed);
        const double index_before = body.index(state.medium), index_after = body.index(beyond);
        const Foot foot = foot_of(body.surfaces[first], ray.origin + t * ray.direction);
        ray.origin = foot.point;
        state.on_bits = crossed;
        add_corner(polyline, ray.origin, state.medium != 0);
        bool through = true;
        if constexpr (kLosses) {
            if (body.absorbs && body.absorption(state.medium) > 0)
                state.weight *= exact::exp(-body.absorption(state.medium) * t);
            if (state.weight < kMinWeight) return false;
        }
        if (index_before != index_after) {
            Refraction bent = refract(ray.direction, foot.normal, index_before, index_after);
            if constexpr (kLosses) {
                const double passes = body.fresnel ? fresnel_transmission(bent, index_before, index_after) : 1;
                const int face = state.faces++;
                if (face == ghost.first || face == ghost.second) {
                    if (bent.reflected) return false;  // total reflection splits no light
                    state.weight *= 1 - passes;
                    bent.direction = mirrored(ray.direction, foot.normal);
                    bent.reflected = true;
                } else if (!bent.reflected) {
                    state.weight *= passes;
                }
            }
            ray.direction = bent.direction;
            state.path = extend_path(state.path, surface_step(first, bent.reflected));
            through = !bent.reflected;
        }
        if (through) {
            state.inside_bits ^= crossed;
            const bool out = state.medium != 0 && beyond == 0;
            state.medium = beyond;
            if (out && body.convex) {
                if (kLosses && state.faces <= ghost.second) return false;
                state.leaves = 0;
                break;
            }
        }
        state.leaves = state.medium == 0 ? leaves_box(body, ray) : kNever;
    }
    if (!body.discs.empty()) pass_discs(body, ray, kNever, state.weight, state.path);
    add_corner(polyline,
               ray.origin + (state.leaves > 0 && state.leaves < kNever ? state.leaves : body.size) * ray.direction,
               false);
    return true;
}

// Follows a ray that starts outside the box; false if it is lost.
bool pass(const Body& body, RayState& state, RayPolyline* polyline, Ghost ghost) {
    const Ray& ray = state.ray;
    if (polyline) *polyline = RayPolyline{};
    add_corner(polyline, ray.origin, false);
    state.leaves = leaves_box(body, ray);
    if (state.leaves < 0) {
        if (ghost.is_one() && body.has_losses()) return false;
        add_corner(polyline, ray.origin + (2 * (body.high.z - body.low.z)) * ray.direction, false);
        return true;
    }
    for (std::size_t s = 0; s < body.surfaces.size(); ++s)
        state.inside_bits |= std::uint64_t{is_inside(body.surfaces[s], ray.origin)} << s;
    state.medium = body.medium(state.inside_bits);
    if (state.medium != 0) state.leaves = kNever;
    return continue_trace(body, state, polyline, ghost);
}

}  // namespace

bool continue_trace(const Body& body, RayState& state, RayPolyline* polyline, Ghost ghost) {
    return body.has_losses() ? follow<true>(body, state, polyline, ghost) : follow<false>(body, state, polyline, {});
}

Arrival trace_even(const Body& body, const CameraRay& from, RayPolyline* polyline, Ghost ghost) {
    const double start = body.high.z;
    RayState state;
    state.ray = {{from.x + from.u * start, from.y + from.v * start, start}, unit({-from.u, -from.v, -1})};
    return pass(body, state, polyline, ghost) ? arrival_of(state, from) : Arrival{};
}

Arrival trace(const Body& body, const CameraRay& from, RayPolyline* polyline, Ghost ghost) {
    Arrival arrival = trace_even(body, from, polyline, ghost);
    add_waviness(body, from, arrival);
    return arrival;
}

Landing shine(const Body& body, double x, double y, RayPolyline* polyline) {
    RayState state;
    state.ray = {{x, y, body.low.z}, {0, 0, 1}};
    const Vec3 &o = state.ray.origin, &d = state.ray.direction;
    if (!pass(body, state, polyline, {}) || d.z <= 0) return {};
    const double u = d.x / d.z, v = d.y / d.z;
    Landing landing{o.x - u * o.z, o.y - v * o.z, u, v, state.weight, state.path};
    double more_u = 0, more_v = 0;
    if (waviness_at(body, x, y, state.path, more_u, more_v)) landing.u += more_u, landing.v += more_v;
    return landing;
}

}  // namespace hord::sim
