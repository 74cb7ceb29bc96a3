#include "hal_sim/optics/geometry.h"

#include <algorithm>

namespace hord::sim {
namespace {

constexpr double kRound = std::numeric_limits<double>::epsilon();
constexpr Crossing kNever{};

// A convex quadric A t^2 - 2 b t + c = 0 along the ray, with `gap` = r^2 - (closest approach)^2 computed without
// cancellation and `size` the largest length that went into it.
Crossing convex_crossing(double a, double b, double c, double gap, double size, bool inside) {
    const double gap_error = 8 * kRound * size * size;
    if (gap <= 0) {
        if (!inside) return kNever;  // a tangent touches and does not enter
        return {std::max(b / a, 0.0), std::sqrt(gap_error / a)};  // inside by state, outside by rounding: leaves here
    }
    const double root = std::sqrt(a * gap);
    const double q = b + std::copysign(root, b);
    double near = c / q, far = q / a;
    if (near > far) std::swap(near, far);
    const double error = gap_error / root + 4 * kRound * size / std::sqrt(a);
    if (inside) return {std::max(far, 0.0), error};
    if (near >= 0) return {near, error};
    // Behind us. Outside by state: that is true of a ray that moves away, and rounding of one that has just reached it.
    if (far <= 0 || near + far <= 0) return kNever;
    return {0.0, error};
}

}  // namespace

bool is_inside(const Surface& surface, const Vec3& p) {
    const Vec3 f = p - surface.point;
    switch (surface.shape) {
        case Surface::Shape::plane: return dot(f, surface.axis) < 0;
        case Surface::Shape::sphere: return dot(f, f) < surface.radius * surface.radius;
        case Surface::Shape::cylinder: {
            const Vec3 g = f - dot(f, surface.axis) * surface.axis;
            return dot(g, g) < surface.radius * surface.radius;
        }
    }
    return false;
}

Crossing next_crossing(const Surface& surface, const Ray& ray, bool inside, bool on_surface) {
    const Vec3 f = ray.origin - surface.point;
    const Vec3& d = ray.direction;
    switch (surface.shape) {
        case Surface::Shape::plane: {
            if (on_surface) return kNever;
            const double towards = dot(d, surface.axis);
            if (inside ? towards <= 0 : towards >= 0) return kNever;
            const double t = -dot(f, surface.axis) / towards;
            return {std::max(t, 0.0), 4 * kRound * (length(f) / std::abs(towards) + std::abs(t))};
        }
        case Surface::Shape::sphere: {
            const double r = surface.radius;
            const double b = -dot(f, d);
            if (on_surface) return inside ? Crossing{std::max(2 * b, 0.0), 8 * kRound * r} : kNever;
            const Vec3 closest = f + b * d;
            const double distance2 = dot(f, f);
            return convex_crossing(1, b, distance2 - r * r, r * r - dot(closest, closest), std::sqrt(distance2) + r, inside);
        }
        case Surface::Shape::cylinder: {
            const double r = surface.radius;
            const Vec3 g = f - dot(f, surface.axis) * surface.axis;
            const Vec3 e = d - dot(d, surface.axis) * surface.axis;
            const double a = dot(e, e);
            if (a < kRound * kRound) return kNever;  // along the axis
            const double b = -dot(g, e);
            if (on_surface) return inside ? Crossing{std::max(2 * b / a, 0.0), 8 * kRound * r / a} : kNever;
            const Vec3 closest = g + (b / a) * e;
            const double distance2 = dot(g, g);
            return convex_crossing(a, b, distance2 - r * r, r * r - dot(closest, closest), std::sqrt(distance2) + r, inside);
        }
    }
    return kNever;
}

Vec3 outward_normal(const Surface& surface, const Vec3& p) {
    if (surface.shape == Surface::Shape::plane) return surface.axis;
    const Vec3 f = p - surface.point;
    return unit(surface.shape == Surface::Shape::sphere ? f : f - dot(f, surface.axis) * surface.axis);
}

Vec3 on_surface(const Surface& surface, const Vec3& p) {
    const Vec3 f = p - surface.point;
    switch (surface.shape) {
        case Surface::Shape::plane: return p - dot(f, surface.axis) * surface.axis;
        case Surface::Shape::sphere: return surface.point + (surface.radius / length(f)) * f;
        case Surface::Shape::cylinder: {
            const double along = dot(f, surface.axis);
            const Vec3 g = f - along * surface.axis;
            return surface.point + along * surface.axis + (surface.radius / length(g)) * g;
        }
    }
    return p;
}

double distance_to_segment(const Vec3& c, const Vec3& a, const Vec3& b) {
    const Vec3 ab = b - a;
    const double squared = dot(ab, ab);
    const double t = squared > 0 ? std::clamp(dot(c - a, ab) / squared, 0.0, 1.0) : 0.0;
    return length(c - (a + t * ab));
}

}  // namespace hord::sim
