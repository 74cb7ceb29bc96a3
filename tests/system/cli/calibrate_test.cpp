// `hordctl calibrate`, `inspect --grid` and `soak` as a person meets them.
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/calib/support/synthetic.h"
#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

std::filesystem::path photographs() {
    const auto data = real_data() / "lenslet";
    return std::filesystem::is_directory(data) ? data : std::filesystem::path();
}

// A 16-bit PGM.
void write_pgm(const std::string& path, const Frame& frame) {
    std::ofstream out(path, std::ios::binary);
    out << "P5\n" << frame.width_px() << ' ' << frame.height_px() << "\n65535\n";
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const std::uint32_t sample = frame.view().sample(x, y);
            out.put(static_cast<char>(sample >> 8U)).put(static_cast<char>(sample & 0xFFU));
        }
    }
}

TEST(Calibrate, a_real_sensor_is_calibrated_and_its_object_frame_decoded) {
    const auto data = photographs();
    if (data.empty()) GTEST_SKIP() << "no real input: set HORD_DATA, or put it at ../shared/data";
    const TemporaryFolder folder;
    const Said said = run("hordctl",
                          {"calibrate", data / "lf_sq_napariLF_white.png", "--dark", data / "lf_sq_napariLF_dark.png",
                           "--out", folder / "grid.toml", "--centres", folder / "centres.csv", "--json"});
    ASSERT_EQ(said.status, 0) << said.err;
    const Json json = Json::parse(said.out);
    EXPECT_EQ(json["lattice"], "square");
    EXPECT_NEAR(json["pitch_px"].get<double>(), 15.4, 0.1);
    std::ifstream centres(folder / "centres.csv");
    std::string header;
    std::getline(centres, header);
    EXPECT_EQ(header, "m,n,x_px,y_px");

    const Said object = run("hordctl",
                            {"inspect", data / "lf_sq_napariLF_object.png", "--grid", folder / "grid.toml", "--feature",
                             "emd", "--out", folder / "maps", "--json"});
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

TEST(Calibrate, a_worse_calibration_is_not_installed_over_a_better_one) {
    const TemporaryFolder folder;
    calib::test::White white{.width_px = 300, .height_px = 300, .pitch_px = 20, .rotation_deg = 1};
    write_pgm(folder / "good.pgm", calib::test::draw(white).frame);
    white.electrons_per_dn = 0.005;  // a hundred electrons a pixel
    write_pgm(folder / "noisy.pgm", calib::test::draw(white).frame);
    const std::string grid = folder / "grid.toml";
    const Said first =
        run("hordctl", {"calibrate", folder / "good.pgm", "--out", grid, "--pictures", folder / "pictures"});
    ASSERT_EQ(first.status, 0) << first.err;
    for (const char* name : {"residuals.png", "centres.png", "models.png"})
        EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(folder / "pictures") / name)) << name;
    const auto read = [&] {
        std::ifstream in(grid);
        return std::string(std::istreambuf_iterator<char>(in), {});
    };
    const std::string before = read();
    const Said second = run("hordctl", {"calibrate", folder / "noisy.pgm", "--out", grid});
    EXPECT_EQ(second.status, 2);
    EXPECT_THAT(second.err, HasSubstr("better"));
    EXPECT_EQ(read(), before);
    EXPECT_EQ(run("hordctl", {"calibrate", folder / "noisy.pgm", "--out", grid, "--force"}).status, 0);
    EXPECT_NE(read(), before);
    std::ofstream(folder / "notes.toml") << "mine\n";
    EXPECT_EQ(run("hordctl", {"calibrate", folder / "good.pgm", "--out", folder / "notes.toml"}).status, 2);
}

TEST(Calibrate, that_of_another_camera_is_not_overwritten_unless_it_is_asked_for) {
    const TemporaryFolder folder;
    write_pgm(folder / "white.pgm",
              calib::test::draw({.width_px = 300, .height_px = 300, .pitch_px = 20, .rotation_deg = 1}).frame);
    const std::string grid = folder / "grid.toml";
    const auto calibrate = [&](std::vector<std::string> more) {
        more.insert(more.begin(), {"calibrate", folder / "white.pgm", "--out", grid});
        return run("hordctl", more);
    };
    const auto read = [&] {
        std::ifstream in(grid);
        return std::string(std::istreambuf_iterator<char>(in), {});
    };
    ASSERT_EQ(calibrate({"--camera", "A"}).status, 0);
    EXPECT_EQ(calibrate({"--camera", "A"}).status, 0);
    const std::string before = read();
    const Said other = calibrate({"--camera", "B"});
    EXPECT_EQ(other.status, 2);
    EXPECT_THAT(other.err,
                AllOf(HasSubstr(grid), HasSubstr("of camera A"), HasSubstr("of camera B"), HasSubstr("another --out"),
                      HasSubstr("--force")));
    const Said unnamed = calibrate({});
    EXPECT_EQ(unnamed.status, 2);
    EXPECT_THAT(unnamed.err, AllOf(HasSubstr("of camera A"), HasSubstr("--camera")));
    EXPECT_EQ(read(), before);
    EXPECT_EQ(calibrate({"--camera", "B", "--force"}).status, 0);
    EXPECT_THAT(read(), HasSubstr("identity = \"B\""));
}

TEST(Calibrate, what_is_unusual_is_said_and_what_is_no_white_frame_is_refused) {
    const TemporaryFolder folder;
    calib::test::White white{.width_px = 300, .height_px = 300, .pitch_px = 20, .rotation_deg = 1};
    white.light = [](double x, double y) { return x > 150 && y > 150 ? 0.0 : 1.0; };
    write_pgm(folder / "quarter.pgm", calib::test::draw(white).frame);
    const Said quarter = run("hordctl", {"calibrate", folder / "quarter.pgm", "--out", folder / "grid.toml", "--json"});
    EXPECT_EQ(quarter.status, 0) << quarter.err;
    EXPECT_THAT(quarter.err, HasSubstr("warning: "));
    EXPECT_THAT(Json::parse(quarter.out)["warnings"].dump(), HasSubstr("have no centre"));

    Frame board(300, 300, 16);
    for (int y = 0; y < 300; ++y) {
        for (int x = 0; x < 300; ++x) board.set(x, y, ((x / 14 + y / 14) & 1) != 0 ? 20000 : 200);
    }
    write_pgm(folder / "board.pgm", board);
    const Said refused = run("hordctl", {"calibrate", folder / "board.pgm", "--out", folder / "none.toml"});
    EXPECT_EQ(refused.status, 2);
    EXPECT_THAT(refused.err, HasSubstr("checkerboard"));
    EXPECT_FALSE(std::filesystem::exists(folder / "none.toml"));
}

TEST(Calibrate, captures_at_known_tilts_give_radians) {
    const TemporaryFolder folder;
    std::filesystem::create_directory(folder / "tilts");
    calib::test::White white{.width_px = 300, .height_px = 300, .pitch_px = 24, .rotation_deg = 1};
    write_pgm(folder / "white.pgm", calib::test::draw(white).frame);
    const double px_a_rad = 200;
    const auto capture = [&](const std::string& name, double x_rad, double y_rad) {
        calib::test::White spots = white;
        spots.disc_radius_px = -1.4;
        spots.offset_x_px += 0.5 + px_a_rad * x_rad;
        spots.offset_y_px += px_a_rad * y_rad;
        write_pgm(folder / ("tilts/" + name), calib::test::draw(spots).frame);
    };
    std::ofstream list(folder / "tilts/tilts.toml");
    list << "empty = \"empty.pgm\"\n";
    capture("empty.pgm", 0, 0);
    const std::pair<double, double> tilts[] = {{0.03, 0}, {0, 0.03}, {-0.03, -0.02}, {0.02, -0.03}};
    for (int k = 0; k < 4; ++k) {
        const std::string name = std::to_string(k) + ".pgm";
        capture(name, tilts[k].first, tilts[k].second);
        list << "[[tilt]]\nframe = \"" << name << "\"\nx_rad = " << tilts[k].first << "\ny_rad = " << tilts[k].second
             << "\n";
    }
    list.close();
    const Said said =
        run("hordctl",
            {"calibrate", folder / "white.pgm", "--tilts", folder / "tilts", "--out", folder / "grid.toml", "--json"});
    ASSERT_EQ(said.status, 0) << said.err;
    const Json directions = Json::parse(said.out)["directions"];
    EXPECT_NEAR(directions["scale_px_a_rad"].get<double>(), px_a_rad, 1);
    EXPECT_NEAR(directions["zero_px"]["x"].get<double>(), 0.5, 0.02);
    EXPECT_LE(directions["left_out_px"]["rms_x"].get<double>(), 0.02);

    const Said seen =
        run("hordctl", {"inspect", folder / "white.pgm", "--grid", folder / "grid.toml", "--feature", "emd", "--json"});
    EXPECT_NE(seen.status, 2) << seen.err;
    EXPECT_NEAR(Json::parse(seen.out)["feature"]["bin_rad"].get<double>(), 24.0 / 9 / px_a_rad, 1e-4);
    EXPECT_EQ(Json::parse(seen.out)["calibration"]["file"], folder / "grid.toml");
    EXPECT_EQ(Json::parse(seen.out)["calibration"]["crc32"].get<std::string>().size(), 8U);

    // Tilts along one line do not determine the direction across it.
    std::ofstream line(folder / "tilts/tilts.toml");
    line << "empty = \"empty.pgm\"\n";
    for (int k = 0; k < 3; ++k) line << "[[tilt]]\nframe = \"0.pgm\"\nx_rad = 0.03\ny_rad = 0\n";
    line.close();
    const Said refused = run(
        "hordctl", {"calibrate", folder / "white.pgm", "--tilts", folder / "tilts", "--out", folder / "other.toml"});
    EXPECT_EQ(refused.status, 2);
    EXPECT_THAT(refused.err, HasSubstr("one line"));
    EXPECT_FALSE(std::filesystem::exists(folder / "other.toml"));
}

TEST(Soak, a_short_one_keeps_every_promise_and_the_same_seed_gives_the_same_run) {
    const std::vector<std::string> arguments{"soak", "--parts", "20000", "--seed", "5"};
    const Said first = run("hord-lab", arguments);
    EXPECT_EQ(first.status, 0) << first.out << first.err;
    EXPECT_EQ(first.out, run("hord-lab", arguments).out);
}

// Half of all episodes have a seed above the largest signed number.
TEST(Soak, every_episode_that_a_violation_names_can_be_run_again) {
    const auto episode = [](const char* seed) {
        return run("hord-lab", {"soak", "--parts", "10", "--line", "timed", "--episode", seed});
    };
    EXPECT_EQ(episode("18446744073709551615").status, 0);
    const Said refused = episode("18446744073709551616");
    EXPECT_EQ(refused.status, 2);
    EXPECT_THAT(refused.err, HasSubstr("18446744073709551616 is out of range"));
}

}  // namespace
}  // namespace hord::test
