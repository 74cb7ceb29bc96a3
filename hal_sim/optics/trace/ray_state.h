// The state of one ray inside the body. For trace.cpp and trace_many.cpp only.
#pragma once

#include <algorithm>

#include "hal_sim/optics/scene/exact_math.h"
#include "hal_sim/optics/trace/trace.h"

namespace hord::sim {

// Crossings after which a ray is lost. A ray that is never reflected crosses each convex surface at most twice; the
// rest is for reflections.
inline int max_crossings(const Body& body) { return std::max(16, 2 * static_cast<int>(body.surfaces.size()) + 4); }
constexpr double kMinWeight = 1e-12;  // share of the light; a ray with less is lost
constexpr double kCoincident = 1e-6;  // of the body's size; above every crossing_error() here

// A path is a hash of what the ray meets, in order; kMirrored, once set, stays set. Path: a number or a vector.
constexpr std::uint64_t disc_step(std::size_t disc) { return 1000 + disc; }
constexpr std::uint64_t surface_step(std::size_t surface, bool reflected) {
    return 2 * surface + (reflected ? kMirrored | 1 : 0);
}
template <class Path>
[[gnu::always_inline]] constexpr inline Path extend_path(const Path& path, std::uint64_t step) {
    return (((path ^ (step + 1)) * 0x9E3779B97F4A7C15ULL + (path >> 29)) & ~kMirrored) | ((path | step) & kMirrored);
}

// Between two crossings of surfaces.
struct RayState {
    Ray ray;
    double weight = 1;
    std::uint64_t path = kFreePath;
    std::uint64_t inside_bits = 0;  // bit s: the ray is inside surface s
    std::uint64_t on_bits = 0;      // bit s: the ray has just met surface s
    std::uint8_t medium = 0;
    double leaves = kNever;   // distance to where it leaves the box for good, if it meets nothing before
    int step = 0, faces = 0;  // crossings; faces between media of different index
};

// Follows the ray until it has left the body for good; false if it is lost. Updates `state`.
bool continue_trace(const Body& body, RayState& state, RayPolyline* polyline, Ghost ghost);

// The result for a ray that has left the body; `from` is where it started.
inline Arrival arrival_of(const RayState& state, const CameraRay& from) {
    const Vec3 &o = state.ray.origin, &d = state.ray.direction;
    if (d.z >= 0) return {};
    if (state.path == kFreePath) return {from.u, from.v, from.x, from.y, state.weight, kFreePath};
    const double u = d.x / d.z, v = d.y / d.z;
    return {u, v, o.x - u * o.z, o.y - v * o.z, state.weight, state.path};
}

// trace() without the body's waviness.
Arrival trace_even(const Body& body, const CameraRay& from, RayPolyline* polyline, Ghost ghost);

// The deflection by the body's waviness where a ray or light crosses the measurement plane; false if it meets nothing.
inline bool waviness_at(const Body& body, double x, double y, std::uint64_t path, double& u, double& v) {
    const Body::Wave& wave = body.wave;
    if ((wave.u == 0 && wave.v == 0) || path == 0 || path == kFreePath) return false;
    double sine = 0, cosine = 1;
    exact::sin_cos(wave.kx * x + wave.ky * y + wave.phase, sine, cosine);
    u = wave.u * cosine;
    v = wave.v * cosine;
    return true;
}
// The ray is followed backwards: at the source it has the slope from before the deflection.
inline void add_waviness(const Body& body, const CameraRay& from, Arrival& arrival) {
    double u = 0, v = 0;
    if (!waviness_at(body, from.x, from.y, arrival.path, u, v)) return;
    arrival.u -= u;
    arrival.v -= v;
}

}  // namespace hord::sim
