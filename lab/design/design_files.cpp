// The chosen cell as files for the station and the simulated line.
#include <algorithm>
#include <fstream>
#include <sstream>

#include <fmt/format.h>

#include "common/toml_library.h"
#include "firmware/recipes/recipe_file.h"
#include "lab/design/design.h"

namespace hord::lab {
namespace {

constexpr int kGoodParts = 2;

Result<void> write_text(const std::filesystem::path& file, const std::string& text) {
    std::ofstream stream(file);
    stream << text << '\n';
    if (stream.flush()) return {};
    return fail(ErrorCode::io, file.string() + " cannot be written",
                "check that the folder exists, may be written to, and has space");
}

toml::array array_of(const sim::Vec3& v) { return toml::array{v.x, v.y, v.z}; }

struct ToTable {
    toml::table operator()(const sim::AirBubble& d) const {
        return toml::table{{"kind", "bubble"}, {"centre_mm", array_of(d.centre_mm)}, {"radius_mm", d.radius_mm}};
    }
    toml::table operator()(const sim::SphericalCut& d) const {
        return toml::table{{"kind", "cut"}, {"centre_mm", array_of(d.centre_mm)}, {"radius_mm", d.radius_mm}};
    }
    toml::table operator()(const sim::Dimple& d) const {
        return toml::table{{"kind", "dimple"}, {"centre_mm", array_of(d.centre_mm)}, {"radius_mm", d.radius_mm}};
    }
    toml::table operator()(const sim::AbsorbingSpeck& d) const {
        return toml::table{{"kind", "speck"},
                           {"centre_mm", array_of(d.centre_mm)},
                           {"radius_mm", d.radius_mm},
                           {"transmission", d.transmission}};
    }
    toml::table operator()(const sim::Inclusion& d) const {
        return toml::table{{"kind", "inclusion"},
                           {"centre_mm", array_of(d.centre_mm)},
                           {"radius_mm", d.radius_mm},
                           {"refractive_index", d.refractive_index}};
    }
    toml::table operator()(const sim::Scratch& d) const {
        return toml::table{{"kind", "scratch"},
                           {"from_mm", array_of(d.from_mm)},
                           {"to_mm", array_of(d.to_mm)},
                           {"radius_mm", d.radius_mm}};
    }
    toml::table operator()(const sim::Stria& d) const {
        return toml::table{{"kind", "stria"},
                           {"from_mm", array_of(d.from_mm)},
                           {"to_mm", array_of(d.to_mm)},
                           {"radius_mm", d.radius_mm},
                           {"index_difference", d.index_difference}};
    }
    toml::table operator()(const sim::Haze& d) const {
        return toml::table{{"kind", "haze"},
                           {"centre_mm", array_of(d.centre_mm)},
                           {"radius_mm", d.radius_mm},
                           {"scatter_rad", d.scatter_rad}};
    }
    toml::table operator()(const sim::Absorber&) const { return toml::table{}; }
};

// The part file's own tables about the part, with the cell's camera, light and noise.
std::string scene_text(const toml::table& part_file, const sim::Scene& scene) {
    toml::table out = part_file;
    for (const char* key : {"camera", "light", "noise", "motion", "dust", "defect", "telecentric", "name"})
        out.erase(key);
    const sim::Camera& camera = scene.camera;
    out.insert("name", scene.name);
    out.insert_or_assign("camera",
                         toml::table{{"m", camera.extents.m},
                                     {"n", camera.extents.n},
                                     {"i", camera.extents.i},
                                     {"j", camera.extents.j},
                                     {"field_mm", camera.field_mm},
                                     {"bin_pitch_rad", camera.bin_pitch_rad},
                                     {"bits", camera.bits},
                                     {"full_bin_dn", camera.full_bin_dn}});
    out.insert_or_assign("light",
                         toml::table{{"source_radius_bins", scene.light.source_radius_bins},
                                     {"wavelength_nm", scene.light.wavelength_nm},
                                     {"bandwidth_nm", scene.light.bandwidth_nm}});
    out.insert_or_assign("noise",
                         toml::table{{"electrons_per_dn", scene.noise.electrons_per_dn},
                                     {"read_e", scene.noise.read_e},
                                     {"full_well_e", scene.noise.full_well_e},
                                     {"dark_dn", scene.noise.dark_dn}});
    toml::table pose = part_file["pose"].is_table() ? *part_file["pose"].as_table() : toml::table{};
    pose.insert_or_assign("x_mm", scene.pose.x_mm);
    pose.insert_or_assign("y_mm", scene.pose.y_mm);
    out.insert_or_assign("pose", pose);
    toml::table effects = part_file["effects"].is_table() ? *part_file["effects"].as_table() : toml::table{};
    effects.insert_or_assign("diffraction", scene.effects.diffraction);
    effects.insert_or_assign("crosstalk", false);
    out.insert_or_assign("effects", effects);
    if (!scene.defects.empty()) {
        toml::array defects;
        for (const sim::SceneDefect& defect : scene.defects) defects.push_back(std::visit(ToTable{}, defect));
        out.insert("defect", defects);
    }
    std::ostringstream text;
    text << out;
    return text.str();
}

// Waits as long as the rate allows, as hordctl run has them without a file.
std::string config_text(const CellChoice& cell, const DesignTask& task) {
    const double pitch = std::min(1e3 / task.rate, 1000.0);  // ms from part to part
    return fmt::format(R"(# The designed cell on the simulated line:
#     hordctl run --simulate --config hordd.toml --rate {rate:g} --parts 20
[line]
transport_ms = {transport:.1f}
exposure_delay_ms = {delay:.1f}
min_gap_ms = {gap:.1f}

[timing]
trigger_lead_ms = {lead:.1f}

[sensor]
backend = "simulated"
scenes = "scenes"
bits = {bits}

[strobe]
backend = "simulated"

[part_sensor]
backend = "simulated"

[rejector]
backend = "simulated"
early_ms = {early:.1f}
pulse_ms = {pulse:.1f}
response_timeout_ms = {response:.1f}
confirm_timeout_ms = {confirm:.1f}

[inspection]
macro = "{bins}x{bins}"
recipe = "recipe.toml"
threads = {threads})",
                       fmt::arg("rate", task.rate), fmt::arg("transport", std::max(1000.0, 4 * pitch)),
                       fmt::arg("delay", std::max(100.0, pitch)), fmt::arg("gap", 0.9 * pitch),
                       fmt::arg("lead", 0.8 * pitch), fmt::arg("bits", task.camera.bits),
                       fmt::arg("early", 0.4 * pitch), fmt::arg("pulse", 0.8 * pitch),
                       fmt::arg("response", std::max(30.0, pitch)), fmt::arg("confirm", std::max(150.0, 1.5 * pitch)),
                       fmt::arg("bins", cell.bins), fmt::arg("threads", task.inspection_threads));
}

}  // namespace

Result<std::vector<std::filesystem::path>> write_design(const std::filesystem::path& folder,
                                                        const std::filesystem::path& part_file, const Design& design,
                                                        const DesignTask& task, const PartSurvey& survey) {
    toml::table part;
    try {
        part = toml::parse_file(part_file.string());
    } catch (const toml::parse_error& error) {
        return fail(ErrorCode::unreadable, part_file.string() + ": " + std::string(error.description()),
                    "give the scene that was designed for");
    }
    std::error_code error;
    std::filesystem::create_directories(folder / "scenes", error);
    if (error)
        return fail(ErrorCode::io, (folder / "scenes").string() + " cannot be created (" + error.message() + ")",
                    "give a folder that may be written to");
    // Scenes of an earlier design are parts of another camera.
    for (const auto& old : std::filesystem::directory_iterator(folder / "scenes", error)) {
        if (old.path().extension() == ".toml") std::filesystem::remove(old.path(), error);
    }
    const CellChoice& cell = design.fine.front().cell;
    std::vector<std::filesystem::path> files;
    const auto write = [&](const std::filesystem::path& file, const std::string& text) -> Result<void> {
        files.push_back(file);
        return write_text(file, text);
    };
    firmware::NumberedRecipe recipe;
    recipe.recipe = design.check.recipe;
    recipe.recipe.name = "designed";
    if (auto done = write(folder / "recipe.toml", firmware::format_recipe(recipe)); !done)
        return tl::unexpected(done.error());
    if (auto done = write(folder / "hordd.toml", config_text(cell, task)); !done) return tl::unexpected(done.error());
    const auto write_scene = [&](const std::string& name, sim::Scene scene) {
        scene.name = name;
        return write(folder / "scenes" / (name + ".toml"), scene_text(part, scene));
    };
    constexpr std::uint64_t kThirdSeed = 2000;
    for (int k = 0; k < kGoodParts; ++k) {
        if (auto done = write_scene(fmt::format("good-{}", k + 1), good_part(cell, task, task.seed + kThirdSeed, k));
            !done)
            return tl::unexpected(done.error());
    }
    for (std::size_t d = 0; d < task.defects.size(); ++d) {
        const WantedDefect& wanted = task.defects[d];
        sim::Scene scene = good_part(cell, task, task.seed + kThirdSeed, kGoodParts + static_cast<int>(d));
        const auto places =
            draw_places(survey, task.part, reach_mm(wanted.kind, wanted.size_mm), 1, task.seed + kThirdSeed + d);
        if (!places) return tl::unexpected(places.error());
        const Place& at = places->front();
        auto defect = make_defect(wanted.kind, wanted.size_mm, scene, survey.body, at.x_mm, at.y_mm, at.turn_rad);
        if (!defect) return tl::unexpected(defect.error());
        scene.defects = {*defect};
        if (auto done = write_scene(fmt::format("{}-1", wanted.name()), scene); !done)
            return tl::unexpected(done.error());
    }
    return files;
}

}  // namespace hord::lab
