#include "hal_sim/optics/scene/geometry.h"

#include "hal_sim/optics/scene/exact_math.h"

namespace hord::sim {
namespace {

// A ray's position and direction relative to a surface: along its axis, and across.
struct Split {
    double h, dh;
    Vec3 g, e;
};
Split split(const Surface& surface, const Ray& ray) {
    const Vec3 f = ray.origin - surface.point;
    const double h = dot(f, surface.axis), dh = dot(ray.direction, surface.axis);
    return {h, dh, f - h * surface.axis, ray.direction - dh * surface.axis};
}

double cone_crossing(const Surface& cone, const Ray& ray, bool inside, bool on_surface) {
    if (on_surface && !inside) return kNever;  // convex: left once
    const auto [h, dh, g, e] = split(cone, ray);
    const double square = cone.radius * cone.radius;
    const double a = dot(e, e) - square * dh * dh, b = dot(g, e) - square * h * dh;  // a t^2 + 2 b t + c, < 0 inside
    if (on_surface) return a > 0 ? std::max(-2 * b / a, 0.0) : kNever;
    const double c = dot(g, g) - square * h * h;
    double roots[2] = {kNever, kNever};
    if (const double gap = b * b - a * c; gap > 0) {
        const double q = -(b + std::copysign(std::sqrt(gap), b));
        if (a != 0) roots[0] = q / a;
        if (q != 0) roots[1] = c / q;
    }
    double first = kNever;
    for (const double t : roots) {
        if (!(t >= 0 && t < first) || h + t * dh < 0) continue;
        if ((a * t + b > 0) == inside) first = t;  // leaving where the quadric grows
    }
    return first;
}

double asphere_crossing(const Surface& surface, const Ray& ray, bool inside, bool on_surface) {
    const Asphere& profile = *surface.asphere;
    const auto [h, dh, g, e] = split(surface, ray);
    const double ee = dot(e, e), ge = dot(g, e), gg = dot(g, g);
    const double bend = profile.sharpest * 4 * profile.rim * ee + profile.steepest * 2 * ee;  // of f'' along the ray
    const double sign = inside ? -1 : 1, size = std::sqrt(h * h + gg) + std::sqrt(profile.rim);
    const double close = 4 * std::numeric_limits<double>::epsilon() * size, furthest = size + profile.reach;
    double t = 0;
    for (int step = 0; step < 200 && t < furthest; ++step) {
        const auto [height, slope] = profile.at(gg + t * (2 * ge + t * ee));
        const double f = step == 0 && on_surface ? 0 : sign * (h + t * dh - height);
        const double growth = sign * (dh - slope * 2 * (ge + t * ee));
        if (step > 0 || !on_surface) {
            if (f <= close && growth < 0) return t;
            if (f < -close) return t;  // its sign came from rounding
        }
        // f + growth x - bend x^2 / 2 >= 0 up to here:
        const double root = std::sqrt(growth * growth + 2 * bend * std::max(f, 0.0));
        if (growth < 0) t += 2 * std::max(f, 0.0) / (root - growth);
        else if (bend > 0) t += (root + growth) / bend;
        else return kNever;
        if (step == 0 && on_surface && growth < 0) return 0;
    }
    return kNever;
}

}  // namespace

Rigid Rigid::of(const Vec3& position, const Vec3& r) {
    double sx = 0, cx = 1, sy = 0, cy = 1, sz = 0, cz = 1;
    exact::sin_cos(r.x, sx, cx);
    exact::sin_cos(r.y, sy, cy);
    exact::sin_cos(r.z, sz, cz);
    const Rigid about_x{{1, 0, 0}, {0, cx, sx}, {0, -sx, cx}, {}}, about_y{{cy, 0, -sy}, {0, 1, 0}, {sy, 0, cy}, {}};
    const Rigid about_z{{cz, sz, 0}, {-sz, cz, 0}, {0, 0, 1}, {}};
    Rigid all = about_z * about_y * about_x;
    all.shift = position;
    return all;
}

Asphere::At Asphere::on(double w) const {
    const double root = std::sqrt(std::max(1 - (1 + conic) * curvature * curvature * w, 1e-12));
    At out{curvature * w / (1 + root), curvature / (2 * root)};
    double power = w;
    for (std::size_t k = 0; k < coefficients.size(); ++k, power *= w) {
        out.height += coefficients[k] * power * w;
        out.slope += static_cast<double>(k + 2) * coefficients[k] * power;
    }
    return out;
}

Asphere::At Asphere::at(double w) const {
    if (w <= rim) return on(w);
    const At edge = on(rim);
    return {edge.height + edge.slope * (w - rim), edge.slope};
}

void Asphere::done() {
    // The conic's slope and bend are largest at the vertex or at the rim; the powers' at the rim.
    const double root = std::sqrt(std::max(1 - (1 + conic) * curvature * curvature * rim, 1e-12));
    const double c = std::abs(curvature), bend = std::abs(1 + conic) * c * c * c / 4;
    steepest = std::max(c / 2, c / (2 * root));
    sharpest = std::max(bend, bend / (root * root * root));
    double power = 1;  // w^k
    for (std::size_t k = 0; k < coefficients.size(); ++k, power *= rim) {
        const double a = std::abs(coefficients[k]), n = static_cast<double>(k + 2);
        steepest += n * a * power * rim;
        sharpest += n * (n - 1) * a * power;
    }
}

double next_crossing_of_others(const Surface& surface, const Ray& ray, bool inside, bool on_surface) {
    return surface.shape == Surface::Shape::cone ? cone_crossing(surface, ray, inside, on_surface)
                                                 : asphere_crossing(surface, ray, inside, on_surface);
}

bool is_inside(const Surface& surface, const Vec3& p) {
    const Vec3 f = p - surface.point;
    switch (surface.shape) {
        case Surface::Shape::plane: return dot(f, surface.axis) < 0;
        case Surface::Shape::sphere: return dot(f, f) < surface.radius * surface.radius;
        case Surface::Shape::cylinder: {
            const Vec3 g = f - dot(f, surface.axis) * surface.axis;
            return dot(g, g) < surface.radius * surface.radius;
        }
        case Surface::Shape::cone: {
            const double h = dot(f, surface.axis);
            const Vec3 g = f - h * surface.axis;
            return h > 0 && dot(g, g) < surface.radius * surface.radius * h * h;
        }
        case Surface::Shape::asphere: {
            const double h = dot(f, surface.axis);
            const Vec3 g = f - h * surface.axis;
            return h < surface.asphere->at(dot(g, g)).height;
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
    // The computed crossing is off the surface by the rounding of the lengths. Along the ray this error grows with the
    // inverse cosine; at a tangent it is the chord of a cap of that height.
    const double size = length(f) + surface.radius, height = 8 * kRound * size;
    const double cosine = std::abs(dot(ray.direction, foot_of(surface, ray.origin + t * ray.direction).normal));
    const double chord = std::sqrt(2 * (surface.shape >= Surface::Shape::cone ? size : surface.radius) * height);
    return std::min(cosine > 0 ? height / cosine : chord, chord);
}

Foot foot_of(const Surface& surface, const Vec3& p) {
    const Vec3 f = p - surface.point;
    if (surface.shape == Surface::Shape::plane) return {p - dot(f, surface.axis) * surface.axis, surface.axis};
    if (surface.shape >= Surface::Shape::cone) {
        const double h = dot(f, surface.axis);
        const Vec3 g = f - h * surface.axis;
        if (surface.shape == Surface::Shape::asphere) {
            const auto [height, slope] = surface.asphere->at(dot(g, g));
            return {p + (height - h) * surface.axis, unit(surface.axis - (2 * slope) * g)};
        }
        const double cosine = 1 / std::sqrt(1 + surface.radius * surface.radius), sine = surface.radius * cosine,
                     across = length(g);
        const Vec3 outwards = across > 0 ? (1 / across) * g : Vec3{};
        const double along = across * sine + h * cosine;  // from the apex along the wall
        return {surface.point + (along * cosine) * surface.axis + (along * sine) * outwards,
                cosine * outwards - sine * surface.axis};
    }
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
