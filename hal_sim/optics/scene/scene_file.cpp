// Scenes as TOML files; the format is described in docs/scene.md.
#include <algorithm>
#include <array>
#include <map>

#include "common/file_kind.h"
#include "common/toml_fields.h"
#include "hal_sim/optics/scene/scene_fields.h"

namespace hord::sim {
namespace {

using common::TomlProblems;
using common::TomlTable;

// Reads the fields of a table (scene_fields.h). Here any number is accepted: problems() checks the ranges, for files
// and programs alike.
class Reader {
  public:
    explicit Reader(TomlTable& table) : table_(table) {}
    void number(std::string_view key, double& value, double, double) { table_.number(key, value, -kAny, kAny); }
    void number_or_none(std::string_view key, double& value, double, double) { number(key, value, 0, 0); }
    void number_of_either_sign(std::string_view key, double& value, double, double) { number(key, value, 0, 0); }
    void integer(std::string_view key, int& value, double, double) {
        constexpr std::int64_t kMax = 1'000'000;
        table_.integer(key, value, -kMax, kMax);
    }
    void pair(std::string_view key, double& x, double& y, double, double) {
        std::vector<double> xy;
        table_.numbers(key, xy, 2, 2);
        if (xy.size() == 2) x = xy[0], y = xy[1];
    }
    void vector(std::string_view key, Vec3& value, double, double) {
        std::vector<double> xyz;
        table_.numbers(key, xyz, 3, 3);
        if (xyz.size() == 3) value = {xyz[0], xyz[1], xyz[2]};
    }

  private:
    static constexpr double kAny = 1e300;
    TomlTable& table_;
};

void read_fields(TomlTable& table, auto& of) {
    Reader reader(table);
    fields(reader, of);
}

// Reads the fields of a part or defect that are not numbers; most kinds have none.
void read_more(TomlTable&, const auto&) {}
void read_more(TomlTable& table, Wedge& wedge) {
    static constexpr std::array<std::string_view, 2> kFaces{"camera", "source"};
    if (const auto face = table.choice("tilted_face", kFaces)) wedge.tilts_source_side = *face == 1;
}
void read_more(TomlTable& table, Absorber& d) {
    table.boolean("opaque", d.opaque);
    if (d.opaque && table.has("absorption_per_mm"))
        table.problem("absorption_per_mm", "contradicts opaque = true", "name one of them");
}
void read_more(TomlTable& table, Is<Inclusion, Stria> auto& d) { table.boolean("soft", d.soft); }

using Tables = std::map<std::string, std::vector<TomlTable>, std::less<>>;

// `path` names the shape's table, as problems() does.
void read_shape(TomlTable& table, Shape& shape, const std::string& path, Tables& tables) {
    static constexpr std::array<std::string_view, 9> kKinds{
        "union", "intersection", "difference", "sphere", "half-space", "cylinder", "cone", "asphere", "block"};
    tables[path] = {table};
    if (const auto kind = table.choice("kind", kKinds)) shape.kind = static_cast<Shape::Kind>(*kind);
    else if (!table.has("kind")) table.problem("kind", "is missing", "name the kind of shape");
    read_fields(table, shape);
    if (shape.kind == Shape::Kind::asphere) table.numbers("coefficients", shape.coefficients, 0, 8);
    constexpr std::size_t kDeepest = 8;
    if (static_cast<std::size_t>(std::count(path.begin(), path.end(), '[')) > kDeepest)
        return table.problem("of", "is nested too deeply", "use at most 8 levels");
    std::vector<TomlTable> of = table.tables("of");
    for (std::size_t k = 0; k < of.size(); ++k)
        read_shape(of[k], shape.of.emplace_back(), path + ".of[" + std::to_string(k) + "]", tables);
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
    std::visit([&](auto& kind) { read_fields(table, kind), read_more(table, kind); }, value);
}

void read_light(TomlTable& table, std::vector<TomlTable>& collimators, Light& light) {
    read_fields(table, light);
    collimators = table.tables("collimator");
    for (TomlTable& given : collimators) read_fields(given, light.collimators.emplace_back());
    for (const char* key : {"source_radius_bins", "wavelength_nm", "bandwidth_nm"}) {
        if (!collimators.empty() && table.has(key))
            table.problem(key, "is of the one source, and collimators are listed",
                          "give it to each collimator instead");
    }
}

// field_mm and bin_pitch_rad from the array's pitch and focal length, seen through the relay.
void derive_from_array(Camera& camera) {
    const double magnification = camera.relay.f2_mm / camera.relay.f1_mm;
    camera.field_mm = camera.extents.m * camera.array.pitch_um * 1e-3 / magnification;
    camera.bin_pitch_rad = camera.array.pitch_um / camera.extents.i / camera.array.focal_um * magnification;
}

void read_camera(TomlTable& table, TomlTable& relay, TomlTable& array, Camera& camera) {
    read_fields(table, camera);
    read_fields(relay, camera.relay);
    read_fields(array, camera.array);
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
    constexpr std::int64_t kMax = 1'000'000;
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
        read_fields(table, grain);
    }
}

}  // namespace

Result<Scene> load_scene(const std::filesystem::path& file) {
    if (auto right = common::require_kind(file, common::FileKind::scene); !right) return tl::unexpected(right.error());
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
    if (auto* plate = std::get_if<Plate>(&scene.part)) {
        TomlTable waviness = table("part").table("waviness");
        read_fields(waviness, plate->waviness);
        tables["part.waviness"] = {waviness};
    }
    read_fields(table("part"), scene.glass);
    read_fields(table("pose"), scene.pose);
    tables["defect"] = root.tables("defect");
    for (TomlTable& defect : tables["defect"]) read_kind(defect, scene.defects.emplace_back(), true);
    read_fields(table("motion"), scene.motion);

    read_light(table("light"), tables["light.collimator"], scene.light);
    TomlTable &camera = table("camera"), relay = camera.table("relay"), array = camera.table("array");
    read_camera(camera, relay, array, scene.camera);
    tables["camera.relay"] = {relay}, tables["camera.array"] = {array};
    tables["camera.dead"] = camera.tables("dead");
    read_array(array, tables["camera.dead"], scene.camera.array);
    TomlTable lens = camera.table("main_lens");
    read_fields(lens, scene.camera.main_lens);
    tables["camera.main_lens"] = {lens};
    tables["dust"] = root.tables("dust");
    read_dust(tables["dust"], scene.camera.dust);

    read_fields(table("noise"), scene.noise);
    table("noise").boolean("photon_noise", scene.noise.photon_noise);
    table("noise").integer("pattern_seed", scene.noise.pattern_seed, 0, INT64_MAX);
    table("effects").boolean("fresnel", scene.effects.fresnel);
    table("effects").boolean("ghosts", scene.effects.ghosts);
    table("effects").boolean("diffraction", scene.effects.diffraction);
    table("effects").boolean("crosstalk", scene.effects.crosstalk);

    read_fields(table("telecentric"), scene.telecentric);
    root.refuse_unknown_keys();

    for (const SceneProblem& problem : problems(scene)) {
        auto& named = tables[problem.table];
        (problem.index < named.size() ? named[problem.index] : root).problem(problem.key, problem.what, problem.cure);
    }
    if (!wrong.empty()) return wrong.as_error();
    return scene;
}

}  // namespace hord::sim
