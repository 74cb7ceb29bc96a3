#include "hal_sim/optics/geometry.h"

namespace hord::sim {

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

double crossing_error(const Surface& surface, const Ray& ray, double t) {
    constexpr double kRound = std::numeric_limits<double>::epsilon();
    const Vec3 f = ray.origin - surface.point;
    if (surface.shape == Surface::Shape::plane) {
        return 4 * kRound * (length(f) / std::abs(dot(ray.direction, surface.axis)) + std::abs(t));
    }
    // The point where the ray is said to cross is off the surface by the lengths' rounding; seen along the ray, that grows
    // with the inverse cosine, and at a tangent it is the chord of a cap of that height.
    const double size = length(f) + surface.radius, height = 8 * kRound * size;
    const double cosine = std::abs(dot(ray.direction, foot_of(surface, ray.origin + t * ray.direction).normal));
    const double chord = std::sqrt(2 * surface.radius * height);
    return std::min(cosine > 0 ? height / cosine : chord, chord);
}

Foot foot_of(const Surface& surface, const Vec3& p) {
    const Vec3 f = p - surface.point;
    if (surface.shape == Surface::Shape::plane) return {p - dot(f, surface.axis) * surface.axis, surface.axis};
    Vec3 centre = surface.point, out = f;
    if (surface.shape == Surface::Shape::cylinder) {
        const Vec3 along = dot(f, surface.axis) * surface.axis;
        centre = surface.point + along;
        out = f - along;
    }
    const Vec3 normal = unit(out);
    return {centre + surface.radius * normal, normal};
}

double distance_to_segment(const Vec3& c, const Vec3& a, const Vec3& b) {
    const Vec3 ab = b - a;
    const double squared = dot(ab, ab);
    const double t = squared > 0 ? std::clamp(dot(c - a, ab) / squared, 0.0, 1.0) : 0.0;
    return length(c - (a + t * ab));
}

}  // namespace hord::sim
