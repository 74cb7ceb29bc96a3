// `hordctl calibrate`, `inspect --grid` and `soak` as a person meets them.
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

std::filesystem::path photographs() {
    const auto data = real_data() / "lenslet";
    return std::filesystem::is_directory(data) ? data : std::filesystem::path();
}

TEST(Calibrate, a_real_sensor_is_calibrated_and_its_object_frame_decoded) {
    const auto data = photographs();
    if (data.empty()) GTEST_SKIP() << "no real input: set HORD_DATA, or put it at ../shared/data";
    const TemporaryFolder folder;
    const Said said = run("hordctl", {"calibrate", data / "lf_sq_napariLF_white.png", "--dark", data / "lf_sq_napariLF_dark.png", "--out",
                                      folder / "grid.toml", "--centres", folder / "centres.csv", "--json"});
    ASSERT_EQ(said.status, 0) << said.err;
    const Json json = Json::parse(said.out);
    EXPECT_EQ(json["lattice"], "square");
    EXPECT_NEAR(json["pitch_px"].get<double>(), 15.4, 0.1);
    std::ifstream centres(folder / "centres.csv");
    std::string header;
    std::getline(centres, header);
    EXPECT_EQ(header, "m,n,x_px,y_px");

    const Said object = run("hordctl", {"inspect", data / "lf_sq_napariLF_object.png", "--grid", folder / "grid.toml", "--out", folder / "maps", "--json"});
    EXPECT_NE(object.status, 2) << object.err;
    EXPECT_EQ(Json::parse(object.out)["grid"]["i"], 9);
    EXPECT_TRUE(std::filesystem::exists(folder / "maps/lf_sq_napariLF_object.emd.tiff"));

    // Only frames of that sensor can be decoded with its grid.
    const Said other = run("hordctl", {"inspect", data / "sh_sq_mmt_LED.png", "--grid", folder / "grid.toml"});
    EXPECT_EQ(other.status, 2);
    EXPECT_THAT(other.err, HasSubstr("sh_sq_mmt_LED.png"));
}

TEST(Calibrate, refuses_a_frame_without_a_lattice_and_writes_nothing) {
    const auto data = photographs();
    if (data.empty()) GTEST_SKIP() << "no real input: set HORD_DATA, or put it at ../shared/data";
    const TemporaryFolder folder;
    for (const char* name : {"sh_bad_mmt_mmirs_blank.png", "sh_bad_mmt_mmirs_bogus.png"}) {
        const Said said = run("hordctl", {"calibrate", data / name, "--out", folder / "grid.toml"});
        EXPECT_EQ(said.status, 2);
        EXPECT_THAT(said.err, HasSubstr(name));
        EXPECT_FALSE(std::filesystem::exists(folder / "grid.toml"));
    }
}

TEST(Calibrate, inspect_refuses_a_grid_file_that_is_missing_or_was_edited) {
    const TemporaryFolder folder;
    std::ofstream(folder / "grid.toml") << "version = 1\n";
    for (const std::string& grid : {folder / "none.toml", folder / "grid.toml"}) {
        const Said said = run("hordctl", {"inspect", "any.png", "--grid", grid});
        EXPECT_EQ(said.status, 2);
        EXPECT_THAT(said.err, HasSubstr(grid));
    }
}

TEST(Soak, a_short_one_keeps_every_promise_and_the_same_seed_gives_the_same_run) {
    const std::vector<std::string> arguments{"soak", "--parts", "20000", "--seed", "5"};
    const Said first = run("hordctl", arguments);
    EXPECT_EQ(first.status, 0) << first.out << first.err;
    EXPECT_EQ(first.out, run("hordctl", arguments).out);
}

}  // namespace
}  // namespace hord::test
