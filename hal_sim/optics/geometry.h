// Rays and surfaces in double precision, and where they meet.
//
// A ray knows on which side of every surface it is, and which surface it stands on; both come from the crossings it
// has made, never from a point a little further on. So there is no offset to choose: on the surface a ray has just
// crossed or been reflected from, the root t = 0 is known exactly and divided out, and elsewhere a crossing is as good
// as the bound given with it. Lengths in millimetres, but nothing depends on the unit.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#include "hal_sim/optics/scene.h"

namespace hord::sim {

constexpr Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
constexpr Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
constexpr Vec3 operator*(double k, const Vec3& a) { return {k * a.x, k * a.y, k * a.z}; }
constexpr double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline double length(const Vec3& a) { return std::sqrt(dot(a, a)); }
inline Vec3 unit(const Vec3& a) { return (1 / length(a)) * a; }

struct Ray {
    Vec3 origin;
    Vec3 direction;  // unit
};

// A closed or half-infinite convex region's boundary.
struct Surface {
    enum class Shape : std::uint8_t {
        plane,     // inside is where (p - point) . axis < 0: the axis points out
        sphere,    // centre `point`
        cylinder,  // endless, through `point` along `axis`
    };
    Shape shape = Shape::plane;
    Vec3 point;
    Vec3 axis{0, 0, 1};  // unit
    double radius = 0;
};

// Where a ray crosses a surface next, and how far off that may be. `t` is infinity when it never does.
struct Crossing {
    double t = std::numeric_limits<double>::infinity();
    double error = 0;  // |t - true t| <= error, for the ray as given (first-order bound)
};

bool is_inside(const Surface& surface, const Vec3& p);

// The next crossing at t >= 0 of a ray that is inside or outside (`inside`) and may start on the surface (`on_surface`:
// it has just crossed it, into the side told by `inside`, or been reflected on that side).
// Sphere: E. Haines et al., "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems (2019), chapter 7.
Crossing next_crossing(const Surface& surface, const Ray& ray, bool inside, bool on_surface);

// The point of the surface nearest to a computed crossing, and the outward unit normal there.
Vec3 outward_normal(const Surface& surface, const Vec3& p);
Vec3 on_surface(const Surface& surface, const Vec3& p);

// Shortest distance from point c to the segment a..b.
double distance_to_segment(const Vec3& c, const Vec3& a, const Vec3& b);

}  // namespace hord::sim
