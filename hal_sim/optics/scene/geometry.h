// Intersections of rays and surfaces, in double precision.
//
// A ray carries the side of every surface that it is on, and the surface that it starts on. Both follow from its
// earlier crossings, never from a point moved by an offset: for the surface that a ray has just crossed or been
// reflected from, the root t = 0 is known exactly and divided out. The error of other crossings is crossing_error().
// Lengths are in mm, but nothing depends on the unit.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "hal_sim/optics/scene/scene.h"

namespace hord::sim {

constexpr Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
constexpr Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
constexpr Vec3 operator*(double k, const Vec3& a) { return {k * a.x, k * a.y, k * a.z}; }
constexpr double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
constexpr Vec3 cross(const Vec3& a, const Vec3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double length(const Vec3& a) { return std::sqrt(dot(a, a)); }
inline Vec3 unit(const Vec3& a) { return (1 / length(a)) * a; }

struct Ray {
    Vec3 origin;
    Vec3 direction;  // unit
};

constexpr double kNever = std::numeric_limits<double>::infinity();

// A rotation and a shift: turned about x, then y, then z, then moved.
struct Rigid {
    Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};  // the images of the axes
    Vec3 shift;
    [[nodiscard]] Vec3 turn(const Vec3& v) const { return v.x * x + v.y * y + v.z * z; }
    [[nodiscard]] Vec3 operator()(const Vec3& p) const { return turn(p) + shift; }
    [[nodiscard]] Rigid operator*(const Rigid& first) const {
        return {turn(first.x), turn(first.y), turn(first.z), (*this)(first.shift)};
    }
    static Rigid of(const Vec3& position, const Vec3& rotation_rad);
};

// An asphere's height over its vertex plane, by the squared distance w from its axis, s(w) = c w / (1 + sqrt(1 - (1 +
// k) c^2 w)) + a4 w^2 + a6 w^3 ...; beyond the rim it continues linearly in w, with the slope at the rim.
struct Asphere {
    double curvature = 0, conic = 0;
    std::vector<double> coefficients;   // of r^4, r^6, ... mm^-3, mm^-5, ...
    double rim = 0;                     // w
    double reach = kNever;              // from the vertex; crossings farther away are ignored
    double steepest = 0, sharpest = 0;  // bounds on |s'| and |s''|, set by done()
    void done();
    struct At {
        double height, slope;  // s, ds/dw
    };
    [[nodiscard]] At at(double w) const;

  private:
    [[nodiscard]] At on(double w) const;
};

// The boundary of a closed or half-infinite region. All but the asphere are convex.
struct Surface {
    enum class Shape : std::uint8_t {
        plane,     // inside is where (p - point) . axis < 0: the axis points out
        sphere,    // centre `point`
        cylinder,  // endless, through `point` along `axis`
        cone,      // one nappe from its apex `point` along `axis`; `radius` is the tangent of half its angle
        asphere,   // vertex `point`; inside is what lies lower along `axis`
    };
    Shape shape = Shape::plane;
    Vec3 point;
    Vec3 axis{0, 0, 1};  // unit
    double radius = 0;
    std::shared_ptr<const Asphere> asphere = nullptr;
};

bool is_inside(const Surface& surface, const Vec3& p);

constexpr double kAlongAxis = 1e-30;  // squared sine to a cylinder's axis below which the ray never reaches its wall

// Distance along the ray to the next crossing, >= 0, or kNever. `inside`: the side of the surface that the ray is on.
// `on_surface`: the ray starts on the surface; it has just crossed it to the side `inside`, or been reflected on that
// side. Sphere: E. Haines et al., "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems (2019),
// chapter 7.
inline double next_crossing(const Surface& surface, const Ray& ray, bool inside, bool on_surface);

// next_crossing of cones and aspheres. A cone's roots are those of its quadric that lie on its nappe. An asphere's is
// approached in steps that cannot pass it, by the bound on the second derivative along the ray, and that converge like
// Newton's.
double next_crossing_of_others(const Surface& surface, const Ray& ray, bool inside, bool on_surface);

// First-order error bound of next_crossing(): |t - true t| for the given ray.
double crossing_error(const Surface& surface, const Ray& ray, double t);

// The point of the surface nearest to a computed crossing, and the outward unit normal there.
struct Foot {
    Vec3 point, normal;
};
Foot foot_of(const Surface& surface, const Vec3& p);

// Shortest distance from point c to the segment a..b.
double distance_to_segment(const Vec3& c, const Vec3& a, const Vec3& b);

// The next crossing of a convex quadric a t^2 - 2 b t + c = 0, with gap = r^2 - (closest approach)^2 computed without
// cancellation.
inline double convex_crossing(double a, double b, double c, double gap, bool inside) {
    if (gap <= 0) return inside ? std::max(b / a, 0.0) : kNever;  // a tangent touches and does not enter
    const double root = std::sqrt(a * gap);
    if (inside) return std::max((b >= 0 ? (b + root) / a : c / (b - root)), 0.0);
    // The ray is outside by its state. A crossing behind it is real if the ray moves away, and rounding if it has just
    // arrived.
    if (b <= 0) return kNever;
    return std::max(c / (b + root), 0.0);
}

inline double next_crossing(const Surface& surface, const Ray& ray, bool inside, bool on_surface) {
    const Vec3 f = ray.origin - surface.point;
    const Vec3& d = ray.direction;
    if (surface.shape == Surface::Shape::plane) {
        const double towards = dot(d, surface.axis);
        if (on_surface || (inside ? towards <= 0 : towards >= 0)) return kNever;
        return std::max(-dot(f, surface.axis) / towards, 0.0);
    }
    if (surface.shape >= Surface::Shape::cone) return next_crossing_of_others(surface, ray, inside, on_surface);
    if (on_surface && !inside) return kNever;  // a convex solid is left once
    const double r = surface.radius;
    if (surface.shape == Surface::Shape::sphere) {
        const double b = -dot(f, d);
        if (on_surface) return std::max(2 * b, 0.0);
        const Vec3 closest = f + b * d;
        return convex_crossing(1, b, dot(f, f) - r * r, r * r - dot(closest, closest), inside);
    }
    const Vec3 g = f - dot(f, surface.axis) * surface.axis;
    const Vec3 e = d - dot(d, surface.axis) * surface.axis;
    const double a = dot(e, e);
    if (a < kAlongAxis) return kNever;
    const double b = -dot(g, e);
    if (on_surface) return std::max(2 * b / a, 0.0);
    const Vec3 closest = g + (b / a) * e;
    return convex_crossing(a, b, dot(g, g) - r * r, r * r - dot(closest, closest), inside);
}

}  // namespace hord::sim
