// The presets of a scene as surfaces and solids.
#include <algorithm>
#include <numbers>

#include "hal_sim/optics/scene/exact_math.h"
#include "hal_sim/optics/scene/shapes.h"

namespace hord::sim {
namespace {

constexpr double kAir = 1.0;
constexpr double kOpaque = 1e9;  // per mm: opaque within the error of a crossing

int add_sphere(Body& body, const Vec3& centre, double radius) {
    return body.add({Surface::Shape::sphere, centre, {0, 0, 1}, radius});
}
int add_plane(Body& body, const Vec3& point, const Vec3& out) {
    return body.add({Surface::Shape::plane, point, unit(out), 0});
}
int add_cylinder(Body& body, const Vec3& point, const Vec3& axis, double radius) {
    return body.add({Surface::Shape::cylinder, point, unit(axis), radius});
}

// The box, slightly larger than the part, so that no crossing lies on its faces.
void bound(Body& body, const Vec3& half) {
    const double more = 1e-3 * std::max({half.x, half.y, half.z});
    body.low = {-half.x - more, -half.y - more, -half.z - more};
    body.high = {half.x + more, half.y + more, half.z + more};
}

void include(Body& body, const Vec3& low, const Vec3& high) {
    if (body.high.x <= body.low.x) {
        body.low = low, body.high = high;
        return;
    }
    body.low = {std::min(body.low.x, low.x), std::min(body.low.y, low.y), std::min(body.low.z, low.z)};
    body.high = {std::max(body.high.x, high.x), std::max(body.high.y, high.y), std::max(body.high.z, high.z)};
}

double sag_of(double radius, double half_width) {
    return half_width * half_width / (radius + std::sqrt(radius * radius - half_width * half_width));
}

// Two pairs of planes across the light.
void add_sides(Body& body, std::vector<Solid>& solid, double half_x, double half_y) {
    for (const double s : {-1.0, 1.0}) {
        if (half_x > 0) solid.push_back(Solid::inside(add_plane(body, {s * half_x, 0, 0}, {s, 0, 0})));
        solid.push_back(Solid::inside(add_plane(body, {0, s * half_y, 0}, {0, s, 0})));
    }
}

void build(Body&, const NoPart&) {}

void build(Body& body, const DoubleConvexLens& lens) {
    const double r = lens.radius_of_curvature_mm, a = lens.aperture_radius_mm;
    const double half = lens.edge_thickness_mm / 2 + sag_of(r, a);
    const int camera_side = add_sphere(body, {0, 0, half - r}, r);
    const int source_side = add_sphere(body, {0, 0, r - half}, r);
    const int edge = add_cylinder(body, {}, {0, 0, 1}, a);
    body.fill(Solid::all({Solid::inside(camera_side), Solid::inside(source_side), Solid::inside(edge)}),
              lens.refractive_index);
    body.convex = true;
    bound(body, {a, a, half});
}

void build(Body& body, const Wedge& wedge) {
    const double h = wedge.half_size_mm, half = wedge.centre_thickness_mm / 2;
    double sx = 0, cx = 1, sy = 0, cy = 1;
    exact::sin_cos(wedge.tilt_x_rad, sx, cx);
    exact::sin_cos(wedge.tilt_y_rad, sy, cy);
    const double tx = sx / cx, ty = sy / cy;
    std::vector<Solid> sides;
    const double camera = wedge.tilts_source_side ? 0 : 1, source = 1 - camera;
    sides.push_back(Solid::inside(add_plane(body, {0, 0, half}, {-camera * tx, -camera * ty, 1})));
    sides.push_back(Solid::inside(add_plane(body, {0, 0, -half}, {-source * tx, -source * ty, -1})));
    add_sides(body, sides, h, h);
    body.fill(Solid::all(std::move(sides)), wedge.refractive_index);
    body.convex = true;
    bound(body, {h, h, half + h * (std::abs(tx) + std::abs(ty))});
}

void build(Body& body, const PlanoConvexLens& lens) {
    const double r = lens.radius_of_curvature_mm, a = lens.aperture_radius_mm;
    const double half = (lens.edge_thickness_mm + sag_of(r, a)) / 2;
    const int curved = add_sphere(body, {0, 0, half - r}, r);
    const int flat = add_plane(body, {0, 0, -half}, {0, 0, -1});
    const int edge = add_cylinder(body, {}, {0, 0, 1}, a);
    body.fill(Solid::all({Solid::inside(curved), Solid::inside(flat), Solid::inside(edge)}), lens.refractive_index);
    body.convex = true;
    bound(body, {a, a, half});
}

void build(Body& body, const CylinderLens& lens) {
    const double r = lens.radius_of_curvature_mm, w = lens.half_width_mm, l = lens.half_length_mm;
    const double half = (lens.edge_thickness_mm + sag_of(r, w)) / 2;
    std::vector<Solid> faces{Solid::inside(add_cylinder(body, {0, 0, half - r}, {0, 1, 0}, r)),
                             Solid::inside(add_plane(body, {0, 0, -half}, {0, 0, -1}))};
    add_sides(body, faces, w, l);
    body.fill(Solid::all(std::move(faces)), lens.refractive_index);
    body.convex = true;
    bound(body, {w, l, half});
}

void build(Body& body, const Plate& plate) {
    build(body, Wedge{plate.half_size_mm, plate.thickness_mm, 0, 0, plate.refractive_index});
    const Waviness& w = plate.waviness;
    double s = 0, c = 1;
    exact::sin_cos(w.direction_rad, s, c);
    // Light bends towards the longer optical path, by the wavefront's slope.
    const double k = 2 * std::numbers::pi / w.period_mm, slope = 0.5e-6 * w.wavefront_nm * k;
    body.wave = {slope * c, slope * s, k * c, k * s, w.phase_rad};
}

void build(Body& body, const Vial& vial) {
    const Vec3 along{0, 1, 0};
    const Solid outer = Solid::inside(add_cylinder(body, {}, along, vial.outer_radius_mm));
    const Solid inner = Solid::inside(add_cylinder(body, {}, along, vial.inner_radius_mm));
    std::vector<Solid> wall{outer};
    add_sides(body, wall, 0, vial.half_height_mm);
    body.fill(Solid::all(std::move(wall)), vial.refractive_index);
    body.fill_more(inner, vial.contents_index);
    body.convex = true;  // with its contents
    bound(body, {vial.outer_radius_mm, vial.half_height_mm, vial.outer_radius_mm});
}

// The part around a defect.
struct Around {
    double index, wavelength_nm, absorption;
    std::size_t part_surfaces;  // the first ones of the body
};

void add_hollow(Body& body, const Vec3& centre, double radius) {
    const int sphere = add_sphere(body, centre, radius);
    body.fill_more(Solid::inside(sphere), kAir);
    body.features.push_back({centre, centre, radius, radius / 8});
}

void add_defect(Body& body, const Around&, const AirBubble& bubble) {
    add_hollow(body, bubble.centre_mm, bubble.radius_mm);
}

// What a cut takes out of a convex part lies in a ball about the circle in which its sphere meets a face. The sphere of
// a shallow cut is many times as large.
void add_defect(Body& body, const Around& part, const SphericalCut& cut) {
    add_hollow(body, cut.centre_mm, cut.radius_mm);
    Feature& bite = body.features.back();
    for (std::size_t s = 0; body.convex && s < part.part_surfaces; ++s) {
        const Surface& face = body.surfaces[s];
        const bool plane = face.shape == Surface::Shape::plane;
        if (!plane && face.shape != Surface::Shape::sphere) continue;
        // The circle lies at distance `along` from the cut's centre, towards the part.
        const Vec3 to_face = face.point - cut.centre_mm;
        const double apart = length(to_face), r = cut.radius_mm, square = r * r - face.radius * face.radius;
        const Vec3 inwards = plane ? -1.0 * face.axis : (1 / apart) * to_face;
        const double along = plane ? dot(to_face, inwards) : (apart * apart + square) / (2 * apart);
        const bool less_than_half = along > 0 && along < r && (plane || along < apart);
        if (!less_than_half || std::sqrt(r * r - along * along) >= bite.reach) continue;
        bite.from = bite.to = cut.centre_mm + along * inwards;
        bite.reach = std::sqrt(r * r - along * along);
        bite.resolution = bite.reach / 8;
    }
}
void add_defect(Body& body, const Around& part, const Dimple& d) {
    add_defect(body, part, SphericalCut{d.centre_mm, d.radius_mm});
}
void add_disc(Body& body, const Disc& disc) {
    body.discs.push_back(disc);
    body.features.push_back({disc.centre, disc.centre, disc.radius, disc.radius / 2});
    const double r = 1.001 * disc.radius;
    include(body, disc.centre - Vec3{r, r, 1e-3 * r}, disc.centre + Vec3{r, r, 1e-3 * r});
}
void add_defect(Body& body, const Around&, const AbsorbingSpeck& speck) {
    add_disc(body, {speck.centre_mm, speck.radius_mm, speck.transmission});
}
void add_defect(Body& body, const Around&, const Haze& haze) {
    add_disc(body, {haze.centre_mm, haze.radius_mm, 1, haze.scatter_rad});
}

// A thread: the cylinder between two places.
Solid thread(Body& body, const Vec3& from, const Vec3& to, double radius) {
    const Vec3 along = to - from;
    const int wall = add_cylinder(body, from, along, radius);
    const int begin = add_plane(body, from, -1.0 * along);
    const int end = add_plane(body, to, along);
    body.features.push_back({from, to, radius, radius / 4});
    return Solid::all({Solid::inside(wall), Solid::inside(begin), Solid::inside(end)});
}

void add_defect(Body& body, const Around& glass, const Inclusion& d) {
    const double index = dispersed(d.refractive_index, d.abbe_number, glass.wavelength_nm);
    if (d.soft) {  // two caps of height radius / 4 on one rim
        const double height = d.radius_mm / 4, sphere = (d.radius_mm * d.radius_mm / height + height) / 2;
        const Vec3 off{0, 0, sphere - height};
        const int camera_side = add_sphere(body, d.centre_mm - off, sphere);
        const int source_side = add_sphere(body, d.centre_mm + off, sphere);
        body.fill_more(Solid::all({Solid::inside(camera_side), Solid::inside(source_side)}), index);
    } else {
        body.fill_more(Solid::inside(add_sphere(body, d.centre_mm, d.radius_mm)), index);
    }
    body.features.push_back({d.centre_mm, d.centre_mm, d.radius_mm, d.radius_mm / 8});
}
void add_defect(Body& body, const Around&, const Scratch& d) {
    body.fill_more(thread(body, d.from_mm, d.to_mm, d.radius_mm), kAir);
}
void add_defect(Body& body, const Around& glass, const Absorber& d) {
    const int sphere = add_sphere(body, d.centre_mm, d.radius_mm);
    body.fill_more(Solid::inside(sphere), glass.index, d.opaque ? kOpaque : glass.absorption + d.absorption_per_mm);
    body.features.push_back({d.centre_mm, d.centre_mm, d.radius_mm, d.radius_mm / 8});
}
// A prism of triangular section along the line: a base across the light, two flanks.
Solid roof(Body& body, const Stria& d) {
    const Vec3 along = unit(d.to_mm - d.from_mm);
    const Vec3 across = unit(cross(along, {0, 0, 1})), up = cross(across, along);
    const Vec3 base = d.from_mm - d.radius_mm * up, ridge = d.from_mm + d.radius_mm * up;
    std::vector<Solid> faces{Solid::inside(add_plane(body, d.from_mm, -1.0 * along)),
                             Solid::inside(add_plane(body, d.to_mm, along)),
                             Solid::inside(add_plane(body, base, -1.0 * up))};
    for (const double side : {-2.0, 2.0}) faces.push_back(Solid::inside(add_plane(body, ridge, side * across + up)));
    body.features.push_back({d.from_mm, d.to_mm, 1.5 * d.radius_mm, d.radius_mm / 4});
    return Solid::all(std::move(faces));
}

void add_defect(Body& body, const Around& glass, const Stria& d) {
    if (d.soft) return body.fill_more(roof(body, d), glass.index + d.index_difference, glass.absorption);
    body.fill_more(thread(body, d.from_mm, d.to_mm, d.radius_mm), glass.index + d.index_difference, glass.absorption);
}

}  // namespace

double dispersed(double index_d, double abbe_number, double wavelength_nm) {
    if (!(abbe_number > 0)) return index_d;
    constexpr double kLineF = 486.13, kLineC = 656.28;  // nm
    const double per_square = (index_d - 1) / abbe_number / (1 / (kLineF * kLineF) - 1 / (kLineC * kLineC));
    return index_d + per_square * (1 / (wavelength_nm * wavelength_nm) - 1 / (kLineD * kLineD));
}

double index_of(const Part& part) {
    return std::visit(
        [](const auto& p) {
            if constexpr (requires { p.refractive_index; }) return p.refractive_index;
            else return kAir;
        },
        part);
}

Body body_of(const Scene& scene, bool with_defects, double wavelength_nm) {
    Body body;
    const double index = dispersed(index_of(scene.part), scene.glass.abbe_number, wavelength_nm);
    std::visit(
        [&](auto part) {
            if constexpr (requires { part.refractive_index; }) part.refractive_index = index;
            build(body, part);
        },
        scene.part);
    body.tint(scene.glass.absorption_per_mm);
    if (with_defects) {
        const Around glass{index, wavelength_nm, scene.glass.absorption_per_mm, body.surfaces.size()};
        for (const SceneDefect& defect : scene.defects) {
            std::visit([&](const auto& d) { add_defect(body, glass, d); }, defect);
        }
    }
    const Pose& pose = scene.pose;
    if (pose.tilt_x_rad != 0 || pose.tilt_y_rad != 0 || pose.z_mm != 0) {
        body.move(Rigid::of({0, 0, pose.z_mm}, {pose.tilt_x_rad, pose.tilt_y_rad, 0}));
    }
    body.fresnel = scene.effects.fresnel;
    body.done();
    return body;
}

}  // namespace hord::sim
