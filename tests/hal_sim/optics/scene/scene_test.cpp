#include "hal_sim/optics/scene/scene.h"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hal_sim/optics/camera/render.h"

namespace hord::sim {
namespace {

using ::testing::HasSubstr;

Result<Scene> read(const std::string& text) {
    const auto file = std::filesystem::path(::testing::TempDir()) /
        (std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()) + ".toml");
    std::ofstream(file) << text;
    return load_scene(file);
}

TEST(SceneFile, the_example_scenes_load_and_say_what_they_are) {
    const std::filesystem::path folder = std::filesystem::path(HORD_SOURCE_DIR) / "hal_sim" / "scenes";
    int count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
        const auto scene = load_scene(entry.path());
        ASSERT_TRUE(scene) << scene.error().message();
        EXPECT_EQ(scene->name, entry.path().stem().string());
        ++count;
    }
    EXPECT_GE(count, 6);
    EXPECT_TRUE(std::holds_alternative<NoPart>(load_scene(folder / "empty.toml")->part));
    EXPECT_EQ(std::get<DoubleConvexLens>(load_scene(folder / "cut.toml")->part).radius_of_curvature_mm, 190);
    EXPECT_EQ(std::get<SphericalCut>(load_scene(folder / "cut.toml")->defects.at(0)).centre_mm.x, -4.5);
    EXPECT_EQ(std::get<AbsorbingSpeck>(load_scene(folder / "speck.toml")->defects.at(0)).transmission, 0);
}

TEST(SceneFile, a_file_without_keys_is_an_empty_field_with_every_default) {
    const auto scene = read("# all defaults\n");
    ASSERT_TRUE(scene) << scene.error().message();
    EXPECT_TRUE(std::holds_alternative<NoPart>(scene->part));
    EXPECT_EQ(scene->camera.extents, (algo::Extents{111, 111, 9, 9}));
}

TEST(SceneFile, every_problem_is_reported_at_once_with_file_line_and_cure) {
    const auto scene = read(R"([part]
kind = "double-convex"
radius_of_curvature_mm = -190
apertur_radius_mm = 10
[[defect]]
kind = "bubble"
radius_mm = 0
[[defect]]
kind = "grease"
[[defect]]
centre_mm = [1, 2]
[camera]
m = 2
bits = 20
[noise]
read_e = 3
)");
    ASSERT_FALSE(scene);
    EXPECT_EQ(scene.error().code, ErrorCode::invalid_argument);
    const std::string what = scene.error().message();
    EXPECT_THAT(what, HasSubstr("toml:3: part.radius_of_curvature_mm: -190 is out of range"));
    EXPECT_THAT(what,
                HasSubstr("toml:4: part.apertur_radius_mm: is not a known key: did you mean aperture_radius_mm?"));
    EXPECT_THAT(what, HasSubstr(":7: "));
    EXPECT_THAT(what, HasSubstr("radius_mm: 0 is out of range"));
    EXPECT_THAT(what,
                HasSubstr("\"grease\" is not known: use one of bubble, cut, speck, inclusion, scratch, absorber, "
                          "stria, haze, dimple"));
    EXPECT_THAT(what, HasSubstr("name the kind of defect"));
    EXPECT_THAT(what, HasSubstr(":13: camera.m: 2 is out of range: use 3 to 2048"));
    EXPECT_THAT(what, HasSubstr(":14: camera.bits: 20 is out of range: use 8 to 16"));
    EXPECT_THAT(what, HasSubstr(":16: noise.read_e: is in electrons and needs electrons_per_dn"));
}

TEST(SceneFile, unknown_keys_impossible_geometry_and_contradictions_come_together) {
    const auto scene = read(R"([part]
kind = "double-convex"
radius_of_curvature_mm = -190
colour = "blue"
[pose]
x_mm = 40
[[defect]]
kind = "absorber"
opaque = true
absorption_per_mm = 2
[camera.array]
pitch_px = 3
[effects]
ghosts = true
)");
    ASSERT_FALSE(scene);
    const std::string what = scene.error().message();
    EXPECT_THAT(what, HasSubstr(".toml:3: part.radius_of_curvature_mm: -190 is out of range: use 1e-06 to 10000"));
    EXPECT_THAT(what, HasSubstr(".toml:4: part.colour: is not a known key"));
    EXPECT_THAT(what, HasSubstr(".toml:6: pose.x_mm: "));
    EXPECT_THAT(what, HasSubstr("outside the field"));
    EXPECT_THAT(what, HasSubstr(".toml:10: defect[0].absorption_per_mm: contradicts opaque = true: name one of them"));
    EXPECT_THAT(what,
                HasSubstr(".toml:12: camera.array.pitch_px: makes a bin of 0.333333 pixels: a lenslet too fine for its "
                          "bins: use at least 4.5"));
    EXPECT_THAT(what, HasSubstr(".toml:14: effects.ghosts: "));
    EXPECT_THAT(what, HasSubstr("fresnel"));
}

std::string text_of(const std::filesystem::path& file) {
    std::ifstream in(std::filesystem::path(HORD_SOURCE_DIR) / file);
    return {std::istreambuf_iterator<char>(in), {}};
}
std::set<std::string> matches(const std::string& text, const char* pattern) {
    const std::regex expression(pattern);
    std::set<std::string> found;
    for (auto it = std::sregex_iterator(text.begin(), text.end(), expression); it != std::sregex_iterator(); ++it)
        found.insert((*it)[1]);
    return found;
}

// docs/scene.md names exactly the keys that are read.
TEST(SceneFile, the_documented_keys_are_those_that_are_read) {
    const std::string page = text_of("docs/scene.md"),
                      parser = text_of("hal_sim/optics/scene/scene_fields.h") +
        text_of("hal_sim/optics/scene/scene_file.cpp");
    const auto read_keys = matches(
        parser,
        R"re((?:number\w*|vector|pair|integer|boolean|text|numbers|choice|table|tables|tables\w*)\((?:\w+, )?"(\w+)")re");
    ASSERT_GT(read_keys.size(), 80U);
    for (const std::string& key : read_keys) {
        const bool named = page.find('`' + key + '`') != std::string::npos ||
            page.find(key + "]") != std::string::npos || page.find('\n' + key + " = ") != std::string::npos;
        EXPECT_TRUE(named) << key << " is read and not documented";
    }
    const auto documented = matches(
        page,
        R"re(`(\w+_(?:mm|um|nm|rad|px|us|ms|e|dn|bins|index|number|length|share|seed|per_mm|per_dn|per_s|mm_s|well_e|side|face|noise|difference|lens))`)re");
    ASSERT_GT(documented.size(), 60U);
    for (const std::string& key : documented) {
        EXPECT_TRUE(parser.find('"' + key + '"') != std::string::npos) << key << " is documented and not read";
    }
}

TEST(SceneFile, impossible_geometry_is_refused) {
    const auto problem = [](const std::string& text) {
        const auto scene = read(text);
        return scene ? std::string("accepted") : scene.error().message();
    };
    EXPECT_THAT(problem("[part]\nkind = \"double-convex\"\naperture_radius_mm = 200\n"),
                HasSubstr("larger than the radius of curvature"));
    EXPECT_THAT(problem("[part]\nkind = \"wedge\"\ntilt_x_rad = 0.3\ntilt_y_rad = 0.3\n"),
                HasSubstr("faces meet inside the part"));
    EXPECT_THAT(problem("[part]\nkind = \"wedge\"\n[pose]\nx_mm = 40\n"), HasSubstr("outside the field"));
    EXPECT_THAT(problem("[[defect]]\nkind = \"bubble\"\n"), HasSubstr("needs a part"));
    EXPECT_THAT(problem("[part]\nkind = \"wedge\"\nrefractive_index = 0.5\n"), HasSubstr("out of range: use 1 to 4"));
    EXPECT_THAT(problem("[camera]\nbits = 8\nfull_bin_dn = 300\n"),
                HasSubstr("camera.full_bin_dn: 300 is out of range: use 1 to 255"));
    EXPECT_THAT(problem("[camera]\nfield_mm = nan\n"), HasSubstr("field_mm"));
}

TEST(SceneFile, a_missing_file_is_named) {
    const auto scene = load_scene("/nonexistent/scene.toml");
    ASSERT_FALSE(scene);
    EXPECT_THAT(scene.error().message(), HasSubstr("/nonexistent/scene.toml"));
}

TEST(Scene, one_that_cannot_be_is_not_rendered) {
    Scene scene;
    scene.camera.extents = {2, 3, 9, 9};
    scene.part = DoubleConvexLens{190, -1, 4, 1.5};
    const auto field = render(scene);
    ASSERT_FALSE(field);
    EXPECT_EQ(field.error().code, ErrorCode::invalid_argument);
    EXPECT_THAT(field.error().what, HasSubstr("camera.m: 2 is out of range"));
    EXPECT_THAT(field.error().what, HasSubstr("part.aperture_radius_mm: -1 is out of range"));
}

}  // namespace
}  // namespace hord::sim
