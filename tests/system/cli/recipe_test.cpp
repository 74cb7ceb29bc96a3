// `hordctl recipe`: what a folder holds, what is wrong with a file, and seals. Folders in place of files.
#include <fstream>
#include <sstream>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;

constexpr const char* kLimits = "[limits]\nemd_bins = 0.5\nfrobenius_bins = 0.5\ntransmission = 0.8\n";

void write(const std::string& file, const std::string& text) { std::ofstream(file) << text; }
std::string text_of(const std::string& file) {
    std::ifstream in(file);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
}

TEST(Recipes, of_a_folder_are_listed_with_what_a_plc_must_know_and_bad_ones_are_named) {
    const TemporaryFolder folder;
    write(folder / "a.toml", "schema = 1\nname = \"bottle\"\nnumber = 7\nversion = 3\n");
    EXPECT_EQ(run("hordctl", {"recipe", "list", folder.path().string()}).status, 0);
    write(folder / "b.toml", "nmae = \"vial\"\n");
    const Said said = run("hordctl", {"recipe", "list", folder.path().string()});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.out, HasSubstr("bottle"));
    EXPECT_THAT(said.err, HasSubstr("b.toml:1"));
    write(folder / "b.toml", "schema = 1\nnumber = 7\n");
    write(folder / "c.toml", "schema = 1\nnumber = 7\n");
    const std::string a = folder / "a.toml";
    EXPECT_EQ(run("hordctl", {"recipe", "list", folder.path().string()}).err,
              "hordctl: " + a + " and " + (folder / "b.toml") + " both have number 7, " + a + " and " +
                  (folder / "c.toml") + " both have number 7: give each recipe a number of its own\n");
}

TEST(Recipes, that_are_sealed_are_refused_once_somebody_changed_what_they_say_but_not_how) {
    const TemporaryFolder folder;
    const std::string file = folder / "a.toml";
    write(file, "# ours\nschema = 1\nname = \"bottle\"\n[limits]\nemd_bins = 0.9\n");
    EXPECT_EQ(run("hordctl", {"recipe", "seal", file}).status, 0);
    EXPECT_EQ(run("hordctl", {"recipe", "seal", file}).status, 0);  // again: one seal
    EXPECT_EQ(run("hordctl", {"recipe", "check", file}).status, 0);
    const std::string sealed = text_of(file);
    EXPECT_THAT(sealed, HasSubstr("# ours"));
    EXPECT_EQ(sealed.find("crc32"), sealed.rfind("crc32"));
    write(file, sealed + "# a remark\nmin_area = 1\n");  // the default, written out
    EXPECT_EQ(run("hordctl", {"recipe", "check", file}).status, 0);
    write(file, sealed + "min_area = 2\n");
    const Said said = run("hordctl", {"recipe", "check", file});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("sealed"));
}

TEST(Recipes, that_single_frames_cannot_judge_in_full_are_noted_and_can_be_used) {
    const TemporaryFolder folder;
    const std::string file = folder / "a.toml";
    const auto checked = [&](const std::string& text) {
        write(file, "schema = 1\n" + text);
        const Said said = run("hordctl", {"recipe", "check", file});
        EXPECT_EQ(said.status, 0) << said.err;
        return said.out;
    };
    EXPECT_THAT(
        checked("[part]\nform = \"tube\"\n"),
        HasSubstr("a.toml: note: the flanks and ends of a tube are not judged without a reference, holes and cracks in "
                  "its wall can pass, and so can slopes that are alike along its whole length and on both sides of its "
                  "axis; good tubes whose walls hardly bend light, or with few lenslets across, can be unfit or "
                  "rejected: learn one with `hordctl learn`\n"));
    EXPECT_THAT(checked("[part]\nform = \"web\"\n"), HasSubstr("note: whether a part is there is not checked"));
    EXPECT_THAT(checked("[part]\nform = \"plate\"\n"), HasSubstr("note: a plate is found by its edges"));
    EXPECT_THAT(checked("[limits]\nmin_area = 12321\n"), HasSubstr("note: defects of fewer than 12321 lenslets pass"));
    EXPECT_THAT(checked("[light]\nmin_sum_dn = 100000\n"), HasSubstr("such frames are refused"));
    EXPECT_THAT(checked("[reference]\nreject_score = 8\n"),
                HasSubstr("note: the scores of [reference] change nothing"));
    EXPECT_THAT(checked("[reference]\n"), HasSubstr("note: [reference] changes nothing, because it names no file"));
    EXPECT_THAT(checked("[light]\ndark_dn = 200\n"), HasSubstr("note: dark_dn takes 200 of 255 DN"));
    EXPECT_THAT(checked("name = \"bottle\"\n[limits]\nemd_bins = 0.5\n"),
                HasSubstr("note: [limits] does not set frobenius_bins, transmission: the defaults count"));
    const std::string usual = checked(std::string("name = \"bottle\"\n") + kLimits);
    EXPECT_THAT(usual, HasSubstr("a.toml: note: a round part is compared with itself: small holes"));
    EXPECT_EQ(usual.find("note:"), usual.rfind("note:")) << usual;
}

TEST(Recipes, are_noted_by_a_check_of_the_configuration_once) {
    const TemporaryFolder folder;
    std::filesystem::create_directory(folder / "recipes");
    write(folder / "recipes/plate.toml", std::string("schema = 1\n[part]\nform = \"plate\"\n") + kLimits);
    write(folder / "recipes/web.toml", "schema = 1\nnumber = 2\n[part]\nform = \"web\"\n");
    write(folder / "recipes/bad.toml", "garbage\n");
    write(folder / "c.toml",
          simulated_beside("[inspection]\nrecipe = \"recipes/plate.toml\"\nrecipes = \"recipes\"\n"));
    const Said said = run("hordd", {"--check", "--config", folder / "c.toml"});
    EXPECT_EQ(said.status, 0) << said.err;
    const auto plate = said.out.find("plate.toml: note: a plate is found by its edges");
    EXPECT_NE(plate, std::string::npos) << said.out;
    EXPECT_EQ(said.out.find("plate.toml: note:", plate + 1), std::string::npos) << said.out;
    EXPECT_THAT(said.out, HasSubstr("web.toml: note: whether a part is there is not checked"));
    EXPECT_THAT(said.out,
                HasSubstr("note: a recipe that cannot be selected: " + (folder / "recipes/bad.toml") + ":1: "));
}

TEST(Recipes, of_the_package_can_be_used) {
    EXPECT_EQ(run("hordctl", {"recipe", "list", std::string(HORD_SOURCE_DIR) + "/deploy/recipes"}).status, 0);
}

TEST(Programs, a_folder_in_place_of_a_file_is_an_error_that_names_it) {
    const TemporaryFolder folder;
    std::filesystem::create_directory(folder / "x.toml");
    const std::string x = folder / "x.toml";
    const std::string with_recipe = folder / "with_recipe.toml";
    std::ofstream(with_recipe) << simulated_beside("[inspection]\nrecipe = \"" + x + "\"\n");
    const std::vector<std::pair<std::string, std::vector<std::string>>> commands = {
        {"hordd", {"--check", "--config", x}},
        {"hordd", {"--check", "--config", with_recipe}},
        {"hord-safe", {"--config", x}},
        {"hord-page", {"--check", "--config", x}},
        {"hord-mqtt", {"--check", "--config", x}},
        {"hordctl", {"recipe", "check", x}},
        {"hordctl", {"recipe", "seal", x}},
        {"hordctl", {"recipe", "list", folder.path().string()}},
        {"hordctl", {"replay", "--recipe", x, "--store", folder.path().string()}},
        {"hordctl", {"inspect", x, "--grid", x}},
        {"hord-lab", {"render", x, "--out", folder / "o.png"}},
    };
    for (const auto& [program, arguments] : commands) {
        const Said said = run(program, arguments);
        EXPECT_TRUE(said.status == 2 || said.status == 78) << program << " " << arguments[0] << ": " << said.status;
        EXPECT_THAT(said.err, HasSubstr("x.toml"));
        EXPECT_EQ(said.err.find("please report"), std::string::npos) << said.err;
        EXPECT_EQ(said.err.find("Success"), std::string::npos) << said.err;
        EXPECT_EQ(said.err.rfind(std::filesystem::path(program).filename().string() + ": ", 0), 0U) << said.err;
    }
}

}  // namespace
}  // namespace hord::test
