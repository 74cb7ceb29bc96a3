// Finds the problems that prevent rendering, table by table of the scene file.
#include <algorithm>
#include <cmath>

#include "hal_sim/optics/scene/scene_fields.h"
#include "hal_sim/optics/scene/shapes.h"

namespace hord::sim {
namespace {

std::string text_of(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.6g", value);
    return text;
}

class Checker {
  public:
    void in(std::string table, std::size_t index = 0) { table_ = std::move(table), index_ = index; }
    [[nodiscard]] std::string here() const { return table_; }
    void require(bool good, const char* key, std::string what, std::string cure) {
        if (!good) found.push_back({table_, index_, key, std::move(what), std::move(cure)});
    }
    // Whether none of these keys has a problem.
    [[nodiscard]] bool good(std::initializer_list<std::string_view> keys) const {
        return std::none_of(found.begin(), found.end(), [&](const SceneProblem& problem) {
            return problem.table == table_ && problem.index == index_ && std::ranges::count(keys, problem.key) != 0;
        });
    }

    // The ranges (scene_fields.h). Each catches NaN, too.
    void number(const char* key, double value, double low, double high) {
        out_of_range(value >= low && value <= high, key, value, text_of(low) + " to " + text_of(high));
    }
    void integer(const char* key, double value, double low, double high) { number(key, value, low, high); }
    void number_or_none(const char* key, double value, double low, double high) {
        out_of_range(value == 0 || (value >= low && value <= high), key, value,
                     text_of(low) + " to " + text_of(high) + ", or 0 for none");
    }
    void number_of_either_sign(const char* key, double value, double low, double high) {
        out_of_range(std::abs(value) >= low && std::abs(value) <= high, key, value,
                     text_of(low) + " to " + text_of(high) + ", of either sign");
    }
    void pair(const char* key, double x, double y, double low, double high) {
        for (const double value : {x, y}) number(key, value, low, high);
    }
    void vector(const char* key, const Vec3& value, double low, double high) {
        for (const double x : {value.x, value.y, value.z}) number(key, x, low, high);
    }

    std::vector<SceneProblem> found;

  private:
    void out_of_range(bool good, const char* key, double value, const std::string& range) {
        require(good, key, text_of(value) + " is out of range", "use " + range);
    }
    std::string table_;
    std::size_t index_ = 0;
};

// Checks relations between the numbers of a part or defect; most kinds have none.
void check_together(Checker&, const auto&) {}
void check_width(Checker& c, const char* key, double half_width, double radius) {
    if (c.good({"radius_of_curvature_mm", key}))
        c.require(half_width <= radius, key, "is larger than the radius of curvature",
                  "use at most " + text_of(radius));
}
void check_together(Checker& c, const Is<DoubleConvexLens, PlanoConvexLens> auto& lens) {
    check_width(c, "aperture_radius_mm", lens.aperture_radius_mm, lens.radius_of_curvature_mm);
}
void check_together(Checker& c, const CylinderLens& lens) {
    check_width(c, "half_width_mm", lens.half_width_mm, lens.radius_of_curvature_mm);
}
void check_together(Checker& c, const Wedge& wedge) {
    if (!c.good({"half_size_mm", "centre_thickness_mm", "tilt_x_rad", "tilt_y_rad"})) return;
    const double loss =
        wedge.half_size_mm * (std::abs(std::tan(wedge.tilt_x_rad)) + std::abs(std::tan(wedge.tilt_y_rad)));
    c.require(loss < wedge.centre_thickness_mm, "centre_thickness_mm",
              "the faces meet inside the part: they tilt by " + text_of(loss) + " mm towards a corner",
              "use a thicker part, a smaller one, or less tilt");
}
void check_together(Checker& c, const Vial& vial) {
    if (c.good({"outer_radius_mm", "inner_radius_mm"}))
        c.require(vial.inner_radius_mm < vial.outer_radius_mm, "inner_radius_mm", "leaves no wall",
                  "use less than " + text_of(vial.outer_radius_mm));
}
void check_together(Checker& c, const Is<Scratch, Stria> auto& thread) {
    const Vec3 along = thread.to_mm - thread.from_mm;
    c.require(length(along) > kThinnest, "to_mm", "is where it begins", "give it a length");
    if constexpr (requires { thread.soft; })
        c.require(!thread.soft || std::hypot(along.x, along.y) > 0.1 * length(along), "soft",
                  "is not defined along the light", "lay the stria across the light, or make it round");
}

void check_shape(Checker& c, const Shape& shape) {
    const std::string here = c.here();
    fields(c, shape);
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
    if (shape.kind == Kind::asphere) {
        const double r = shape.radius_of_curvature_mm, a = shape.aperture_radius_mm;
        c.require(!c.good({"aperture_radius_mm", "conic"}) || (1 + shape.conic) * a * a < 0.9999 * r * r,
                  "aperture_radius_mm", "is larger than the conic", "use a smaller one");
        c.require(shape.coefficients.size() <= 8, "coefficients", "are more than 8", "use fewer");
    }
}
void check_together(Checker& c, const SolidPart& part) {
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

void check_together(Checker& c, const Plate& plate) {
    c.in("part.waviness");
    fields(c, plate.waviness);
}

// Half width of the part across the light; 0 without one.
double reach_of(const Part& part) {
    return std::visit(
        [](const auto& p) {
            if constexpr (requires { p.aperture_radius_mm; }) return p.aperture_radius_mm;
            else if constexpr (requires { p.half_size_mm; }) return p.half_size_mm;
            else if constexpr (requires { p.half_width_mm; }) return std::max(p.half_width_mm, p.half_length_mm);
            else if constexpr (requires { p.outer_radius_mm; }) return std::max(p.outer_radius_mm, p.half_height_mm);
            else if constexpr (requires { p.shape; }) {
                const Bounds b = bounds_of(p.shape);
                return std::max({std::abs(b.low.x), std::abs(b.high.x), std::abs(b.low.y), std::abs(b.high.y)});
            } else return 0.0;
        },
        part);
}

void check_colour(Checker& c, double wavelength_nm, double bandwidth_nm) {
    if (c.good({"wavelength_nm", "bandwidth_nm"}))
        c.require(wavelength_nm - bandwidth_nm / 2 >= 200, "bandwidth_nm", "reaches below 200 nm",
                  "use a narrower one");
}

void check_light(Checker& c, const Scene& scene) {
    c.in("light");
    fields(c, scene.light);
    check_colour(c, scene.light.wavelength_nm, scene.light.bandwidth_nm);
    double power = 0;
    for (std::size_t k = 0; k < scene.light.collimators.size(); ++k) {
        const Collimator& source = scene.light.collimators[k];
        c.in("light.collimator", k);
        fields(c, source);
        check_colour(c, source.wavelength_nm, source.bandwidth_nm);
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
    fields(c, relay);
    if (c.good({"f1_mm", "f2_mm"}) && scene.effects.crosstalk && relay.stop_radius_mm > 0) {
        const double half_range =
            0.5 * std::min(scene.camera.extents.i, scene.camera.extents.j) * scene.camera.bin_pitch_rad * relay.f1_mm;
        c.require(relay.stop_radius_mm > half_range, "stop_radius_mm",
                  "lets no light beyond the bins' range of " + text_of(half_range) +
                      " mm, so there is no crosstalk to compute",
                  "drop effects.crosstalk, or open the stop");
    }
    for (std::size_t k = 0; k < scene.camera.dust.size(); ++k) {
        c.in("dust", k);
        fields(c, scene.camera.dust[k]);
    }
}

void check_array(Checker& c, const Scene& scene) {
    const LensletArray& array = scene.camera.array;
    const algo::Extents& e = scene.camera.extents;
    c.in("camera.array");
    fields(c, array);
    if (c.good({"pitch_px"}) && array.pitch_px > 0) {
        const double most = std::max(e.i, e.j);
        c.require(array.pitch_px >= 0.5 * most, "pitch_px",
                  "makes a bin of " + text_of(array.pitch_px / most) + " pixels: a lenslet too fine for its bins",
                  "use at least " + text_of(0.5 * most));
    }
    const bool tilts = c.good({"tilt_rad"});
    c.require(!tilts || (array.tilt_x_rad == 0 && array.tilt_y_rad == 0) || (array.pitch_um > 0 && array.focal_um > 0),
              "tilt_rad", "changes distances to the sensor that are not known", "name pitch_um and focal_um");
    if (tilts && array.focal_um > 0) {
        const double lift = array.pitch_um / array.focal_um * 0.5 *
            (e.m * std::abs(std::tan(array.tilt_y_rad)) + e.n * std::abs(std::tan(array.tilt_x_rad)));
        c.require(lift <= 0.2, "tilt_rad", "changes the distance to the sensor by " + text_of(100 * lift) + " %",
                  "tilt it by less than 20 % of focal_um at a corner");
    }
    for (std::size_t k = 0; k < array.dead.size(); ++k) {
        c.in("camera.dead", k);
        c.integer("m", array.dead[k].m, 0, e.m - 1);
        c.integer("n", array.dead[k].n, 0, e.n - 1);
    }
    const MainLens& lens = scene.camera.main_lens;
    c.in("camera.main_lens");
    fields(c, lens);
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
    fields(c, scene.glass);
    const bool has_part = !std::holds_alternative<NoPart>(scene.part);
    c.require(has_part || (scene.glass.abbe_number == 0 && scene.glass.absorption_per_mm == 0), "kind",
              "is none: there is no glass to have a colour", "name a part, or drop abbe_number and absorption_per_mm");
    if (is_dispersive(scene)) {
        const auto sources = collimators_of(scene);
        const bool colourless = std::all_of(sources.begin(), sources.end(), [](const Collimator& s) {
            return s.wavelength_nm == kLineD && s.bandwidth_nm == 0;
        });
        c.require(!colourless, "abbe_number", "changes nothing at the one wavelength of " + text_of(kLineD) + " nm",
                  "name the light's wavelength_nm or bandwidth_nm, or drop abbe_number");
    }
    c.in("motion");
    fields(c, scene.motion);
    const bool moves = scene.motion.velocity_x_mm_s != 0 || scene.motion.velocity_y_mm_s != 0;
    c.require(!moves || scene.motion.strobe_us > 0, "strobe_us",
              "is 0: a part that moves is blurred for as long as the strobe is lit",
              "name strobe_us, or drop velocity_mm_s");
    c.require(moves || !(scene.motion.strobe_us > 0), "velocity_mm_s", "is 0: a part that stands is not blurred",
              "name velocity_mm_s, or drop strobe_us");
    const double pitch = scene.camera.extents.m > 0 ? scene.camera.field_mm / scene.camera.extents.m : 0,
                 way = std::hypot(scene.motion.way_x_mm(), scene.motion.way_y_mm());
    c.require(!(way > 16 * pitch), "strobe_us",
              "the part moves by " + text_of(way / pitch) + " lenslets while it is lit",
              "use at most 16 lenslets' way");
}

void check_pose(Checker& c, const Scene& scene) {
    c.in("pose");
    const double half_field = 0.5 * scene.camera.field_mm;
    fields(c, scene.pose);
    const double reach = std::sqrt(2.0) * reach_of(scene.part);
    if (reach > 0 && scene.camera.extents.m > 0) {
        const double half_height = half_field * scene.camera.extents.n / scene.camera.extents.m;
        c.require(std::abs(scene.pose.x_mm) < half_field + reach, "x_mm", "puts the part outside the field",
                  "move it towards 0");
        c.require(std::abs(scene.pose.y_mm) < half_height + reach, "y_mm", "puts the part outside the field",
                  "move it towards 0");
    }
}

void check_noise(Checker& c, const SensorNoise& noise) {
    c.in("noise");
    fields(c, noise);
    for (const auto& [key, value] : {std::pair{"read_e", noise.read_e},
                                     {"dark_e_per_s", noise.dark_e_per_s},
                                     {"dsnu_e", noise.dsnu_e},
                                     {"full_well_e", noise.full_well_e}}) {
        c.require(value == 0 || noise.electrons_per_dn > 0, key, "is in electrons and needs electrons_per_dn",
                  "name electrons_per_dn");
    }
}

void check_defects(Checker& c, const Scene& scene) {
    // A vial, 14 scratches and 2 soft striae take 4 + 14 * 3 + 2 * 5 of Body::kMaxSurfaces; a solid leaves as much
    // room.
    constexpr std::ptrdiff_t kMaxSoft = 2;
    const auto is_soft = [](const SceneDefect& of) {
        const auto* stria = std::get_if<Stria>(&of);
        return stria != nullptr && stria->soft;
    };
    const auto is_haze = [](const SceneDefect& of) { return std::holds_alternative<Haze>(of); };
    const Relay& relay = scene.camera.relay;
    const bool blocked = relay.stop_radius_mm > 0 || relay.lens1_radius_mm > 0 || relay.lens2_radius_mm > 0 ||
        !scene.camera.dust.empty();
    const auto* solid = std::get_if<SolidPart>(&scene.part);
    const std::size_t kMaxDefects = solid != nullptr && surfaces_of(solid->shape) > 16 ? 10 : 16;
    for (std::size_t k = 0; k < scene.defects.size(); ++k) {
        c.in("defect", k);
        std::visit([&](const auto& defect) { fields(c, defect), check_together(c, defect); }, scene.defects[k]);
        if (k == kMaxDefects)
            c.require(false, "kind", "is one defect too many", "use at most " + std::to_string(kMaxDefects));
        const auto at = scene.defects.begin() + static_cast<std::ptrdiff_t>(k);
        if (is_soft(*at) && std::count_if(scene.defects.begin(), at, is_soft) == kMaxSoft)
            c.require(false, "soft", "is one soft stria too many", "use at most " + std::to_string(kMaxSoft));
        if (is_haze(*at)) {
            c.require(std::none_of(scene.defects.begin(), at, is_haze), "kind", "is a second haze", "use one");
            c.require(!blocked && !scene.effects.diffraction, "kind",
                      "cannot be rendered with diffraction, a stop, lenses' rims or dust", "remove them, or the haze");
        }
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
    std::visit([&](const auto& part) { fields(c, part), check_together(c, part); }, scene.part);
    check_pose(c, scene);
    check_light(c, scene);
    check_relay(c, scene);
    check_array(c, scene);
    check_effects(c, scene);
    c.in("camera");
    fields(c, scene.camera);
    check_noise(c, scene.noise);
    c.in("telecentric");
    fields(c, scene.telecentric);
    check_defects(c, scene);
    return std::move(c.found);
}

}  // namespace hord::sim
