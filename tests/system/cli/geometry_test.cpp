// Frames say what their samples are: programs write it, and other programs compare it with their options.
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "drivers/files/frame_file.h"
#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;
using drivers::FrameGeometry;
using drivers::FrameKind;

// 27x18 lenslets of 5x5 bins, each with the same spot. 135x90 pixels can be read as 15x10 lenslets of 9x9 bins, too.
constexpr FrameGeometry kFive{FrameKind::macro_pixels, {27, 18, 5, 5}, 8};
constexpr FrameGeometry kNine{FrameKind::macro_pixels, {15, 10, 9, 9}, 8};

Frame spots(const FrameGeometry& g) {
    Frame frame(g.grid.width_px(), g.grid.height_px(), g.bits);
    const std::uint32_t unit = 1U << static_cast<unsigned>(g.bits - 8);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const int i = std::abs(x % g.grid.i - g.grid.i / 2), j = std::abs(y % g.grid.j - g.grid.j / 2);
            frame.set(x, y, (i + j == 0 ? 200U : i + j == 1 ? 50U : 0U) * unit);
        }
    }
    return frame;
}

class Told : public ::testing::Test {
  protected:
    std::string write(const std::string& name, const FrameGeometry& drawn,
                      const std::optional<FrameGeometry>& note) const {
        std::filesystem::create_directories((folder.path() / name).parent_path());
        EXPECT_TRUE(drivers::write_frame(folder / name, spots(drawn).view(), note));
        return folder / name;
    }
    std::string noted(const std::string& name, const FrameGeometry& g) const { return write(name, g, g); }
    // Refused: status 2, with all of these words.
    void refused(const std::vector<std::string>& arguments, const std::vector<std::string>& words) const {
        const Said said = run("hordctl", arguments);
        EXPECT_EQ(said.status, 2) << said.out;
        for (const std::string& word : words) EXPECT_THAT(said.err, HasSubstr(word));
    }
    TemporaryFolder folder;
};

// The commands in hal_sim/scenes/vial.toml give the verdicts that it promises.
TEST_F(Told, the_example_vial_is_rejected_for_its_bubble_by_its_recipe_and_a_good_one_passes) {
    const std::string scenes = std::string(HORD_SOURCE_DIR) + "/hal_sim/scenes/";
    for (const auto& [scene, status] : {std::pair{"vial", 1}, {"vial-filled", 0}}) {
        const std::string frame = folder / (std::string(scene) + ".png");
        ASSERT_EQ(run("hord-lab", {"render", scenes + scene + ".toml", "--out", frame}).status, 0) << scene;
        const Said said = run("hordctl", {"inspect", frame, "--recipe", scenes + "../recipes/vial.toml"});
        EXPECT_EQ(said.status, status) << said.out << said.err;
    }
}

TEST_F(Told, render_writes_what_inspect_reads) {
    std::ofstream(folder / "s.toml") << "[camera]\nm = 24\nn = 20\ni = 5\nj = 5\nfull_bin_dn = 200\n";
    const std::string frame = folder / "s.png", raw = folder / "raw.png";
    const Said drawn = run("hord-lab", {"render", folder / "s.toml", "--out", frame, "--raw", raw});
    ASSERT_EQ(drawn.status, 0) << drawn.err;
    EXPECT_THAT(drawn.err, testing::Not(HasSubstr("--seed")));
    EXPECT_THAT(run("hord-lab", {"render", folder / "s.toml", "--out", frame, "--seed", "2"}).err,
                HasSubstr("--seed changes nothing: " + (folder / "s.toml") +
                          " has no noise; give it electrons_per_dn in "
                          "[noise]"));
    std::ofstream(folder / "s.toml", std::ios::app) << "[noise]\nelectrons_per_dn = 50\n";
    EXPECT_THAT(run("hord-lab", {"render", folder / "s.toml", "--out", frame, "--seed", "2"}).err,
                testing::Not(HasSubstr("--seed")));
    const auto read = drivers::read_noted_frame(frame), sensor = drivers::read_noted_frame(raw);
    ASSERT_TRUE(read && sensor);
    EXPECT_EQ(read->geometry, (FrameGeometry{FrameKind::macro_pixels, {24, 20, 5, 5}, 8}));
    EXPECT_EQ(sensor->geometry, (FrameGeometry{FrameKind::raw, {}, 8}));

    const Said said = run("hordctl", {"inspect", frame, "--json"});
    ASSERT_NE(said.status, 2) << said.err;
    EXPECT_EQ(Json::parse(said.out)["grid"], Json::parse(R"({"m":24,"n":20,"i":5,"j":5})"));
    EXPECT_EQ(Json::parse(said.out)["grid_from"], "frame");
    EXPECT_THAT(run("hordctl", {"inspect", frame}).out, HasSubstr("5x5 bins a lenslet, as the frame says"));
    const Said same = run("hordctl", {"inspect", frame, "--macro", "5x5", "--bits", "8", "--json"});
    ASSERT_NE(same.status, 2) << same.err;
    EXPECT_EQ(Json::parse(same.out)["grid_from"], "option");
    refused({"inspect", raw}, {raw + " says a raw frame of 8 bits", "--grid"});
    refused({"replay", frame}, {frame + " says nothing of its part"});  // no station has kept it
}

TEST_F(Told, another_macro_or_depth_than_the_frame_says_is_refused) {
    const std::string frame = noted("a.png", kFive);
    refused({"inspect", frame, "--macro", "9x9"},
            {frame + " says macro-pixels of 5x5 bins, 27x18 lenslets, 8 bits", "--macro says 9x9",
             "leave --macro out, or give --macro 5x5"});
    refused({"inspect", frame, "--bits", "12"}, {frame, "8 bits", "--bits says 12", "--bits 8"});
    // The same frame without a note is read as it always was.
    const Said silent = run("hordctl", {"inspect", write("b.png", kFive, std::nullopt), "--json"});
    ASSERT_NE(silent.status, 2) << silent.err;
    EXPECT_EQ(Json::parse(silent.out)["grid"]["i"], 9);
    EXPECT_EQ(Json::parse(silent.out)["grid_from"], "default");
    // A reference frame has the geometry of the frame.
    refused({"inspect", frame, "--feature", "reference-emd", "--reference", noted("good.png", kNine)},
            {"good.png", "9x9", "5x5"});
}

TEST_F(Told, deep_frames_need_no_bits) {
    constexpr FrameGeometry kDeep{FrameKind::macro_pixels, {27, 18, 5, 5}, 12};
    const std::string frame = noted("deep.png", kDeep);
    const Said said = run("hordctl", {"inspect", frame, "--json"}),
               given = run(
                   "hordctl",
                   {"inspect", write("silent.png", kDeep, std::nullopt), "--macro", "5x5", "--bits", "12", "--json"});
    ASSERT_NE(said.status, 2) << said.err;
    ASSERT_NE(given.status, 2) << given.err;
    for (const char* key : {"verdict", "score", "feature"})
        EXPECT_EQ(Json::parse(said.out)[key], Json::parse(given.out)[key]);
}

TEST_F(Told, a_sidecar_tells_where_the_format_cannot) {
    const Frame frame = spots(kFive);
    std::ofstream(folder / "a.pgm", std::ios::binary)
        << "P5 " << frame.width_px() << " " << frame.height_px() << " 255\n"
        << std::string(reinterpret_cast<const char*>(frame.bytes().data()), frame.bytes().size());
    const auto inspect = [&] { return run("hordctl", {"inspect", folder / "a.pgm", "--json"}); };
    EXPECT_EQ(Json::parse(inspect().out)["grid"]["i"], 9);
    std::ofstream(folder / "a.frame.json") << to_json(kFive);
    EXPECT_EQ(Json::parse(inspect().out)["grid"]["i"], 5);
    // inspect's own JSON beside the frame is no sidecar.
    EXPECT_NE(run("hordctl", {"inspect", folder / "a.pgm", "--out", folder.path().string()}).status, 2);
    EXPECT_TRUE(std::filesystem::exists(folder / "a.json"));
    EXPECT_EQ(Json::parse(inspect().out)["grid"]["i"], 5);
    std::ofstream(folder / "a.frame.json") << "{\"schema\":1,";
    refused({"inspect", folder / "a.pgm"}, {folder / "a.frame.json", "geometry note"});
    std::ofstream(folder / "a.frame.json") << to_json(FrameGeometry{FrameKind::macro_pixels, {27, 18, 5, 7}, 8});
    refused({"inspect", folder / "a.pgm"}, {folder / "a.pgm", "135x126", "135x90"});
}

TEST_F(Told, learn_and_tune_compare_it) {
    std::vector<std::string> good, arguments{"learn"};
    for (int k = 0; k < 8; ++k) {  // distinct parts: light moves to the right, more so in later ones
        good.push_back(noted("good/" + std::to_string(k) + ".png", kFive));
        Frame part = spots(kFive);
        for (int y = 2; y < part.height_px(); y += 5) {
            for (int x = 3; x < part.width_px(); x += 5)
                part.set(x, y, 50U + static_cast<std::uint32_t>(2 * (k + 1) * x / part.width_px()));
        }
        EXPECT_TRUE(drivers::write_frame(good.back(), part.view(), kFive));
    }
    arguments.insert(arguments.end(), good.begin(), good.end());
    arguments.insert(arguments.end(), {"--out", folder / "r.hordref"});
    auto with_macro = arguments;
    with_macro.insert(with_macro.end(), {"--macro", "9x9"});
    refused(with_macro, {good.front(), "5x5", "--macro says 9x9"});
    auto with_other = arguments;
    with_other.insert(with_other.begin() + 3, noted("other.png", kNine));
    refused(with_other, {"other.png", good.front()});
    arguments.insert(arguments.end(), {"--read-dn", "1", "--electrons-per-dn", "1"});
    const Said learned = run("hordctl", arguments);
    EXPECT_EQ(learned.status, 0) << learned.err;
    EXPECT_THAT(learned.out, HasSubstr("5x5 bins a lenslet, as " + good.front() + " says"));
    EXPECT_THAT(learned.out, HasSubstr("27x18 lenslets of 5x5 bins"));

    for (int k = 0; k < 4; ++k) noted("bad/" + std::to_string(k) + ".png", kFive);
    const std::vector<std::string> tune{"tune", "--good", folder / "good", "--bad", folder / "bad", "--budget", "1000"};
    auto tune_other = tune;
    tune_other.insert(tune_other.end(), {"--macro", "9x9"});
    refused(tune_other, {good.front(), "5x5", "--macro says 9x9"});
    noted("bad/9.png", kNine);
    refused(tune, {"bad/9.png has 9x9 bins", "5x5"});
}

TEST_F(Told, recorded_frames_are_compared_with_the_configuration) {
    noted("frames/a.png", kFive);
    const auto config = [&](const std::string& inspection) {
        std::ofstream(folder / "c.toml") << simulated_beside(
            "[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n[modbus]\nport = 0\n" + inspection + kRoomyLine);
        return folder / "c.toml";
    };
    refused({"run", "--config", config("")},
            {"a.png says macro-pixels of 5x5 bins", "inspection.macro is \"9x9\"", "inspection.macro = \"5x5\""});
    const Said said =
        run("hordctl", {"run", "--config", config("[inspection]\nmacro = \"5x5\"\n"), "--rate", "2", "--json"});
    EXPECT_NE(said.status, 2) << said.err;
    std::istringstream lines(said.out);
    std::string line;
    ASSERT_TRUE(std::getline(lines, line)) << said.err;
    const Json part = Json::parse(line);
    const auto reason = part["reason"].get<std::string>();
    if (reason != "verdict-late" && reason != "frame-lost" && reason != "strobe-failed") {
        EXPECT_TRUE(part.contains("explain")) << part;
    }
    noted("frames/b.png", kNine);
    refused({"run", "--config", config("[inspection]\nmacro = \"5x5\"\n")}, {"b.png", "9x9", "a.png", "5x5"});
}

TEST_F(Told, kept_frames_tell_it) {
    ASSERT_EQ(run("hord_test_archive", {folder / "store", "1"}).status, 0);
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder / "store")) {
        if (entry.path().extension() != ".png") continue;
        const auto read = drivers::read_noted_frame(entry.path());
        ASSERT_TRUE(read) << read.error().message();
        ASSERT_TRUE(read->geometry);
        EXPECT_EQ(read->geometry->grid, (algo::Extents{24, 24, 5, 5}));
        const Said said = run("hordctl", {"inspect", entry.path().string(), "--json"});
        ASSERT_NE(said.status, 2) << said.err;
        EXPECT_EQ(Json::parse(said.out)["grid"]["i"], 5);
        refused({"inspect", entry.path().string(), "--macro", "3x3"}, {"5x5", "--macro says 3x3"});
        return;
    }
    FAIL() << "no frame was kept";
}

}  // namespace
}  // namespace hord::test
