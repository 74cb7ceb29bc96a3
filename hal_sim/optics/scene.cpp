#include "hal_sim/optics/scene.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/optics/solid.h"

namespace hord::sim {
namespace {

class Checker {
  public:
    void in(std::string table, std::size_t index = 0) { table_ = std::move(table), index_ = index; }
    void require(bool good, const char* key, std::string what, std::string cure) {
        if (!good) found.push_back({table_, index_, key, std::move(what), std::move(cure)});
    }
    // Catches NaN, too.
    bool within(const char* key, double value, double low, double high) {
        const bool good = value >= low && value <= high;
        require(good, key, number(value) + " is out of range", "use " + number(low) + " to " + number(high));
        return good;
    }
    static std::string number(double value) {
        char text[32];
        std::snprintf(text, sizeof text, "%.6g", value);
        return text;
    }

    std::vector<SceneProblem> found;

  private:
    std::string table_;
    std::size_t index_ = 0;
};

constexpr double kThinnest = 1e-6, kLargest = 1e4;  // mm

void check_part(Checker&, const NoPart&) {}
void check_part(Checker& c, const DoubleConvexLens& lens) {
    const bool sizes = c.within("radius_of_curvature_mm", lens.radius_of_curvature_mm, kThinnest, kLargest) &
                       c.within("aperture_radius_mm", lens.aperture_radius_mm, kThinnest, kLargest);
    c.within("edge_thickness_mm", lens.edge_thickness_mm, 0, kLargest);
    c.within("refractive_index", lens.refractive_index, 1, 4);
    if (sizes) {
        c.require(lens.aperture_radius_mm <= lens.radius_of_curvature_mm, "aperture_radius_mm",
                  "is larger than the radius of curvature", "use at most " + Checker::number(lens.radius_of_curvature_mm));
    }
}
void check_part(Checker& c, const Wedge& wedge) {
    const bool sizes = c.within("half_size_mm", wedge.half_size_mm, kThinnest, kLargest) &
                       c.within("centre_thickness_mm", wedge.centre_thickness_mm, kThinnest, kLargest) &
                       c.within("tilt_x_rad", wedge.tilt_x_rad, -1.2, 1.2) & c.within("tilt_y_rad", wedge.tilt_y_rad, -1.2, 1.2);
    c.within("refractive_index", wedge.refractive_index, 1, 4);
    if (sizes) {
        const double loss = wedge.half_size_mm * (std::abs(std::tan(wedge.tilt_x_rad)) + std::abs(std::tan(wedge.tilt_y_rad)));
        c.require(loss < wedge.centre_thickness_mm, "centre_thickness_mm", "the faces meet inside the part: they tilt by " + Checker::number(loss) +
                  " mm towards a corner", "use a thicker part, a smaller one, or less tilt");
    }
}

void check_part(Checker& c, const PlanoConvexLens& lens) {
    check_part(c, DoubleConvexLens{lens.radius_of_curvature_mm, lens.aperture_radius_mm, lens.edge_thickness_mm, lens.refractive_index});
}
void check_part(Checker& c, const CylinderLens& lens) {
    const bool sizes = c.within("radius_of_curvature_mm", lens.radius_of_curvature_mm, kThinnest, kLargest) &
                       c.within("half_width_mm", lens.half_width_mm, kThinnest, kLargest);
    c.within("half_length_mm", lens.half_length_mm, kThinnest, kLargest);
    c.within("edge_thickness_mm", lens.edge_thickness_mm, 0, kLargest);
    c.within("refractive_index", lens.refractive_index, 1, 4);
    if (sizes) {
        c.require(lens.half_width_mm <= lens.radius_of_curvature_mm, "half_width_mm", "is larger than the radius of curvature",
                  "use at most " + Checker::number(lens.radius_of_curvature_mm));
    }
}
void check_part(Checker& c, const Plate& plate) {
    c.within("half_size_mm", plate.half_size_mm, kThinnest, kLargest);
    c.within("thickness_mm", plate.thickness_mm, kThinnest, kLargest);
    c.within("refractive_index", plate.refractive_index, 1, 4);
}
void check_part(Checker& c, const Vial& vial) {
    const bool sizes = c.within("outer_radius_mm", vial.outer_radius_mm, kThinnest, kLargest) &
                       c.within("inner_radius_mm", vial.inner_radius_mm, kThinnest, kLargest);
    c.within("half_height_mm", vial.half_height_mm, kThinnest, kLargest);
    c.within("refractive_index", vial.refractive_index, 1, 4);
    c.within("contents_index", vial.contents_index, 1, 4);
    if (sizes) {
        c.require(vial.inner_radius_mm < vial.outer_radius_mm, "inner_radius_mm", "leaves no wall",
                  "use less than " + Checker::number(vial.outer_radius_mm));
    }
}

// Half width of the part across the light; 0 without one.
double reach_of(const Part& part) {
    if (const auto* lens = std::get_if<DoubleConvexLens>(&part)) return lens->aperture_radius_mm;
    if (const auto* wedge = std::get_if<Wedge>(&part)) return wedge->half_size_mm;
    if (const auto* lens = std::get_if<PlanoConvexLens>(&part)) return lens->aperture_radius_mm;
    if (const auto* lens = std::get_if<CylinderLens>(&part)) return std::max(lens->half_width_mm, lens->half_length_mm);
    if (const auto* plate = std::get_if<Plate>(&part)) return plate->half_size_mm;
    if (const auto* vial = std::get_if<Vial>(&part)) return std::max(vial->outer_radius_mm, vial->half_height_mm);
    return 0;
}

void check_ball(Checker& c, const Vec3& centre, double radius) {
    for (const double x : {centre.x, centre.y, centre.z}) c.within("centre_mm", x, -kLargest, kLargest);
    c.within("radius_mm", radius, kThinnest, kLargest);
}
void check_defect(Checker& c, const AirBubble& d) { check_ball(c, d.centre_mm, d.radius_mm); }
void check_defect(Checker& c, const SphericalCut& d) { check_ball(c, d.centre_mm, d.radius_mm); }
void check_defect(Checker& c, const AbsorbingSpeck& d) {
    check_ball(c, d.centre_mm, d.radius_mm);
    c.within("transmission", d.transmission, 0, 1);
}
void check_defect(Checker& c, const Inclusion& d) {
    check_ball(c, d.centre_mm, d.radius_mm);
    c.within("refractive_index", d.refractive_index, 1, 4);
}
void check_defect(Checker& c, const Scratch& d) {
    for (const double x : {d.from_mm.x, d.from_mm.y, d.from_mm.z}) c.within("from_mm", x, -kLargest, kLargest);
    for (const double x : {d.to_mm.x, d.to_mm.y, d.to_mm.z}) c.within("to_mm", x, -kLargest, kLargest);
    c.within("radius_mm", d.radius_mm, kThinnest, kLargest);
    c.require(length(d.to_mm - d.from_mm) > kThinnest, "to_mm", "is where the scratch begins", "give it a length");
}

}  // namespace

std::string SceneProblem::message() const {
    std::string where = table;
    if (table == "defect") where.append(" ").append(std::to_string(index + 1));
    return where.append(".").append(key).append(": ").append(what).append(": ").append(cure);
}

std::string_view name_of(const Part& part) {
    constexpr std::string_view names[] = {"none", "double-convex", "wedge", "plano-convex", "cylinder-lens", "plate", "vial"};
    static_assert(std::size(names) == std::variant_size_v<Part>);
    return names[part.index()];
}

std::string_view name_of(const SceneDefect& defect) {
    constexpr std::string_view names[] = {"bubble", "cut", "speck", "inclusion", "scratch"};
    static_assert(std::size(names) == std::variant_size_v<SceneDefect>);
    return names[defect.index()];
}

std::vector<SceneProblem> problems(const Scene& scene) {
    Checker c;
    c.in("part");
    std::visit([&](const auto& part) { check_part(c, part); }, scene.part);

    c.in("pose");
    const double half_field = 0.5 * scene.camera.field_mm;
    c.within("x_mm", scene.pose.x_mm, -kLargest, kLargest);
    c.within("y_mm", scene.pose.y_mm, -kLargest, kLargest);
    c.within("rotation_rad", scene.pose.rotation_rad, -1e3, 1e3);
    const double reach = std::sqrt(2.0) * reach_of(scene.part);
    if (reach > 0 && scene.camera.extents.m > 0) {
        const double half_height = half_field * scene.camera.extents.n / scene.camera.extents.m;
        c.require(std::abs(scene.pose.x_mm) < half_field + reach, "x_mm", "puts the part outside the field", "move it towards 0");
        c.require(std::abs(scene.pose.y_mm) < half_height + reach, "y_mm", "puts the part outside the field", "move it towards 0");
    }

    c.in("light");
    c.within("source_radius_bins", scene.light.source_radius_bins, 1e-3, 8);

    c.in("camera");
    const algo::Extents& e = scene.camera.extents;
    c.within("m", e.m, algo::kMinLenslets, algo::kMaxLenslets);
    c.within("n", e.n, algo::kMinLenslets, algo::kMaxLenslets);
    c.within("i", e.i, algo::kMinBins, algo::kMaxBins);
    c.within("j", e.j, algo::kMinBins, algo::kMaxBins);
    c.within("field_mm", scene.camera.field_mm, 1e-3, 1e4);
    c.within("bin_pitch_rad", scene.camera.bin_pitch_rad, 1e-6, 0.2);
    const bool depth = c.within("bits", scene.camera.bits, 8, 16);
    if (depth) c.within("full_bin_dn", scene.camera.full_bin_dn, 1, (1 << scene.camera.bits) - 1);

    c.in("noise");
    c.within("electrons_per_dn", scene.noise.electrons_per_dn, 0, 1e6);
    c.within("read_e", scene.noise.read_e, 0, 1e6);
    c.within("dark_dn", scene.noise.dark_dn, 0, 65535);
    c.require(scene.noise.read_e == 0 || scene.noise.electrons_per_dn > 0, "read_e", "read noise in electrons needs electrons_per_dn",
              "name electrons_per_dn");

    c.in("telecentric");
    c.within("width_px", scene.telecentric.width_px, 1, 8192);
    c.within("height_px", scene.telecentric.height_px, 1, 8192);
    c.within("field_mm", scene.telecentric.field_mm, 1e-3, 1e4);
    c.within("panel_half_mm", scene.telecentric.panel_half_mm, 1e-3, 1e4);
    c.within("panel_distance_mm", scene.telecentric.panel_distance_mm, 1e-3, 1e4);
    c.within("rays_per_side", scene.telecentric.rays_per_side, 1, 64);

    constexpr std::size_t kMostDefects = 16;  // Body::kMaxSurfaces, three a scratch
    for (std::size_t k = 0; k < scene.defects.size(); ++k) {
        c.in("defect", k);
        std::visit([&](const auto& defect) { check_defect(c, defect); }, scene.defects[k]);
        if (k == kMostDefects) c.require(false, "kind", "is one defect too many", "use at most " + std::to_string(kMostDefects));
        if (std::holds_alternative<NoPart>(scene.part)) {
            c.require(std::holds_alternative<AbsorbingSpeck>(scene.defects[k]), "kind", "needs a part to be in", "name a part, or use a speck");
        }
    }
    return std::move(c.found);
}

}  // namespace hord::sim
