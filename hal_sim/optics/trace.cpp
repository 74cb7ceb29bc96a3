#include "hal_sim/optics/trace.h"

#include <algorithm>

#include "hal_sim/optics/exact_math.h"
#include "hal_sim/optics/refraction.h"

namespace hord::sim {
namespace {

constexpr int kMaxCrossings = 16;
constexpr double kLeast = 1e-12;  // of the light: what is left of less is lost
constexpr double kClose = 1e-6;  // of the body's size: larger than any crossing_error() here

std::uint64_t mix(std::uint64_t path, std::uint64_t step) { return (path ^ (step + 1)) * 0x9E3779B97F4A7C15ULL + (path >> 29); }

// Distance along the ray to where it has left the box for good; negative when it never meets it.
double leaves_box(const Body& body, const Ray& ray) {
    double in = 0, out = kNever;
    const auto slab = [&](double o, double d, double low, double high) {
        if (d == 0) {
            if (o < low || o > high) out = -1;
            return;
        }
        const double a = (low - o) / d, b = (high - o) / d;
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
        path = mix(path, 1000 + k);
    }
}

// Follows the ray until it has left the body for good; false when it is lost on the way. `kLosses`: light may be lost at faces or
// in glass, or be a ghost; what no scene names is not even asked for.
template <bool kLosses>
bool follow(const Body& body, Ray& ray, double& weight, std::uint64_t& path, Way* way, [[maybe_unused]] Ghost ghost = {}) {
    double leaves = leaves_box(body, ray);
    if (way) *way = Way{};
    const auto note = [&](const Vec3& point, bool in_part) {
        if (!way || way->count == Way::kMaxPoints) return;
        way->points[way->count] = point;
        way->in_part[way->count++] = in_part;
    };
    note(ray.origin, false);
    if (leaves < 0) {
        if (ghost.is_one()) return false;
        note(ray.origin + (2 * (body.high.z - body.low.z)) * ray.direction, false);
        return true;
    }

    std::uint64_t state = 0, standing_on = 0;
    const std::size_t count = body.surfaces.size();
    for (std::size_t s = 0; s < count; ++s) state |= std::uint64_t{is_inside(body.surfaces[s], ray.origin)} << s;
    std::uint8_t medium = body.medium(state);
    if (medium != 0) leaves = kNever;

    [[maybe_unused]] int faces = 0;  // met, between media of different index
    double next[Body::kMaxSurfaces];
    for (int step = 0;; ++step) {
        std::size_t first = 0;
        double t = kNever;
        for (std::size_t s = 0; s < count; ++s) {
            next[s] = next_crossing(body.surfaces[s], ray, ((state >> s) & 1U) != 0, ((standing_on >> s) & 1U) != 0);
            if (next[s] < t) t = next[s], first = s;
        }
        if (t > leaves) {
            if (kLosses && faces <= ghost.second) return false;
            break;
        }
        if (step == kMaxCrossings) return false;
        // Faces that coincide, within the bounds on both, are crossed as one.
        std::uint64_t crossed = std::uint64_t{1} << first;
        for (std::size_t s = 0; s < count; ++s) {
            if (s == first || next[s] - t > kClose * body.size) continue;  // far from it: no need to work out the bounds
            const double errors = crossing_error(body.surfaces[s], ray, next[s]) + crossing_error(body.surfaces[first], ray, t);
            if (next[s] - t <= errors) crossed |= std::uint64_t{1} << s;
        }
        if (!body.discs.empty()) pass_discs(body, ray, t, weight, path);

        const std::uint8_t beyond = body.medium(state ^ crossed);
        const double index_before = body.index(medium), index_after = body.index(beyond);
        const Foot foot = foot_of(body.surfaces[first], ray.origin + t * ray.direction);
        ray.origin = foot.point;
        standing_on = crossed;
        note(ray.origin, medium != 0);
        bool through = true;
        if constexpr (kLosses) {
            if (body.absorbs && body.absorption(medium) > 0) weight *= exact::exp(-body.absorption(medium) * t);
            if (weight < kLeast) return false;
        }
        if (index_before != index_after) {
            Refraction bent = refract(ray.direction, foot.normal, index_before, index_after);
            if constexpr (kLosses) {
                const double passes = body.fresnel ? fresnel_transmission(bent, index_before, index_after) : 1;
                const int face = faces++;
                if (face == ghost.first || face == ghost.second) {
                    if (bent.reflected) return false;  // all of it: the way of another ray
                    weight *= 1 - passes;
                    bent.direction = unit(ray.direction - (2 * dot(ray.direction, foot.normal)) * foot.normal);
                    bent.reflected = true;
                } else if (!bent.reflected) {
                    weight *= passes;
                }
            }
            ray.direction = bent.direction;
            path = mix(path, 2 * first + (bent.reflected ? 1 : 0));
            through = !bent.reflected;
        }
        if (through) {
            state ^= crossed;
            const bool out = medium != 0 && beyond == 0;
            medium = beyond;
            if (out && body.convex) {
                if (kLosses && faces <= ghost.second) return false;
                leaves = 0;
                break;
            }
        }
        leaves = medium == 0 ? leaves_box(body, ray) : kNever;
    }
    if (!body.discs.empty()) pass_discs(body, ray, kNever, weight, path);
    if (way) note(ray.origin + (leaves > 0 && leaves < kNever ? leaves : body.size) * ray.direction, false);
    return true;
}

}  // namespace

Arrival trace(const Body& body, const CameraRay& from, Way* way, Ghost ghost) {
    Arrival arrival{from.u, from.v, from.x, from.y, 1, kFreePath};
    const double start = body.high.z;
    Ray ray{{from.x + from.u * start, from.y + from.v * start, start}, unit({-from.u, -from.v, -1})};
    const bool goes = body.fresnel || body.absorbs ? follow<true>(body, ray, arrival.weight, arrival.path, way, ghost)
                                                   : follow<false>(body, ray, arrival.weight, arrival.path, way);
    if (!goes || ray.direction.z >= 0) return {};
    if (arrival.path != kFreePath) {
        arrival.u = ray.direction.x / ray.direction.z;
        arrival.v = ray.direction.y / ray.direction.z;
        arrival.x = ray.origin.x - arrival.u * ray.origin.z;
        arrival.y = ray.origin.y - arrival.v * ray.origin.z;
    }
    return arrival;
}

Landing shine(const Body& body, double x, double y, Way* way) {
    Landing landing{x, y, 0, 0, 1, kFreePath};
    Ray ray{{x, y, body.low.z}, {0, 0, 1}};
    const bool goes = body.fresnel || body.absorbs ? follow<true>(body, ray, landing.weight, landing.path, way)
                                                   : follow<false>(body, ray, landing.weight, landing.path, way);
    if (!goes || ray.direction.z <= 0) return {};
    landing.u = ray.direction.x / ray.direction.z;
    landing.v = ray.direction.y / ray.direction.z;
    landing.x = ray.origin.x - landing.u * ray.origin.z;
    landing.y = ray.origin.y - landing.v * ray.origin.z;
    return landing;
}

}  // namespace hord::sim
