// Converts a scene's shapes, and their unions, intersections and differences, to surfaces of a body.
#include "hal_sim/optics/scene/shapes.h"

#include <algorithm>
#include <cmath>

namespace hord::sim {
namespace {

constexpr double kSmallPiece = 2;  // mm: smaller cuts become features, which are sampled densely

struct Builder {
    Body& body;

    int add(Surface::Shape shape, const Rigid& at, const Vec3& point, const Vec3& axis, double radius) {
        return body.add({shape, at(point), unit(at.turn(axis)), radius});
    }
    Solid plane(const Rigid& at, const Vec3& point, const Vec3& out) {
        return Solid::inside(add(Surface::Shape::plane, at, point, out, 0));
    }

    Solid primitive(const Shape& shape, const Rigid& at) {
        const Vec3 z{0, 0, 1};
        switch (shape.kind) {
            case Shape::Kind::sphere: return Solid::inside(add(Surface::Shape::sphere, at, {}, z, shape.radius_mm));
            case Shape::Kind::half_space: return plane(at, {}, z);
            case Shape::Kind::cylinder:
                return Solid::all({Solid::inside(add(Surface::Shape::cylinder, at, {}, z, shape.radius_mm)),
                                   plane(at, {0, 0, shape.half_height_mm}, z),
                                   plane(at, {0, 0, -shape.half_height_mm}, {0, 0, -1})});
            case Shape::Kind::cone:
                return Solid::all(
                    {Solid::inside(add(Surface::Shape::cone, at, {}, z, shape.radius_mm / shape.height_mm)),
                     plane(at, {0, 0, shape.height_mm}, z)});
            case Shape::Kind::asphere: {
                auto profile = std::make_shared<Asphere>();
                profile->curvature = 1 / shape.radius_of_curvature_mm;
                profile->conic = shape.conic;
                profile->coefficients = shape.coefficients;
                profile->rim = shape.aperture_radius_mm * shape.aperture_radius_mm;
                profile->done();
                body.surfaces.reserve(Body::kMaxSurfaces);
                const int surface = add(Surface::Shape::asphere, at, {}, z, shape.aperture_radius_mm);
                if (surface >= 0) body.surfaces[static_cast<std::size_t>(surface)].asphere = std::move(profile);
                return Solid::inside(surface);
            }
            case Shape::Kind::block: {
                std::vector<Solid> faces;
                const Vec3& half = shape.half_size_mm;
                for (const double s : {-1.0, 1.0}) {
                    faces.push_back(plane(at, {s * half.x, 0, 0}, {s, 0, 0}));
                    faces.push_back(plane(at, {0, s * half.y, 0}, {0, s, 0}));
                    faces.push_back(plane(at, {0, 0, s * half.z}, {0, 0, s}));
                }
                return Solid::all(std::move(faces));
            }
            default: return Solid::all({});
        }
    }

    Solid build(const Shape& shape, const Rigid& outer, bool cut_away) {
        const Rigid at = outer * Rigid::of(shape.position_mm, shape.rotation_rad);
        if (!is_operation(shape.kind)) {
            if (cut_away) look_closely(shape, at);
            return primitive(shape, at);
        }
        std::vector<Solid> of;
        for (std::size_t k = 0; k < shape.of.size(); ++k) {
            of.push_back(build(shape.of[k], at, cut_away || (shape.kind == Shape::Kind::difference && k > 0)));
        }
        if (shape.kind == Shape::Kind::union_of) return Solid::any(std::move(of));
        if (shape.kind == Shape::Kind::intersection) return Solid::all(std::move(of));
        Solid first = std::move(of.front());
        of.erase(of.begin());
        return Solid::difference(std::move(first), Solid::any(std::move(of)));
    }

    void look_closely(const Shape& shape, const Rigid& at) {
        const Bounds bounds = bounds_of(shape, at);
        const double reach = 0.5 * length(bounds.high - bounds.low);
        if (!(reach < kSmallPiece)) return;
        const Vec3 middle = 0.5 * (bounds.low + bounds.high);
        body.features.push_back({middle, middle, reach, reach / 8});
    }

    // Of a shape whose own place is applied.
    static Bounds bounds_of(const Shape& shape, const Rigid& at) {
        const auto around = [&](const Vec3& middle, const Vec3& half) {
            const Vec3 c = at(middle);
            const Vec3 h{std::abs(at.x.x) * half.x + std::abs(at.y.x) * half.y + std::abs(at.z.x) * half.z,
                         std::abs(at.x.y) * half.x + std::abs(at.y.y) * half.y + std::abs(at.z.y) * half.z,
                         std::abs(at.x.z) * half.x + std::abs(at.y.z) * half.y + std::abs(at.z.z) * half.z};
            return Bounds{c - h, c + h};
        };
        const double r = shape.radius_mm;
        switch (shape.kind) {
            case Shape::Kind::sphere: return {at.shift - Vec3{r, r, r}, at.shift + Vec3{r, r, r}};
            case Shape::Kind::cylinder: return around({}, {r, r, shape.half_height_mm});
            case Shape::Kind::cone: return around({0, 0, shape.height_mm / 2}, {r, r, shape.height_mm / 2});
            case Shape::Kind::block: return around({}, shape.half_size_mm);
            case Shape::Kind::half_space: {  // bounded on the side that it closes, where it stands along an axis
                Bounds all;
                for (const auto& [out, high, low, place] : {std::tuple{at.z.x, &all.high.x, &all.low.x, at.shift.x},
                                                            {at.z.y, &all.high.y, &all.low.y, at.shift.y},
                                                            {at.z.z, &all.high.z, &all.low.z, at.shift.z}}) {
                    if (std::abs(out) > 1 - 1e-12) (out > 0 ? *high : *low) = place;
                }
                return all;
            }
            default: return {};
        }
    }

    static Bounds bounds(const Shape& shape, const Rigid& outer) {
        const Rigid at = outer * Rigid::of(shape.position_mm, shape.rotation_rad);
        if (!is_operation(shape.kind)) return bounds_of(shape, at);
        if (shape.of.empty()) return {};
        Bounds all = bounds(shape.of.front(), at);
        if (shape.kind == Shape::Kind::difference) return all;
        const bool wider = shape.kind == Shape::Kind::union_of;
        for (std::size_t k = 1; k < shape.of.size(); ++k) {
            const Bounds more = bounds(shape.of[k], at);
            const auto low = [&](double a, double b) { return wider ? std::min(a, b) : std::max(a, b); };
            const auto high = [&](double a, double b) { return wider ? std::max(a, b) : std::min(a, b); };
            all.low = {low(all.low.x, more.low.x), low(all.low.y, more.low.y), low(all.low.z, more.low.z)};
            all.high = {high(all.high.x, more.high.x), high(all.high.y, more.high.y), high(all.high.z, more.high.z)};
        }
        return all;
    }
};

bool is_convex(const Shape& shape) {
    if (shape.kind == Shape::Kind::asphere) return false;
    if (!is_operation(shape.kind)) return true;
    return shape.kind == Shape::Kind::intersection && std::all_of(shape.of.begin(), shape.of.end(), is_convex);
}

}  // namespace

bool is_operation(Shape::Kind kind) {
    return kind == Shape::Kind::union_of || kind == Shape::Kind::intersection || kind == Shape::Kind::difference;
}

int surfaces_of(const Shape& shape) {
    switch (shape.kind) {
        case Shape::Kind::cylinder: return 3;
        case Shape::Kind::cone: return 2;
        case Shape::Kind::block: return 6;
        case Shape::Kind::sphere:
        case Shape::Kind::half_space:
        case Shape::Kind::asphere: return 1;
        default: break;
    }
    int sum = 0;
    for (const Shape& each : shape.of) sum += surfaces_of(each);
    return sum;
}

Bounds bounds_of(const Shape& shape) { return Builder::bounds(shape, {}); }

void build(Body& body, const SolidPart& part) {
    const Bounds bounds = bounds_of(part.shape);
    const double more = 1e-3 * length(bounds.high - bounds.low);
    body.low = bounds.low - Vec3{more, more, more};
    body.high = bounds.high + Vec3{more, more, more};
    body.fill(Builder{body}.build(part.shape, {}, false), part.refractive_index);
    body.convex = is_convex(part.shape);
    for (Surface& surface : body.surfaces) {  // the reach of an asphere: across the part, from any place in front of it
        if (!surface.asphere) continue;
        auto profile = std::make_shared<Asphere>(*surface.asphere);
        profile->reach = 4 * length(body.high - body.low);
        surface.asphere = std::move(profile);
    }
}

}  // namespace hord::sim
