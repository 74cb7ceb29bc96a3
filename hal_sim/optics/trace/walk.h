// One ray on its way through the body, for trace.cpp and trace_many.cpp only.
#pragma once

#include "hal_sim/optics/trace/trace.h"

namespace hord::sim {

constexpr int kMaxCrossings = 16;
constexpr double kMin = 1e-12;   // of the light: what is left of less is lost
constexpr double kClose = 1e-6;  // of the body's size: larger than any crossing_error() here

// A path by what it meets, one after the other; of numbers or of lanes of them. Once set, kMirrored stays.
constexpr std::uint64_t met_disc(std::size_t disc) { return 1000 + disc; }
constexpr std::uint64_t met_surface(std::size_t surface, bool reflected) {
    return 2 * surface + (reflected ? kMirrored | 1 : 0);
}
template <class Path>
[[gnu::always_inline]] constexpr inline Path mix(const Path& path, std::uint64_t step) {
    return (((path ^ (step + 1)) * 0x9E3779B97F4A7C15ULL + (path >> 29)) & ~kMirrored) | ((path | step) & kMirrored);
}

// Between two crossings.
struct Walk {
    Ray ray;
    double weight = 1;
    std::uint64_t path = kFreePath;
    std::uint64_t state = 0, standing_on = 0;  // surfaces that it is inside of, and that it has just met
    std::uint8_t medium = 0;
    double leaves = kNever;   // where it has left the box for good, when it meets nothing before
    int step = 0, faces = 0;  // crossings; faces between media of different index
};

// Goes on until the ray has left the body for good; false when it is lost. `leaves` is then where it was last looked
// at.
bool go_on(const Body& body, Walk& walk, Way* way, Ghost ghost);

// What is known of a ray that has left, by where it came from.
inline Arrival arrival_of(const Walk& walk, const CameraRay& from) {
    const Vec3 &o = walk.ray.origin, &d = walk.ray.direction;
    if (d.z >= 0) return {};
    if (walk.path == kFreePath) return {from.u, from.v, from.x, from.y, walk.weight, kFreePath};
    const double u = d.x / d.z, v = d.y / d.z;
    return {u, v, o.x - u * o.z, o.y - v * o.z, walk.weight, walk.path};
}

}  // namespace hord::sim
