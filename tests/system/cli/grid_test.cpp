// A station whose sensor delivers raw frames of a turned, distorted, hexagonal lenslet array: calibrated, decoded,
// watched for drift.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "drivers/files/frame_file.h"
#include "firmware/registers/register_client.h"
#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

constexpr auto kPatience = std::chrono::seconds(120);
constexpr std::uint32_t kGridDrift = 1U << 12U;

// The frames of one array, rendered once for all tests: `white` for the calibration, `lens` a good part, `moved` the
// same after the array moved by 0.15 px, `bubble` a bad one.
class RawFrames : public ::testing::Test {
  protected:
    static void SetUpTestSuite() {
        rendered = new TemporaryFolder;
        render("white", 3.9, "", 0.4);
        const std::string lens =
            "[part]\nkind = \"double-convex\"\nradius_of_curvature_mm = 500\naperture_radius_mm = 8\n";
        render("lens", 0.9, lens, 0.4);
        render("moved", 0.9, lens, 0.55);
        render("dim", 3.9, "", 0.4, 0.1);
        render("bubble", 0.9, lens + "[[defect]]\nkind = \"bubble\"\ncentre_mm = [1, 1, 0]\nradius_mm = 0.9\n", 0.4);
        const Said said = run("hordctl", {"calibrate", *rendered / "white.png", "--out", grid()});
        ASSERT_EQ(said.status, 0) << said.err;
        EXPECT_THAT(said.out, HasSubstr("hexagonal lattice"));
    }
    static void TearDownTestSuite() {
        delete rendered;
        rendered = nullptr;
    }
    static void render(const std::string& name, double source_radius_bins, const std::string& part, double offset_x_px,
                       double electrons_per_dn = 40) {
        std::ofstream(*rendered / (name + ".toml"))
            << part << "[light]\nsource_radius_bins = " << source_radius_bins
            << "\n[camera]\nm = 47\nn = 54\nfull_bin_dn = 230\n[camera.array]\nlattice = \"hexagonal\"\npitch_px = "
               "14.3\nrotation_rad = 0.05\n"
               "distortion = 0.004\nwidth_px = 620\nheight_px = 600\noffset_px = ["
            << offset_x_px << ", -0.7]\n[noise]\nelectrons_per_dn = " << electrons_per_dn << "\nread_e = 2\n";
        const Said said = run("hord-lab",
                              {"render", *rendered / (name + ".toml"), "--out", *rendered / (name + ".macro.png"),
                               "--raw", *rendered / (name + ".png")});
        ASSERT_EQ(said.status, 0) << said.err;
    }
    static std::string grid() { return *rendered / "grid.toml"; }

    // Frames of these names one after the other in a folder, and a configuration that plays them.
    std::string config_of(const std::vector<std::string>& frames, const std::string& calibration) const {
        std::filesystem::create_directories(folder / "frames");
        for (std::size_t k = 0; k < frames.size(); ++k) {
            std::filesystem::copy(*rendered / (frames[k] + ".png"),
                                  folder / ("frames/" + std::to_string(1000 + k) + ".png"));
        }
        std::ofstream(folder / "c.toml") << simulated_beside(
            "[modbus]\nport = 0\n[line]\nexposure_delay_ms = 100\n[sensor]\nbackend = \"frames\"\nfolder = "
            "\"frames\"\n[inspection]\ngrid = \"" +
            calibration + "\"\n");
        return folder / "c.toml";
    }

    static inline TemporaryFolder* rendered = nullptr;
    TemporaryFolder folder;
};

TEST_F(RawFrames, of_good_and_bad_parts_get_their_verdicts_from_the_running_station) {
    const std::string config = config_of({"lens", "bubble", "lens", "lens", "bubble", "lens"}, grid());
    const Said said = run("hordctl", {"run", "--config", config, "--json"}, kPatience);
    EXPECT_EQ(said.status, 0) << said.err;
    std::istringstream lines(said.out);
    int judged = 0;
    for (std::string line; std::getline(lines, line);) {
        if (line.empty() || line.front() != '{') continue;
        const Json part = Json::parse(line);
        const int number = part["part"].get<int>();
        if (part["verdict"] == "unfit")
            continue;  // the busy machine was late with the light: rejected without inspection
        ++judged;
        EXPECT_EQ(part["verdict"], number == 2 || number == 5 ? "reject" : "pass") << part;
    }
    EXPECT_GE(judged, 1) << said.out << said.err;
    // hordctl inspect returns the same result.
    EXPECT_EQ(run("hordctl", {"inspect", *rendered / "lens.png", "--grid", grid()}).status, 0);
    EXPECT_EQ(run("hordctl", {"inspect", *rendered / "bubble.png", "--grid", grid()}).status, 1);
}

TEST_F(RawFrames, of_an_array_that_has_moved_raise_the_fault_and_good_parts_still_pass) {
    const std::string config = config_of(std::vector<std::string>(300, "moved"), grid());
    Running station("hordctl", {"run", "--config", config, "--rate", "20", "--json"});
    ASSERT_TRUE(station.says("registers at 127.0.0.1:", kPatience)) << station.so_far().err;
    const std::string said = station.so_far().err;
    const auto at = said.find("127.0.0.1:") + 10;
    auto client = firmware::modbus::Client::connect(
        {"127.0.0.1", static_cast<std::uint16_t>(std::stoi(said.substr(at)))}, std::chrono::seconds(20));
    ASSERT_TRUE(client) << client.error().message();
    const auto calibration = client->read(8502, 8);
    ASSERT_TRUE(calibration);
    EXPECT_NE((*calibration)[0] | (*calibration)[1], 0);  // its identification
    EXPECT_LT((*calibration)[3], 600);                    // s since it was made
    EXPECT_GT((*calibration)[6], 30);                     // lenslets
    EXPECT_GT((*calibration)[7], 30);

    ASSERT_TRUE(station.says("since the calibration", kPatience)) << station.so_far().err;
    const auto until = std::chrono::steady_clock::now() + kPatience;
    std::uint32_t faults = 0;
    while ((faults & kGridDrift) == 0 && std::chrono::steady_clock::now() < until) {
        const auto words = client->read(113, 2);
        if (!words) break;
        faults = std::uint32_t{(*words)[0]} << 16U | (*words)[1];
    }
    EXPECT_NE(faults & kGridDrift, 0U) << station.so_far().err;
    const auto drift = client->read(8507, 1);
    ASSERT_TRUE(drift);
    EXPECT_NEAR((*drift)[0], 150, 50);  // thousandths of a pixel
    const Said all = station.stop(SIGINT);
    EXPECT_EQ(all.out.find("\"reject\",\"reason\""), std::string::npos) << all.out;
    EXPECT_NE(all.out.find("\"pass\""), std::string::npos);
}

TEST_F(RawFrames, of_another_size_than_the_calibration_are_refused) {
    std::ofstream(folder / "broken.toml") << "version = 1\n";
    EXPECT_EQ(run("hordctl", {"run", "--config", config_of({"lens"}, "broken.toml")}).status, 2);
    std::filesystem::remove_all(folder / "frames");
    // The frame of macro-pixels without its geometry note: only the size tells.
    const auto macro = drivers::read_frame(*rendered / "lens.macro.png");
    ASSERT_TRUE(macro);
    ASSERT_TRUE(drivers::write_frame(*rendered / "silent.png", macro->view()));
    const Said said = run("hordctl", {"run", "--config", config_of({"silent"}, grid())});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("grid.toml"));
    EXPECT_THAT(said.err, HasSubstr("620x600"));
    EXPECT_THAT(said.err, HasSubstr("423x486"));
}

TEST_F(RawFrames, and_frames_of_macro_pixels_are_told_apart_by_what_they_say) {
    const auto expect = [](const Said& said, const std::vector<std::string>& words) {
        EXPECT_EQ(said.status, 2) << said.out;
        for (const std::string& word : words) EXPECT_THAT(said.err, HasSubstr(word));
    };
    const std::string macro = *rendered / "lens.macro.png", raw = *rendered / "lens.png";
    expect(run("hordctl", {"run", "--config", config_of({"lens.macro"}, grid())}),
           {"1000.png says macro-pixels of 9x9 bins", "inspection.grid", "grid.toml", "leave inspection.grid out"});
    std::filesystem::remove_all(folder / "frames");
    expect(run("hordctl", {"run", "--config", config_of({"lens"}, "")}),
           {"1000.png says a raw frame of 8 bits", "inspection.grid names no calibration"});
    expect(run("hordctl", {"inspect", macro, "--grid", grid()}),
           {macro + " says macro-pixels of 9x9 bins, 47x54 lenslets", "--grid " + grid(), "leave --grid out"});
    expect(run("hordctl", {"inspect", raw}), {raw + " says a raw frame of 8 bits", "give --grid"});
    expect(run("hordctl", {"calibrate", macro, "--out", folder / "no.toml"}),
           {macro + " says macro-pixels", "a calibration needs a raw frame"});
    expect(run("hordctl", {"calibrate", *rendered / "white.png", "--dark", macro, "--out", folder / "no.toml"}),
           {macro});
    EXPECT_FALSE(std::filesystem::exists(folder / "no.toml"));
}

// After a restart the service still knows which calibration it has used.
TEST_F(RawFrames, are_not_decoded_with_a_worse_calibration_than_before) {
    const std::string hordd = std::string(HORD_BIN_DIR) + "/hordd";
    std::filesystem::create_directory(folder / "state");
    const auto start = [&](const std::string& calibration) {
        std::filesystem::remove_all(folder / "frames");
        return std::vector<std::string>{"STATE_DIRECTORY=" + (folder / "state"), hordd, "--config",
                                        config_of({"lens"}, calibration)};
    };
    {
        Running service("/usr/bin/env", start(grid()));
        ASSERT_TRUE(service.says("registers at", kPatience)) << service.so_far().err;
        EXPECT_EQ(service.stop(SIGTERM).status, 0);
    }
    EXPECT_TRUE(std::filesystem::exists(folder / "state/calibration-in-use.toml"));
    // A calibration from a frame with few electrons (high shot noise).
    const Said dim = run("hordctl", {"calibrate", *rendered / "dim.png", "--out", folder / "worse.toml"});
    ASSERT_EQ(dim.status, 0) << dim.err;
    const Said said = run("/usr/bin/env", start(folder / "worse.toml"));
    EXPECT_EQ(said.status, 78);
    EXPECT_THAT(said.err, HasSubstr("worse.toml"));
    EXPECT_THAT(said.err, HasSubstr("better"));
    EXPECT_THAT(said.err, HasSubstr("calibration-in-use.toml"));
}

// The commands of docs/scene.md.
TEST(WhiteFrame, of_the_simulated_cell_is_calibrated_and_raw_frames_are_read_through_it) {
    const std::filesystem::path source = HORD_SOURCE_DIR;
    std::ifstream page(source / "docs/scene.md");
    std::string commands, line;
    while (std::getline(page, line) && line != "## A white frame, and raw frames") {
    }
    while (std::getline(page, line) && !line.starts_with("##"))
        if (line.starts_with("    ")) commands += line + "\n";
    ASSERT_EQ(std::ranges::count(commands, '\n'), 6) << commands;
    const TemporaryFolder folder;
    std::filesystem::create_symlink(source / "hal_sim", folder / "hal_sim");
    const Said said =
        run("/bin/bash", {"-ec", "cd " + folder.path().string() + "; PATH=" HORD_BIN_DIR ":$PATH\n" + commands});
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.out, testing::AllOf(HasSubstr("hexagonal lattice"), HasSubstr("pass    none")));
}

}  // namespace
}  // namespace hord::test
