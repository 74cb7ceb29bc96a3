// What keeps a scene from being rendered, found table by table of the scene file.
#include <algorithm>
#include <cmath>

#include "hal_sim/optics/scene/scene.h"
#include "hal_sim/optics/scene/shapes.h"

namespace hord::sim {
namespace {

class Checker {
  public:
    void in(std::string table, std::size_t index = 0) { table_ = std::move(table), index_ = index; }
    [[nodiscard]] std::string here() const { return table_; }
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
                  "is larger than the radius of curvature",
                  "use at most " + Checker::number(lens.radius_of_curvature_mm));
    }
}
void check_part(Checker& c, const Wedge& wedge) {
    const bool sizes = c.within("half_size_mm", wedge.half_size_mm, kThinnest, kLargest) &
        c.within("centre_thickness_mm", wedge.centre_thickness_mm, kThinnest, kLargest) &
        c.within("tilt_x_rad", wedge.tilt_x_rad, -1.2, 1.2) & c.within("tilt_y_rad", wedge.tilt_y_rad, -1.2, 1.2);
    c.within("refractive_index", wedge.refractive_index, 1, 4);
    if (sizes) {
        const double loss =
            wedge.half_size_mm * (std::abs(std::tan(wedge.tilt_x_rad)) + std::abs(std::tan(wedge.tilt_y_rad)));
        c.require(loss < wedge.centre_thickness_mm, "centre_thickness_mm",
                  "the faces meet inside the part: they tilt by " + Checker::number(loss) + " mm towards a corner",
                  "use a thicker part, a smaller one, or less tilt");
    }
}

void check_part(Checker& c, const PlanoConvexLens& lens) {
    check_part(c,
               DoubleConvexLens{lens.radius_of_curvature_mm, lens.aperture_radius_mm, lens.edge_thickness_mm,
                                lens.refractive_index});
}
void check_part(Checker& c, const CylinderLens& lens) {
    const bool sizes = c.within("radius_of_curvature_mm", lens.radius_of_curvature_mm, kThinnest, kLargest) &
        c.within("half_width_mm", lens.half_width_mm, kThinnest, kLargest);
    c.within("half_length_mm", lens.half_length_mm, kThinnest, kLargest);
    c.within("edge_thickness_mm", lens.edge_thickness_mm, 0, kLargest);
    c.within("refractive_index", lens.refractive_index, 1, 4);
    if (sizes) {
        c.require(lens.half_width_mm <= lens.radius_of_curvature_mm, "half_width_mm",
                  "is larger than the radius of curvature",
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

void check_shape(Checker& c, const Shape& shape) {
    const std::string here = c.here();
    for (const double x : {shape.position_mm.x, shape.position_mm.y, shape.position_mm.z})
        c.within("position_mm", x, -kLargest, kLargest);
    for (const double x : {shape.rotation_rad.x, shape.rotation_rad.y, shape.rotation_rad.z})
        c.within("rotation_rad", x, -1e3, 1e3);
    using Kind = Shape::Kind;
    if (is_operation(shape.kind)) {
        c.require(shape.of.size() >= (shape.kind == Kind::difference ? 2 : 1), "kind", "has too few shapes to work on",
                  "add [[" + here + ".of]]");
        for (std::size_t k = 0; k < shape.of.size(); ++k) {
            c.in(here + ".of[" + std::to_string(k) + "]");
            check_shape(c, shape.of[k]);
        }
        return c.in(here);
    }
    c.require(shape.of.empty(), "of", "belongs to union, intersection and difference",
              "remove it, or name one of them as kind");
    if (shape.kind == Kind::sphere || shape.kind == Kind::cylinder || shape.kind == Kind::cone)
        c.within("radius_mm", shape.radius_mm, kThinnest, kLargest);
    if (shape.kind == Kind::cylinder) c.within("half_height_mm", shape.half_height_mm, kThinnest, kLargest);
    if (shape.kind == Kind::cone) c.within("height_mm", shape.height_mm, kThinnest, kLargest);
    if (shape.kind == Kind::block) {
        for (const double x : {shape.half_size_mm.x, shape.half_size_mm.y, shape.half_size_mm.z})
            c.within("half_size_mm", x, kThinnest, kLargest);
    }
    if (shape.kind == Kind::asphere) {
        const double r = shape.radius_of_curvature_mm, a = shape.aperture_radius_mm;
        c.require(std::abs(r) >= kThinnest && std::abs(r) <= 1e6, "radius_of_curvature_mm",
                  Checker::number(r) + " is out of range", "use 1e-06 to 1e6, of either sign");
        const bool sizes =
            c.within("aperture_radius_mm", a, kThinnest, kLargest) & c.within("conic", shape.conic, -1e3, 1e3);
        c.require(!sizes || (1 + shape.conic) * a * a < 0.9999 * r * r, "aperture_radius_mm",
                  "is larger than the conic", "use a smaller one");
        c.require(shape.coefficients.size() <= 8, "coefficients", "are more than 8", "use fewer");
    }
}
void check_part(Checker& c, const SolidPart& part) {
    c.within("refractive_index", part.refractive_index, 1, 4);
    c.in("part.shape");
    const std::size_t before = c.found.size();
    check_shape(c, part.shape);
    if (c.found.size() > before) return;
    const int surfaces = surfaces_of(part.shape);
    constexpr int kMax = 32;
    c.require(surfaces <= kMax, "kind", "has " + std::to_string(surfaces) + " faces",
              "use at most " + std::to_string(kMax));
    const Bounds bounds = bounds_of(part.shape);
    const Vec3 size = bounds.high - bounds.low;
    c.require(size.x < kNever && size.y < kNever && size.z < kNever, "kind", "reaches to infinity",
              "intersect it with a block or a cylinder");
    c.require(size.x > 0 && size.y > 0 && size.z > 0, "kind", "is empty: its shapes do not meet", "move them together");
}

// Half width of the part across the light; 0 without one.
double reach_of(const Part& part) {
    if (const auto* lens = std::get_if<DoubleConvexLens>(&part)) return lens->aperture_radius_mm;
    if (const auto* wedge = std::get_if<Wedge>(&part)) return wedge->half_size_mm;
    if (const auto* lens = std::get_if<PlanoConvexLens>(&part)) return lens->aperture_radius_mm;
    if (const auto* lens = std::get_if<CylinderLens>(&part)) return std::max(lens->half_width_mm, lens->half_length_mm);
    if (const auto* plate = std::get_if<Plate>(&part)) return plate->half_size_mm;
    if (const auto* vial = std::get_if<Vial>(&part)) return std::max(vial->outer_radius_mm, vial->half_height_mm);
    if (const auto* solid = std::get_if<SolidPart>(&part)) {
        const Bounds b = bounds_of(solid->shape);
        return std::max(std::max(std::abs(b.low.x), std::abs(b.high.x)),
                        std::max(std::abs(b.low.y), std::abs(b.high.y)));
    }
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
void check_abbe(Checker& c, double abbe_number) {
    c.require(abbe_number == 0 || (abbe_number >= 10 && abbe_number <= 200), "abbe_number",
              Checker::number(abbe_number) + " is out of range", "use 10 to 200, or 0 for none");
}
void check_defect(Checker& c, const Inclusion& d) {
    check_ball(c, d.centre_mm, d.radius_mm);
    c.within("refractive_index", d.refractive_index, 1, 4);
    check_abbe(c, d.abbe_number);
}
void check_thread(Checker& c, const Vec3& from, const Vec3& to, double radius) {
    for (const double x : {from.x, from.y, from.z}) c.within("from_mm", x, -kLargest, kLargest);
    for (const double x : {to.x, to.y, to.z}) c.within("to_mm", x, -kLargest, kLargest);
    c.within("radius_mm", radius, kThinnest, kLargest);
    c.require(length(to - from) > kThinnest, "to_mm", "is where it begins", "give it a length");
}
void check_defect(Checker& c, const Scratch& d) { check_thread(c, d.from_mm, d.to_mm, d.radius_mm); }
void check_defect(Checker& c, const Absorber& d) {
    check_ball(c, d.centre_mm, d.radius_mm);
    c.within("absorption_per_mm", d.absorption_per_mm, 0, 1e6);
}
void check_defect(Checker& c, const Stria& d) {
    check_thread(c, d.from_mm, d.to_mm, d.radius_mm);
    c.within("index_difference", d.index_difference, -0.5, 0.5);
}

void check_light(Checker& c, const Scene& scene) {
    const auto colour = [&](double wavelength, double bandwidth) {
        if (!(c.within("wavelength_nm", wavelength, 300, 2000) & c.within("bandwidth_nm", bandwidth, 0, 1000))) return;
        c.require(wavelength - bandwidth / 2 >= 200, "bandwidth_nm", "reaches below 200 nm", "use a narrower one");
    };
    c.in("light");
    c.within("source_radius_bins", scene.light.source_radius_bins, 1e-3, 8);
    colour(scene.light.wavelength_nm, scene.light.bandwidth_nm);
    double power = 0;
    for (std::size_t k = 0; k < scene.light.collimators.size(); ++k) {
        const Collimator& source = scene.light.collimators[k];
        c.in("light.collimator", k);
        c.within("direction_rad", source.direction_x_rad, -0.5, 0.5);
        c.within("direction_rad", source.direction_y_rad, -0.5, 0.5);
        c.within("radius_rad", source.radius_rad, 1e-6, 0.5);
        c.within("power", source.power, 0, 1e6);
        colour(source.wavelength_nm, source.bandwidth_nm);
        power += source.power;
    }
    constexpr std::size_t kMaxCollimators = 16;
    c.require(scene.light.collimators.size() <= kMaxCollimators, "power", "is of one collimator too many",
              "use at most " + std::to_string(kMaxCollimators));
    c.require(scene.light.collimators.empty() || power > 0, "power", "no collimator gives light",
              "give one of them some power");
}

void check_relay(Checker& c, const Scene& scene) {
    const Relay& relay = scene.camera.relay;
    c.in("camera.relay");
    const bool lengths =
        c.within("f1_mm", relay.f1_mm, 1e-3, kLargest) & c.within("f2_mm", relay.f2_mm, 1e-3, kLargest);
    c.within("stop_radius_mm", relay.stop_radius_mm, 0, kLargest);
    c.within("lens1_radius_mm", relay.lens1_radius_mm, 0, kLargest);
    c.within("lens2_radius_mm", relay.lens2_radius_mm, 0, kLargest);
    if (lengths && scene.effects.crosstalk && relay.stop_radius_mm > 0) {
        const double half_range =
            0.5 * std::min(scene.camera.extents.i, scene.camera.extents.j) * scene.camera.bin_pitch_rad * relay.f1_mm;
        c.require(relay.stop_radius_mm > half_range, "stop_radius_mm",
                  "lets no light beyond the bins' range of " + Checker::number(half_range) +
                      " mm, so there is no crosstalk to compute",
                  "drop effects.crosstalk, or open the stop");
    }
    for (std::size_t k = 0; k < scene.camera.dust.size(); ++k) {
        const Dust& dust = scene.camera.dust[k];
        c.in("dust", k);
        c.within("x_mm", dust.x_mm, -kLargest, kLargest);
        c.within("y_mm", dust.y_mm, -kLargest, kLargest);
        c.within("radius_mm", dust.radius_mm, kThinnest, kLargest);
        c.within("transmission", dust.transmission, 0, 1);
    }
}

void check_array(Checker& c, const Scene& scene) {
    const LensletArray& array = scene.camera.array;
    const algo::Extents& e = scene.camera.extents;
    c.in("camera.array");
    c.within("pitch_um", array.pitch_um, 0, 1e5);
    c.within("focal_um", array.focal_um, 0, 1e6);
    const bool pitch = c.within("pitch_px", array.pitch_px, 0, 128);
    if (pitch && array.pitch_px > 0) {
        const double most = std::max(e.i, e.j);
        c.require(
            array.pitch_px >= 0.5 * most, "pitch_px",
            "makes a bin of " + Checker::number(array.pitch_px / most) + " pixels: a lenslet too fine for its bins",
            "use at least " + Checker::number(0.5 * most));
    }
    c.within("rotation_rad", array.rotation_rad, -1e3, 1e3);
    c.within("offset_px", array.offset_x_px, -1e4, 1e4);
    c.within("offset_px", array.offset_y_px, -1e4, 1e4);
    const bool tilts =
        c.within("tilt_rad", array.tilt_x_rad, -0.5, 0.5) & c.within("tilt_rad", array.tilt_y_rad, -0.5, 0.5);
    c.require(!tilts || (array.tilt_x_rad == 0 && array.tilt_y_rad == 0) || (array.pitch_um > 0 && array.focal_um > 0),
              "tilt_rad", "changes distances to the sensor that are not known", "name pitch_um and focal_um");
    if (tilts && array.focal_um > 0) {
        const double lift = array.pitch_um / array.focal_um * 0.5 *
            (e.m * std::abs(std::tan(array.tilt_y_rad)) + e.n * std::abs(std::tan(array.tilt_x_rad)));
        c.require(lift <= 0.2, "tilt_rad",
                  "changes the distance to the sensor by " + Checker::number(100 * lift) + " %",
                  "tilt it by less than 20 % of focal_um at a corner");
    }
    c.within("distortion", array.distortion, -0.1, 0.1);
    c.within("width_px", array.width_px, 0, 32768);
    c.within("height_px", array.height_px, 0, 32768);
    c.within("dead_share", array.dead_share, 0, 1);
    for (std::size_t k = 0; k < array.dead.size(); ++k) {
        c.in("camera.dead", k);
        c.within("m", array.dead[k].m, 0, e.m - 1);
        c.within("n", array.dead[k].n, 0, e.n - 1);
    }
    const MainLens& lens = scene.camera.main_lens;
    c.in("camera.main_lens");
    c.within("focal_mm", lens.focal_mm, 0, kLargest);
    c.within("distance_mm", lens.distance_mm, 0, kLargest);
    if (lens.focal_mm > 0) {
        c.require(lens.distance_mm > lens.focal_mm, "distance_mm",
                  "is not beyond the focal length: there is no image on the lenslets", "use more than focal_mm");
        const Relay& relay = scene.camera.relay;
        c.require(relay.stop_radius_mm == 0 && relay.lens1_radius_mm == 0 && relay.lens2_radius_mm == 0 &&
                      scene.camera.dust.empty(),
                  "focal_mm", "replaces the 4f relay, whose stop, lenses and dust are named",
                  "drop camera.main_lens, or those");
    } else {
        c.require(lens.distance_mm == 0, "focal_mm", "is missing", "name it beside distance_mm, or drop that");
    }
}

void check_effects(Checker& c, const Scene& scene) {
    c.in("effects");
    c.require(!scene.effects.ghosts || scene.effects.fresnel, "ghosts", "are made of the light that fresnel splits off",
              "name fresnel, too");
    c.in("part");
    check_abbe(c, scene.glass.abbe_number);
    c.within("absorption_per_mm", scene.glass.absorption_per_mm, 0, 1e3);
    const bool has_part = !std::holds_alternative<NoPart>(scene.part);
    c.require(has_part || (scene.glass.abbe_number == 0 && scene.glass.absorption_per_mm == 0), "kind",
              "is none: there is no glass to have a colour", "name a part, or drop abbe_number and absorption_per_mm");
    if (is_dispersive(scene)) {
        const auto sources = collimators_of(scene);
        const bool colourless = std::all_of(sources.begin(), sources.end(), [](const Collimator& s) {
            return s.wavelength_nm == kLineD && s.bandwidth_nm == 0;
        });
        c.require(!colourless, "abbe_number",
                  "changes nothing at the one wavelength of " + Checker::number(kLineD) + " nm",
                  "name the light's wavelength_nm or bandwidth_nm, or drop abbe_number");
    }
    c.in("motion");
    c.within("velocity_mm_s", scene.motion.velocity_x_mm_s, -1e5, 1e5);
    c.within("velocity_mm_s", scene.motion.velocity_y_mm_s, -1e5, 1e5);
    c.within("strobe_us", scene.motion.strobe_us, 0, 1e7);
    const bool moves = scene.motion.velocity_x_mm_s != 0 || scene.motion.velocity_y_mm_s != 0;
    c.require(!moves || scene.motion.strobe_us > 0, "strobe_us",
              "is 0: a part that moves is blurred for as long as the strobe is lit",
              "name strobe_us, or drop velocity_mm_s");
    c.require(moves || !(scene.motion.strobe_us > 0), "velocity_mm_s", "is 0: a part that stands is not blurred",
              "name velocity_mm_s, or drop strobe_us");
    const double pitch = scene.camera.extents.m > 0 ? scene.camera.field_mm / scene.camera.extents.m : 0,
                 way = std::hypot(scene.motion.way_x_mm(), scene.motion.way_y_mm());
    c.require(!(way > 16 * pitch), "strobe_us",
              "the part moves by " + Checker::number(way / pitch) + " lenslets while it is lit",
              "use at most 16 lenslets' way");
}

void check_pose(Checker& c, const Scene& scene) {
    c.in("pose");
    const double half_field = 0.5 * scene.camera.field_mm;
    c.within("x_mm", scene.pose.x_mm, -kLargest, kLargest);
    c.within("y_mm", scene.pose.y_mm, -kLargest, kLargest);
    c.within("rotation_rad", scene.pose.rotation_rad, -1e3, 1e3);
    c.within("tilt_x_rad", scene.pose.tilt_x_rad, -1.5, 1.5);
    c.within("tilt_y_rad", scene.pose.tilt_y_rad, -1.5, 1.5);
    c.within("z_mm", scene.pose.z_mm, -kLargest, kLargest);
    const double reach = std::sqrt(2.0) * reach_of(scene.part);
    if (reach > 0 && scene.camera.extents.m > 0) {
        const double half_height = half_field * scene.camera.extents.n / scene.camera.extents.m;
        c.require(std::abs(scene.pose.x_mm) < half_field + reach, "x_mm", "puts the part outside the field",
                  "move it towards 0");
        c.require(std::abs(scene.pose.y_mm) < half_height + reach, "y_mm", "puts the part outside the field",
                  "move it towards 0");
    }
}

void check_camera(Checker& c, const Scene& scene) {
    c.in("camera");
    const Camera& camera = scene.camera;
    const algo::Extents& e = camera.extents;
    c.within("m", e.m, algo::kMinLenslets, algo::kMaxLenslets);
    c.within("n", e.n, algo::kMinLenslets, algo::kMaxLenslets);
    c.within("i", e.i, algo::kMinBins, algo::kMaxBins);
    c.within("j", e.j, algo::kMinBins, algo::kMaxBins);
    c.within("field_mm", camera.field_mm, 1e-3, 1e4);
    c.within("bin_pitch_rad", camera.bin_pitch_rad, 1e-6, 0.2);
    const bool depth = c.within("bits", camera.bits, 8, 16);
    if (depth) c.within("full_bin_dn", camera.full_bin_dn, 1, (1 << camera.bits) - 1);
}

void check_noise(Checker& c, const SensorNoise& noise) {
    c.in("noise");
    c.within("electrons_per_dn", noise.electrons_per_dn, 0, 1e6);
    c.within("read_e", noise.read_e, 0, 1e6);
    c.within("dark_dn", noise.dark_dn, 0, 65535);
    c.within("dark_e_per_s", noise.dark_e_per_s, 0, 1e9);
    c.within("exposure_ms", noise.exposure_ms, 0, 1e6);
    c.within("dsnu_e", noise.dsnu_e, 0, 1e6);
    c.within("prnu", noise.prnu, 0, 0.5);
    c.within("full_well_e", noise.full_well_e, 0, 1e9);
    for (const auto& [key, value] : {std::pair{"read_e", noise.read_e},
                                     {"dark_e_per_s", noise.dark_e_per_s},
                                     {"dsnu_e", noise.dsnu_e},
                                     {"full_well_e", noise.full_well_e}}) {
        c.require(value == 0 || noise.electrons_per_dn > 0, key, "is in electrons and needs electrons_per_dn",
                  "name electrons_per_dn");
    }
}

void check_telecentric(Checker& c, const TelecentricCamera& camera) {
    c.in("telecentric");
    c.within("width_px", camera.width_px, 1, 8192);
    c.within("height_px", camera.height_px, 1, 8192);
    c.within("field_mm", camera.field_mm, 1e-3, 1e4);
    c.within("panel_half_mm", camera.panel_half_mm, 1e-3, 1e4);
    c.within("panel_distance_mm", camera.panel_distance_mm, 1e-3, 1e4);
    c.within("rays_per_side", camera.rays_per_side, 1, 64);
}

void check_defects(Checker& c, const Scene& scene) {
    // A vial and 16 scratches take 4 + 16 * 3 of Body::kMaxSurfaces; a solid leaves as much room.
    const auto* solid = std::get_if<SolidPart>(&scene.part);
    const std::size_t kMaxDefects = solid != nullptr && surfaces_of(solid->shape) > 16 ? 10 : 16;
    for (std::size_t k = 0; k < scene.defects.size(); ++k) {
        c.in("defect", k);
        std::visit([&](const auto& defect) { check_defect(c, defect); }, scene.defects[k]);
        if (k == kMaxDefects)
            c.require(false, "kind", "is one defect too many", "use at most " + std::to_string(kMaxDefects));
        if (std::holds_alternative<NoPart>(scene.part)) {
            c.require(std::holds_alternative<AbsorbingSpeck>(scene.defects[k]), "kind", "needs a part to be in",
                      "name a part, or use a speck");
        }
    }
}

}  // namespace

std::string SceneProblem::message() const {
    std::string where = table;
    if (table == "defect" || table == "dust" || table == "light.collimator" || table == "camera.dead")
        where.append(" ").append(std::to_string(index + 1));
    return where.append(".").append(key).append(": ").append(what).append(": ").append(cure);
}

std::vector<SceneProblem> problems(const Scene& scene) {
    Checker c;
    c.in("part");
    std::visit([&](const auto& part) { check_part(c, part); }, scene.part);
    check_pose(c, scene);
    check_light(c, scene);
    check_relay(c, scene);
    check_array(c, scene);
    check_effects(c, scene);
    check_camera(c, scene);
    check_noise(c, scene.noise);
    check_telecentric(c, scene.telecentric);
    check_defects(c, scene);
    return std::move(c.found);
}

}  // namespace hord::sim
