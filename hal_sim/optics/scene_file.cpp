// Scenes as TOML files; the format is described in docs/scene.md.
#include <array>

#include "common/toml_fields.h"
#include "hal_sim/optics/scene.h"

namespace hord::sim {
namespace {

using common::TomlProblems;
using common::TomlTable;

// Ranges are checked once, for files and programs alike, by problems(); here a number only has to be one.
constexpr double kAny = 1e300;
void number(TomlTable& table, std::string_view key, double& value) { table.number(key, value, -kAny, kAny); }

void vector(TomlTable& table, std::string_view key, Vec3& value) {
    std::vector<double> xyz;
    table.numbers(key, xyz, 3, 3);
    if (xyz.size() == 3) value = {xyz[0], xyz[1], xyz[2]};
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

}  // namespace

Result<Scene> load_scene(const std::filesystem::path& file) {
    TomlProblems wrong;
    Scene scene;
    scene.name = file.stem().string();
    TomlTable root = TomlTable::parse_file(file, wrong);
    root.text("name", scene.name);
    root.integer("seed", scene.seed, 0, INT64_MAX);

    TomlTable part = root.table("part");
    read_kind(part, scene.part, false);
    TomlTable pose = root.table("pose");
    number(pose, "x_mm", scene.pose.x_mm);
    number(pose, "y_mm", scene.pose.y_mm);
    number(pose, "rotation_rad", scene.pose.rotation_rad);
    std::vector<TomlTable> defects = root.tables("defect");
    for (TomlTable& table : defects) read_kind(table, scene.defects.emplace_back(), true);

    TomlTable light = root.table("light");
    number(light, "source_radius_bins", scene.light.source_radius_bins);

    TomlTable camera = root.table("camera");
    constexpr std::int64_t kMost = 1'000'000;
    camera.integer("m", scene.camera.extents.m, -kMost, kMost);
    camera.integer("n", scene.camera.extents.n, -kMost, kMost);
    camera.integer("i", scene.camera.extents.i, -kMost, kMost);
    camera.integer("j", scene.camera.extents.j, -kMost, kMost);
    number(camera, "field_mm", scene.camera.field_mm);
    number(camera, "bin_pitch_rad", scene.camera.bin_pitch_rad);
    camera.integer("bits", scene.camera.bits, -kMost, kMost);
    number(camera, "full_bin_dn", scene.camera.full_bin_dn);

    TomlTable noise = root.table("noise");
    number(noise, "electrons_per_dn", scene.noise.electrons_per_dn);
    number(noise, "read_e", scene.noise.read_e);
    number(noise, "dark_dn", scene.noise.dark_dn);
    TomlTable effects = root.table("effects");
    effects.boolean("fresnel", scene.effects.fresnel);

    TomlTable telecentric = root.table("telecentric");
    telecentric.integer("width_px", scene.telecentric.width_px, -kMost, kMost);
    telecentric.integer("height_px", scene.telecentric.height_px, -kMost, kMost);
    number(telecentric, "field_mm", scene.telecentric.field_mm);
    number(telecentric, "panel_half_mm", scene.telecentric.panel_half_mm);
    number(telecentric, "panel_distance_mm", scene.telecentric.panel_distance_mm);
    telecentric.integer("rays_per_side", scene.telecentric.rays_per_side, -kMost, kMost);
    root.refuse_unknown_keys();

    for (const SceneProblem& problem : problems(scene)) {
        TomlTable& table = problem.table == "part"     ? part
                           : problem.table == "pose"   ? pose
                           : problem.table == "light"  ? light
                           : problem.table == "camera" ? camera
                           : problem.table == "telecentric" ? telecentric
                           : problem.table == "defect" ? defects[problem.index]
                                                       : noise;
        table.problem(problem.key, problem.what, problem.cure);
    }
    if (!wrong.empty()) return wrong.as_error();
    return scene;
}

}  // namespace hord::sim
