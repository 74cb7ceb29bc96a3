// Scenes as TOML files; the format is described in docs/scene.md.
#include <algorithm>
#include <array>
#include <map>

#include "common/toml_fields.h"
#include "hal_sim/optics/scene/scene.h"

namespace hord::sim {
namespace {

using common::TomlProblems;
using common::TomlTable;

// Here any number is accepted: problems() checks the ranges, for files and programs alike.
constexpr double kAny = 1e300;
void number(TomlTable& table, std::string_view key, double& value) { table.number(key, value, -kAny, kAny); }

void vector(TomlTable& table, std::string_view key, Vec3& value) {
    std::vector<double> xyz;
    table.numbers(key, xyz, 3, 3);
    if (xyz.size() == 3) value = {xyz[0], xyz[1], xyz[2]};
}

void pair(TomlTable& table, std::string_view key, double& x, double& y) {
    std::vector<double> xy;
    table.numbers(key, xy, 2, 2);
    if (xy.size() == 2) x = xy[0], y = xy[1];
}

void read(TomlTable&, NoPart&) {}
void read(TomlTable& table, DoubleConvexLens& lens) {
    number(table, "radius_of_curvature_mm", lens.radius_of_curvature_mm);
    number(table, "aperture_radius_mm", lens.aperture_radius_mm);
    number(table, "edge_thickness_mm", lens.edge_thickness_mm);
    number(table, "refractive_index", lens.refractive_index);
}
void read(TomlTable& table, Wedge& wedge) {
    number(table, "half_size_mm", wedge.half_size_mm);
    number(table, "centre_thickness_mm", wedge.centre_thickness_mm);
    number(table, "tilt_x_rad", wedge.tilt_x_rad);
    number(table, "tilt_y_rad", wedge.tilt_y_rad);
    static constexpr std::array<std::string_view, 2> kFaces{"camera", "source"};
    if (const auto face = table.choice("tilted_face", kFaces)) wedge.tilts_source_side = *face == 1;
    number(table, "refractive_index", wedge.refractive_index);
}

void read(TomlTable& table, PlanoConvexLens& lens) {
    number(table, "radius_of_curvature_mm", lens.radius_of_curvature_mm);
    number(table, "aperture_radius_mm", lens.aperture_radius_mm);
    number(table, "edge_thickness_mm", lens.edge_thickness_mm);
    number(table, "refractive_index", lens.refractive_index);
}
void read(TomlTable& table, CylinderLens& lens) {
    number(table, "radius_of_curvature_mm", lens.radius_of_curvature_mm);
    number(table, "half_width_mm", lens.half_width_mm);
    number(table, "half_length_mm", lens.half_length_mm);
    number(table, "edge_thickness_mm", lens.edge_thickness_mm);
    number(table, "refractive_index", lens.refractive_index);
}
void read(TomlTable& table, Plate& plate) {
    number(table, "half_size_mm", plate.half_size_mm);
    number(table, "thickness_mm", plate.thickness_mm);
    number(table, "refractive_index", plate.refractive_index);
}
void read(TomlTable& table, Vial& vial) {
    number(table, "outer_radius_mm", vial.outer_radius_mm);
    number(table, "inner_radius_mm", vial.inner_radius_mm);
    number(table, "half_height_mm", vial.half_height_mm);
    number(table, "refractive_index", vial.refractive_index);
    number(table, "contents_index", vial.contents_index);
}

using Tables = std::map<std::string, std::vector<TomlTable>, std::less<>>;

// `path` names the shape's table, as problems() does.
void read_shape(TomlTable& table, Shape& shape, const std::string& path, Tables& tables) {
    static constexpr std::array<std::string_view, 9> kKinds{
        "union", "intersection", "difference", "sphere", "half-space", "cylinder", "cone", "asphere", "block"};
    tables[path] = {table};
    if (const auto kind = table.choice("kind", kKinds)) shape.kind = static_cast<Shape::Kind>(*kind);
    else if (!table.has("kind")) table.problem("kind", "is missing", "name the kind of shape");
    vector(table, "position_mm", shape.position_mm);
    vector(table, "rotation_rad", shape.rotation_rad);
    using Kind = Shape::Kind;
    if (shape.kind == Kind::sphere || shape.kind == Kind::cylinder || shape.kind == Kind::cone)
        number(table, "radius_mm", shape.radius_mm);
    if (shape.kind == Kind::cylinder) number(table, "half_height_mm", shape.half_height_mm);
    if (shape.kind == Kind::cone) number(table, "height_mm", shape.height_mm);
    if (shape.kind == Kind::block) vector(table, "half_size_mm", shape.half_size_mm);
    if (shape.kind == Kind::asphere) {
        number(table, "radius_of_curvature_mm", shape.radius_of_curvature_mm);
        number(table, "conic", shape.conic);
        table.numbers("coefficients", shape.coefficients, 0, 8);
        number(table, "aperture_radius_mm", shape.aperture_radius_mm);
    }
    constexpr std::size_t kDeepest = 8;
    if (static_cast<std::size_t>(std::count(path.begin(), path.end(), '[')) > kDeepest)
        return table.problem("of", "is nested too deeply", "use at most 8 levels");
    std::vector<TomlTable> of = table.tables("of");
    for (std::size_t k = 0; k < of.size(); ++k)
        read_shape(of[k], shape.of.emplace_back(), path + ".of[" + std::to_string(k) + "]", tables);
}
void read(TomlTable& table, SolidPart& part) { number(table, "refractive_index", part.refractive_index); }

void read(TomlTable& table, AirBubble& d) {
    vector(table, "centre_mm", d.centre_mm);
    number(table, "radius_mm", d.radius_mm);
}
void read(TomlTable& table, SphericalCut& d) {
    vector(table, "centre_mm", d.centre_mm);
    number(table, "radius_mm", d.radius_mm);
}
void read(TomlTable& table, AbsorbingSpeck& d) {
    vector(table, "centre_mm", d.centre_mm);
    number(table, "radius_mm", d.radius_mm);
    number(table, "transmission", d.transmission);
}

void read(TomlTable& table, Inclusion& d) {
    vector(table, "centre_mm", d.centre_mm);
    number(table, "radius_mm", d.radius_mm);
    number(table, "refractive_index", d.refractive_index);
    number(table, "abbe_number", d.abbe_number);
}
void read(TomlTable& table, Absorber& d) {
    vector(table, "centre_mm", d.centre_mm);
    number(table, "radius_mm", d.radius_mm);
    table.boolean("opaque", d.opaque);
    if (d.opaque && table.has("absorption_per_mm")) {
        table.problem("absorption_per_mm", "contradicts opaque = true", "name one of them");
    }
    number(table, "absorption_per_mm", d.absorption_per_mm);
}
void read(TomlTable& table, Stria& d) {
    vector(table, "from_mm", d.from_mm);
    vector(table, "to_mm", d.to_mm);
    number(table, "radius_mm", d.radius_mm);
    number(table, "index_difference", d.index_difference);
}
void read(TomlTable& table, Scratch& d) {
    vector(table, "from_mm", d.from_mm);
    vector(table, "to_mm", d.to_mm);
    number(table, "radius_mm", d.radius_mm);
}

template <class Variant, std::size_t... K>
std::array<Variant, sizeof...(K)> one_of_each(std::index_sequence<K...>) {
    return {Variant(std::in_place_index<K>)...};
}

// Reads the alternative that `kind` names; `value` stays as it is without one.
template <class Variant>
void read_kind(TomlTable& table, Variant& value, bool required) {
    const auto defaults = one_of_each<Variant>(std::make_index_sequence<std::variant_size_v<Variant>>{});
    std::array<std::string_view, std::variant_size_v<Variant>> names;
    for (std::size_t k = 0; k < names.size(); ++k) names[k] = name_of(defaults[k]);
    if (!table.has("kind")) {
        if (required) table.problem("kind", "is missing", "name the kind of defect");
        return;
    }
    if (const auto kind = table.choice("kind", names)) value = defaults[*kind];
    std::visit([&](auto& alternative) { read(table, alternative); }, value);
}

void read_light(TomlTable& table, std::vector<TomlTable>& collimators, Light& light) {
    number(table, "source_radius_bins", light.source_radius_bins);
    number(table, "wavelength_nm", light.wavelength_nm);
    number(table, "bandwidth_nm", light.bandwidth_nm);
    collimators = table.tables("collimator");
    for (TomlTable& given : collimators) {
        Collimator& source = light.collimators.emplace_back();
        pair(given, "direction_rad", source.direction_x_rad, source.direction_y_rad);
        number(given, "radius_rad", source.radius_rad);
        number(given, "wavelength_nm", source.wavelength_nm);
        number(given, "bandwidth_nm", source.bandwidth_nm);
        number(given, "power", source.power);
    }
    for (const char* key : {"source_radius_bins", "wavelength_nm", "bandwidth_nm"}) {
        if (!collimators.empty() && table.has(key))
            table.problem(key, "is of the one source, and collimators are listed",
                          "give it to each collimator instead");
    }
}

void read_camera(TomlTable& table, TomlTable& relay, TomlTable& array, Camera& camera) {
    constexpr std::int64_t kMax = 1'000'000;
    table.integer("m", camera.extents.m, -kMax, kMax);
    table.integer("n", camera.extents.n, -kMax, kMax);
    table.integer("i", camera.extents.i, -kMax, kMax);
    table.integer("j", camera.extents.j, -kMax, kMax);
    number(table, "field_mm", camera.field_mm);
    number(table, "bin_pitch_rad", camera.bin_pitch_rad);
    table.integer("bits", camera.bits, -kMax, kMax);
    number(table, "full_bin_dn", camera.full_bin_dn);

    number(relay, "f1_mm", camera.relay.f1_mm);
    number(relay, "f2_mm", camera.relay.f2_mm);
    number(relay, "stop_radius_mm", camera.relay.stop_radius_mm);
    number(relay, "lens1_radius_mm", camera.relay.lens1_radius_mm);
    number(relay, "lens2_radius_mm", camera.relay.lens2_radius_mm);

    number(array, "pitch_um", camera.array.pitch_um);
    number(array, "focal_um", camera.array.focal_um);
    if (array.has("pitch_um") != array.has("focal_um")) {
        array.problem(array.has("pitch_um") ? "pitch_um" : "focal_um", "stands alone",
                      "name pitch_um and focal_um, or neither");
    } else if (camera.array.pitch_um > 0 && camera.array.focal_um > 0 && camera.extents.i > 0) {
        for (const char* key : {"field_mm", "bin_pitch_rad"}) {
            if (table.has(key))
                table.problem(key, "is said by camera.array's pitch_um and focal_um as well", "drop one or the other");
        }
        derive_from_array(camera);
    }
}

void read_array(TomlTable& table, std::vector<TomlTable>& dead, LensletArray& array) {
    static constexpr std::array<std::string_view, 2> kLattices{"square", "hexagonal"};
    if (const auto lattice = table.choice("lattice", kLattices)) array.hexagonal = *lattice == 1;
    number(table, "pitch_px", array.pitch_px);
    number(table, "rotation_rad", array.rotation_rad);
    pair(table, "offset_px", array.offset_x_px, array.offset_y_px);
    pair(table, "tilt_rad", array.tilt_x_rad, array.tilt_y_rad);
    number(table, "distortion", array.distortion);
    constexpr std::int64_t kMax = 1'000'000;
    table.integer("width_px", array.width_px, -kMax, kMax);
    table.integer("height_px", array.height_px, -kMax, kMax);
    number(table, "dead_share", array.dead_share);
    for (TomlTable& lenslet : dead) {
        LensletArray::Lenslet& at = array.dead.emplace_back();
        for (const char* key : {"m", "n"}) {
            if (!lenslet.has(key)) lenslet.problem(key, "is missing", "name m and n of the dead lenslet");
        }
        lenslet.integer("m", at.m, -kMax, kMax);
        lenslet.integer("n", at.n, -kMax, kMax);
    }
}

void read_dust(std::vector<TomlTable>& tables, std::vector<Dust>& dust) {
    static constexpr std::array<std::string_view, 4> kPlanes{"lens1", "stop", "lens2", "lenslets"};
    for (TomlTable& table : tables) {
        Dust& grain = dust.emplace_back();
        if (const auto plane = table.choice("plane", kPlanes)) grain.plane = static_cast<Dust::Plane>(*plane);
        number(table, "x_mm", grain.x_mm);
        number(table, "y_mm", grain.y_mm);
        number(table, "radius_mm", grain.radius_mm);
        number(table, "transmission", grain.transmission);
    }
}

void read_noise(TomlTable& table, SensorNoise& noise) {
    number(table, "electrons_per_dn", noise.electrons_per_dn);
    table.boolean("photon_noise", noise.photon_noise);
    number(table, "read_e", noise.read_e);
    number(table, "dark_dn", noise.dark_dn);
    number(table, "dark_e_per_s", noise.dark_e_per_s);
    number(table, "exposure_ms", noise.exposure_ms);
    number(table, "dsnu_e", noise.dsnu_e);
    number(table, "prnu", noise.prnu);
    number(table, "full_well_e", noise.full_well_e);
    table.integer("pattern_seed", noise.pattern_seed, 0, INT64_MAX);
}

}  // namespace

Result<Scene> load_scene(const std::filesystem::path& file) {
    TomlProblems wrong;
    Scene scene;
    scene.name = file.stem().string();
    TomlTable root = TomlTable::parse_file(file, wrong);
    root.text("name", scene.name);
    root.integer("seed", scene.seed, 0, INT64_MAX);

    Tables tables;  // as problems() names them
    const auto table = [&](std::string_view name) -> TomlTable& {
        auto& known = tables[std::string(name)];
        if (known.empty()) known.push_back(root.table(name));
        return known.front();
    };
    read_kind(table("part"), scene.part, false);
    if (auto* solid = std::get_if<SolidPart>(&scene.part)) {
        TomlTable shape = table("part").table("shape");
        read_shape(shape, solid->shape, "part.shape", tables);
    }
    number(table("part"), "abbe_number", scene.glass.abbe_number);
    number(table("part"), "absorption_per_mm", scene.glass.absorption_per_mm);
    number(table("pose"), "x_mm", scene.pose.x_mm);
    number(table("pose"), "y_mm", scene.pose.y_mm);
    number(table("pose"), "rotation_rad", scene.pose.rotation_rad);
    number(table("pose"), "tilt_x_rad", scene.pose.tilt_x_rad);
    number(table("pose"), "tilt_y_rad", scene.pose.tilt_y_rad);
    number(table("pose"), "z_mm", scene.pose.z_mm);
    tables["defect"] = root.tables("defect");
    for (TomlTable& defect : tables["defect"]) read_kind(defect, scene.defects.emplace_back(), true);
    pair(table("motion"), "velocity_mm_s", scene.motion.velocity_x_mm_s, scene.motion.velocity_y_mm_s);
    number(table("motion"), "strobe_us", scene.motion.strobe_us);

    read_light(table("light"), tables["light.collimator"], scene.light);
    TomlTable &camera = table("camera"), relay = camera.table("relay"), array = camera.table("array");
    read_camera(camera, relay, array, scene.camera);
    tables["camera.relay"] = {relay}, tables["camera.array"] = {array};
    tables["camera.dead"] = camera.tables("dead");
    read_array(array, tables["camera.dead"], scene.camera.array);
    TomlTable lens = camera.table("main_lens");
    number(lens, "focal_mm", scene.camera.main_lens.focal_mm);
    number(lens, "distance_mm", scene.camera.main_lens.distance_mm);
    tables["camera.main_lens"] = {lens};
    tables["dust"] = root.tables("dust");
    read_dust(tables["dust"], scene.camera.dust);

    read_noise(table("noise"), scene.noise);
    table("effects").boolean("fresnel", scene.effects.fresnel);
    table("effects").boolean("ghosts", scene.effects.ghosts);
    table("effects").boolean("diffraction", scene.effects.diffraction);
    table("effects").boolean("crosstalk", scene.effects.crosstalk);

    constexpr std::int64_t kMax = 1'000'000;
    TomlTable& telecentric = table("telecentric");
    telecentric.integer("width_px", scene.telecentric.width_px, -kMax, kMax);
    telecentric.integer("height_px", scene.telecentric.height_px, -kMax, kMax);
    number(telecentric, "field_mm", scene.telecentric.field_mm);
    number(telecentric, "panel_half_mm", scene.telecentric.panel_half_mm);
    number(telecentric, "panel_distance_mm", scene.telecentric.panel_distance_mm);
    telecentric.integer("rays_per_side", scene.telecentric.rays_per_side, -kMax, kMax);
    root.refuse_unknown_keys();

    for (const SceneProblem& problem : problems(scene)) {
        auto& named = tables[problem.table];
        (problem.index < named.size() ? named[problem.index] : root).problem(problem.key, problem.what, problem.cure);
    }
    if (!wrong.empty()) return wrong.as_error();
    return scene;
}

}  // namespace hord::sim
