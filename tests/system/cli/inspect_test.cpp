// `hordctl inspect` as a person meets it: verdicts, files, JSON, exit statuses and refusals.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <tuple>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "algo/features/feature.h"
#include "drivers/files/frame_file.h"
#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

// 20 x 16 lenslets with a small spot of light each: in the centre bin in the outermost ones, a bin to the right in the
// others, as behind a flat wedge. A good part without any gradient.
Frame plain_frame(int bits = 8) {
    Frame frame(20 * 9, 16 * 9, bits);
    const std::uint32_t unit = bits > 8 ? 256 : 1;
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const int m = x / 9, n = y / 9;
            const bool part = m > 0 && m < 19 && n > 0 && n < 15;
            const int i = x % 9 - 4 - (part ? 1 : 0), j = y % 9 - 4;
            frame.set(x, y, (i == 0 && j == 0 ? 200U : std::abs(i) + std::abs(j) == 1 ? 50U : 0U) * unit);
        }
    }
    return frame;
}

std::string write(const TemporaryFolder& folder, const std::string& name, const Frame& frame) {
    const std::string file = folder / name;
    EXPECT_TRUE(drivers::write_frame(file, frame.view()));
    return file;
}

std::size_t lines(const std::string& text) {
    return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

TEST(Inspect, a_plain_part_passes_with_status_0_at_8_and_16_bits) {
    const TemporaryFolder folder;
    const Said said =
        run("hordctl", {"inspect", write(folder, "a.png", plain_frame(8)), write(folder, "b.png", plain_frame(16))});
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_EQ(lines(said.out), 4U);  // each with its sentence
    EXPECT_THAT(said.out, HasSubstr("pass"));
    EXPECT_THAT(said.out, HasSubstr("\n    Passed: the worst place reaches"));
}

TEST(Inspect, json_is_one_object_a_line_with_every_promised_key) {
    const TemporaryFolder folder;
    const Said said = run("hordctl", {"inspect", write(folder, "a.png", plain_frame()), "--json"});
    ASSERT_EQ(said.status, 0) << said.err;
    const Json json = Json::parse(said.out);
    EXPECT_EQ(json["grid"], Json::parse(R"({"m":20,"n":16,"i":9,"j":9})"));
    EXPECT_EQ(json["verdict"], "pass");
    EXPECT_EQ(json["feature"]["name"], "emd");
    EXPECT_GT(json["feature"]["valid"], 0);
    EXPECT_EQ(json["grid_from"], "default");
    EXPECT_THAT(json["explain"].get<std::string>(), HasSubstr("Passed"));
    for (const char* key : {"frame", "reason", "score", "defects", "light", "feature", "ms"})
        EXPECT_TRUE(json.contains(key)) << key;
    for (const char* key : {"unit", "min", "p50", "p99", "max"}) EXPECT_TRUE(json["feature"].contains(key)) << key;
    for (const char* key : {"decode", "hord", "feature", "decide", "total"})
        EXPECT_TRUE(json["ms"].contains(key)) << key;
    EXPECT_EQ(json["schema"], 1);
    EXPECT_THAT(run("hordctl", {"--version"}).out, HasSubstr(json["software"].get<std::string>()));
    EXPECT_TRUE(json["calibration"].is_null());
    EXPECT_EQ(json["recipe"]["name"], "default");
}

TEST(Inspect, json_names_the_recipe_as_recipe_check_does) {
    const TemporaryFolder folder;
    const std::string recipe = folder / "lens.toml";
    std::ofstream(recipe) << "schema = 1\nname = \"lens\"\nnumber = 12\nversion = 3\n";
    const Said said = run("hordctl", {"inspect", write(folder, "a.png", plain_frame()), "--json", "--recipe", recipe});
    ASSERT_EQ(said.status, 0) << said.err;
    const Json used = Json::parse(said.out)["recipe"];
    EXPECT_EQ(used["file"], recipe);
    EXPECT_EQ(used["number"], 12);
    EXPECT_EQ(used["version"], 3);
    EXPECT_THAT(run("hordctl", {"recipe", "check", recipe}).out,
                HasSubstr("number 12, version 3, CRC-32 " + used["crc32"].get<std::string>()));
}

TEST(Inspect, out_writes_map_picture_and_json) {
    const TemporaryFolder folder;
    const Said said =
        run("hordctl",
            {"inspect", write(folder, "a.png", plain_frame()), "--out", folder / "maps", "--feature", "transmission"});
    ASSERT_EQ(said.status, 0) << said.err;
    for (const char* name : {"maps/a.transmission.tiff", "maps/a.transmission.png", "maps/a.mask.png", "maps/a.json"}) {
        EXPECT_GT(std::filesystem::file_size(folder.path() / name), 100U) << name;
    }
}

TEST(Inspect, every_feature_it_names_has_a_map) {
    const TemporaryFolder folder;
    const std::string frame = write(folder, "a.png", plain_frame()),
                      reference = write(folder, "good.png", plain_frame());
    std::vector<std::string> names;
    for (const auto name : algo::kFeatureNames) {
        names.emplace_back(name);
        if (algo::feature_named("reference-" + std::string(name))) names.push_back("reference-" + std::string(name));
    }
    EXPECT_EQ(names.size(), 16U + 11U);
    for (const auto& feature : names) {
        std::vector<std::string> arguments{"inspect", frame, "--feature", feature, "--out", folder / "maps", "--json"};
        if (feature.starts_with("reference-")) arguments.insert(arguments.end(), {"--reference", reference});
        const Said said = run("hordctl", arguments);
        ASSERT_EQ(said.status, 0) << said.err;
        const Json map = Json::parse(said.out)["feature"];
        EXPECT_EQ(map["name"], feature);
        EXPECT_GT(map["valid"], 100) << feature;
        EXPECT_EQ(map["max"], feature == "transmission" ? 1.0 : 0.0) << feature;  // a plain part
        EXPECT_TRUE(std::filesystem::exists(folder / ("maps/a." + feature + ".tiff")));
    }
}

// The light of a plain part lies one bin to the right everywhere: 15 mrad, and no power.
TEST(Inspect, deflection_and_power_are_maps_in_a_lens_makers_units) {
    const TemporaryFolder folder;
    const std::string frame = write(folder, "a.png", plain_frame());
    std::ofstream(folder / "scale.toml") << "schema = 1\n[scale]\nlenslet_mm = 0.2\nbin_rad = 0.015\n";
    for (const auto& [feature, unit, value] : {std::tuple{"deflection-x", "mrad", 15.0},
                                               {"deflection-y", "mrad", 0.0},
                                               {"optical-power", "dioptres", 0.0}}) {
        const Said said = run("hordctl",
                              {"inspect", frame, "--recipe", folder / "scale.toml", "--feature", feature, "--out",
                               folder / "maps", "--json"});
        ASSERT_EQ(said.status, 0) << said.err;
        const Json map = Json::parse(said.out)["feature"];
        EXPECT_EQ(map["unit"], unit);
        EXPECT_NEAR(map["p50"].get<double>(), value, 1e-5) << feature;
        EXPECT_TRUE(std::filesystem::exists(folder / ("maps/a." + std::string(feature) + ".tiff")));
    }
    const Said without = run("hordctl", {"inspect", frame, "--feature", "optical-power"});
    EXPECT_EQ(without.status, 2);
    EXPECT_THAT(without.err, HasSubstr("[scale] lenslet_mm and bin_rad"));
}

// Two flaws in one frame: lenslet (7, 8) is dark, lenslet (12, 5) saturated.
Frame flawed_frame() {
    Frame frame = plain_frame();
    for (int y = 0; y < 9; ++y) {
        for (int x = 0; x < 9; ++x) frame.set(7 * 9 + x, 8 * 9 + y, 0);
    }
    frame.set(12 * 9 + 4, 5 * 9 + 4, 255);
    return frame;
}

TEST(Inspect, a_lenslet_without_a_value_is_NaN_in_the_map_of_every_feature) {
    const TemporaryFolder folder;
    const std::string frame = write(folder, "a.png", flawed_frame()),
                      reference = write(folder, "good.png", plain_frame());
    std::vector<std::string> names{"sums"};
    for (const auto name : algo::kFeatureNames) {
        names.emplace_back(name);
        if (algo::feature_named("reference-" + std::string(name))) names.push_back("reference-" + std::string(name));
    }
    for (const auto& feature : names) {
        std::vector<std::string> arguments{"inspect", frame, "--feature", feature, "--out", folder / "maps"};
        const bool compares_frames = feature.starts_with("reference-");
        if (compares_frames) arguments.insert(arguments.end(), {"--reference", reference});
        ASSERT_NE(run("hordctl", arguments).status, 2) << feature;
        const cv::Mat map = cv::imread(folder / ("maps/a." + feature + ".tiff"), cv::IMREAD_UNCHANGED);
        ASSERT_EQ(map.type(), CV_32FC1) << feature;
        const bool light = feature == "transmission", sums = feature == "sums";
        EXPECT_EQ(std::isnan(map.at<float>(8, 7)), !light && !sums) << feature;                      // dark
        EXPECT_EQ(std::isnan(map.at<float>(5, 12)), !sums) << feature;                               // saturated
        EXPECT_EQ(std::isnan(map.at<float>(0, 0)), !light && !sums && !compares_frames) << feature;  // border
        EXPECT_FALSE(std::isnan(map.at<float>(12, 12))) << feature;
        // The mask gives the reasons: black is dark, white is saturated.
        const cv::Mat mask = cv::imread(folder / "maps/a.mask.png", cv::IMREAD_COLOR);
        ASSERT_EQ(mask.size(), map.size()) << feature;
        EXPECT_EQ(mask.at<cv::Vec3b>(8, 7) == cv::Vec3b(0, 0, 0), !light && !sums) << feature;
        EXPECT_EQ(mask.at<cv::Vec3b>(5, 12), cv::Vec3b(255, 255, 255)) << feature;
    }
}

// Without --feature the map that decided is shown, and the JSON names it.
TEST(Inspect, shows_the_map_that_decided) {
    const TemporaryFolder folder;
    std::ofstream(folder / "r.toml") << "schema = 1\n[part]\npresent = \"unchecked\"\n";
    const auto inspect = [&](const std::string& name, const Frame& frame) {
        const Said said = run("hordctl",
                              {"inspect", write(folder, name + ".png", frame), "--recipe", folder / "r.toml", "--json",
                               "--out", folder / "maps"});
        const Json json = Json::parse(said.out);
        const std::string feature = json["feature"]["name"];
        EXPECT_TRUE(std::filesystem::exists(folder / ("maps/" + name + "." + feature + ".tiff"))) << said.out;
        EXPECT_FALSE(json["explain"].get<std::string>().empty());
        return std::pair(json["reason"].get<std::string>(), feature);
    };
    EXPECT_EQ(inspect("speck", flawed_frame()), std::pair(std::string("absorption"), std::string("transmission")));
    Frame shifted = plain_frame();  // in one lenslet by three bins
    for (int y = 0; y < 9; ++y) {
        for (int x = 8; x > 2; --x) shifted.set(7 * 9 + x, 8 * 9 + y, shifted.view().sample(7 * 9 + x - 3, 8 * 9 + y));
        for (int x = 0; x < 3; ++x) shifted.set(7 * 9 + x, 8 * 9 + y, 0);
    }
    const auto [reason, feature] = inspect("shifted", shifted);
    EXPECT_EQ(feature, reason == "deflection-gradient" ? "jacobian-frobenius" : "emd") << reason;
    EXPECT_NE(reason, "absorption");
    const auto [why, shown] = inspect("dark", Frame(90, 90, 8));
    EXPECT_EQ(shown, "sums") << why;
}

TEST(Inspect, does_not_write_over_a_link_or_a_device) {
    const TemporaryFolder folder;
    const std::string frame = write(folder, "a.png", plain_frame());
    std::filesystem::create_directories(folder / "maps");
    std::ofstream(folder / "precious") << "precious";
    std::filesystem::create_symlink(folder / "precious", folder / "maps/a.json");
    const Said said = run("hordctl", {"inspect", frame, "--out", folder / "maps"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("maps/a.json is a symbolic link"));
    EXPECT_TRUE(std::filesystem::is_symlink(folder / "maps/a.json"));
    std::ifstream precious(folder / "precious");
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(precious), {}), "precious");
}

// In one lenslet of the frame the light is one bin further to the right than in the reference.
TEST(Inspect, compares_with_a_reference_at_the_same_place) {
    const TemporaryFolder folder;
    Frame moved = plain_frame();
    for (int y = 0; y < 9; ++y) {
        for (int x = 8; x > 0; --x) moved.set(7 * 9 + x, 8 * 9 + y, moved.view().sample(7 * 9 + x - 1, 8 * 9 + y));
    }
    const std::string good = write(folder, "good.png", plain_frame()), frame = write(folder, "moved.png", moved);
    for (const auto& [feature, distance] :
         {std::pair("reference-emd", 1.0), std::pair("reference-centroid", 1.0), std::pair("reference-emd-l1", 1.0)}) {
        const Said said = run("hordctl", {"inspect", frame, "--reference", good, "--feature", feature, "--json"});
        ASSERT_EQ(said.status, 1) << said.err;  // status 1: the recipe rejects the part
        const Json map = Json::parse(said.out)["feature"];
        EXPECT_NEAR(map["max"].get<double>(), distance, 1e-6);
        EXPECT_EQ(map["p99"], 0.0);
    }
}

TEST(Inspect, a_dark_frame_is_unfit_with_status_3) {
    const TemporaryFolder folder;
    const Said said = run("hordctl", {"inspect", write(folder, "dark.png", Frame(90, 90, 8)), "--json"});
    EXPECT_EQ(said.status, 3);
    EXPECT_EQ(Json::parse(said.out)["verdict"], "unfit");
}

// Every bad input: status 2, one line with the cause and the cure, and no crash.
void expect_refusal(const std::vector<std::string>& arguments, const std::string& thing, const std::string& cure) {
    std::vector<std::string> all{"inspect"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    const Said said = run("hordctl", all);
    EXPECT_EQ(said.status, 2) << said.err;
    EXPECT_EQ(lines(said.err), 1U) << said.err;
    EXPECT_THAT(said.err, HasSubstr(thing));
    EXPECT_THAT(said.err, HasSubstr(cure));
}

TEST(Inspect, a_defect_has_one_size_in_the_text_and_in_json) {
    const TemporaryFolder folder;
    Frame frame = plain_frame();
    for (int y = 6 * 9; y < 9 * 9; ++y) {
        for (int x = 8 * 9; x < 11 * 9; ++x) frame.set(x, y, 0);
    }
    const std::string file = write(folder, "a.png", frame);
    const Json json = Json::parse(run("hordctl", {"inspect", file, "--json"}).out);
    ASSERT_EQ(json["verdict"], "reject");
    const std::string size = fmt::format(" of {:.1f} lenslets", json["defects"][0]["size"].get<float>());
    EXPECT_THAT(json["explain"].get<std::string>(), HasSubstr(size));
    const std::string text = run("hordctl", {"inspect", file}).out;
    EXPECT_THAT(text.substr(0, text.find('\n')), HasSubstr(size));
    EXPECT_THAT(text.substr(text.find('\n')), HasSubstr(size));
}

// 12-bit samples as they are in 16-bit files.
TEST(Inspect, names_the_bits_of_a_frame_that_is_dark_for_its_depth) {
    const TemporaryFolder folder;
    const Frame deep = plain_frame();
    Frame frame(deep.width_px(), deep.height_px(), 16);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) frame.set(x, y, 16 * deep.view().sample(x, y));
    }
    const std::string file = write(folder, "a.png", frame);
    const Said said = run("hordctl", {"inspect", file});
    EXPECT_EQ(said.status, 3);
    EXPECT_THAT(said.out, HasSubstr("lenslets of the part have light enough (at least 5 %)"));
    EXPECT_THAT(said.out, HasSubstr("No sample exceeds 4095, as if they had 12 bits"));
    EXPECT_THAT(run("hordctl", {"inspect", file, "--json"}).out, HasSubstr("sensor.bits (or --bits) to it"));
    EXPECT_EQ(run("hordctl", {"inspect", file, "--bits", "12"}).status, 0);
}

TEST(Inspect, refuses_a_missing_file) { expect_refusal({"/nonexistent/a.png"}, "/nonexistent/a.png", ""); }

TEST(Inspect, refuses_a_file_that_is_no_image) {
    const TemporaryFolder folder;
    std::ofstream(folder / "a.png") << "not an image";
    expect_refusal({folder / "a.png"}, folder / "a.png", "");
}

TEST(Inspect, refuses_a_truncated_image) {
    const TemporaryFolder folder;
    const std::string whole = write(folder, "whole.png", plain_frame());
    std::ifstream in(whole, std::ios::binary);
    std::string bytes{std::istreambuf_iterator<char>(in), {}};
    std::ofstream(folder / "cut.png", std::ios::binary) << bytes.substr(0, bytes.size() * 2 / 3);
    expect_refusal({folder / "cut.png"}, "cut.png", "");
}

TEST(Inspect, refuses_macro_pixels_that_do_not_divide_the_frame) {
    const TemporaryFolder folder;
    const std::string file = write(folder, "a.png", plain_frame());
    expect_refusal({file, "--macro", "7x7"}, "7x7", "bins");
    expect_refusal({file, "--macro", "nine"}, "nine", "9x9");
    expect_refusal({file, "--macro", "0x9"}, "0x9", "bins");
    expect_refusal({file, "--macro", ""}, "--macro is empty", "variable");
}

TEST(Inspect, refuses_an_unknown_feature_and_names_the_known) {
    const TemporaryFolder folder;
    expect_refusal({write(folder, "a.png", plain_frame()), "--feature", "emdd"}, "emdd", "emd");
}

TEST(Inspect, refuses_a_reference_feature_without_a_reference_and_the_other_way_round) {
    const TemporaryFolder folder;
    const std::string frame = write(folder, "a.png", plain_frame());
    expect_refusal({frame, "--feature", "reference-chi2"}, "reference-chi2", "--reference FRAME");
    expect_refusal({frame, "--feature", "chi2", "--reference", frame}, "chi2", "reference-chi2");
    expect_refusal({frame, "--feature", "reference-transmission", "--reference", frame}, "reference-transmission",
                   "emd");
    expect_refusal({frame, "--feature", "reference-chi2", "--reference", "/nonexistent/b.png"}, "/nonexistent/b.png",
                   "");
    expect_refusal({frame, "--feature", "reference-chi2", "--reference", write(folder, "deep.png", plain_frame(16))},
                   "deep.png", "at 8");
    // What is given as a reference and is neither a learned one nor a frame is said to be that.
    std::ofstream(folder / "torn.hordref") << "HORDRE";
    for (const std::string& wrong : {folder.path().string(), folder / "torn.hordref", std::string("/nonexistent/r")}) {
        expect_refusal({frame, "--reference", wrong}, wrong + " is no learned reference, and no frame",
                       "hordctl learn");
    }
    expect_refusal({frame, "--reference", frame}, "no feature that compares with a frame", "reference-emd");
}

TEST(Inspect, refuses_an_unknown_recipe_key_and_an_impossible_value_at_once) {
    const TemporaryFolder folder;
    std::ofstream(folder / "r.toml") << "[limits]\nemd_binss = 1\nemd_bins = -1\n";
    const Said said = run("hordctl", {"inspect", write(folder, "a.png", plain_frame()), "--recipe", folder / "r.toml"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("r.toml:2"));
    EXPECT_THAT(said.err, HasSubstr("r.toml:3"));
}

TEST(Inspect, a_bad_frame_does_not_hide_the_verdicts_of_the_others) {
    const TemporaryFolder folder;
    const Said said =
        run("hordctl", {"inspect", "/nonexistent/a.png", write(folder, "b.png", plain_frame()), "--json"});
    EXPECT_EQ(said.status, 2);
    EXPECT_EQ(Json::parse(said.out)["verdict"], "pass");
}

TEST(Inspect, refuses_two_frames_that_would_overwrite_each_other) {
    const TemporaryFolder folder;
    std::filesystem::create_directories(folder / "x");
    const std::string a = write(folder, "a.png", plain_frame());
    const std::string b = write(folder, "x/a.png", plain_frame());
    expect_refusal({a, b, "--out", folder / "maps"}, "overwrite", "rename");
}

// Frames from an independent ray tracer, with its ground truth.
TEST(Inspect, finds_the_defects_of_independent_frames_at_their_true_places) {
    const auto data = real_data() / "povray";
    if (!std::filesystem::is_directory(data))
        GTEST_SKIP() << "no real input: set HORD_DATA, or put it at ../shared/data";
    const TemporaryFolder folder;
    std::vector<std::string> arguments{"inspect", "--json", "--macro", "9x9", "--out", folder / "maps"};
    const std::vector<std::string> names{"lens_111", "empty_111", "wedge_111", "bubble_r500_111", "cutout_111"};
    for (const auto& name : names) arguments.push_back((data / (name + "_raw.png")).string());
    const Said said = run("hordctl", arguments);
    EXPECT_EQ(said.status, 1) << said.err;
    std::istringstream stream(said.out);
    for (const auto& name : names) {
        std::string line;
        ASSERT_TRUE(std::getline(stream, line));
        const Json found = Json::parse(line);
        std::ifstream truth_file(data / (name + ".json"));
        const Json truth = Json::parse(truth_file);
        if (name == "empty_111") {
            EXPECT_EQ(found["verdict"], "unfit") << line;
            EXPECT_EQ(found["reason"], "no-part");
            continue;
        }
        if (truth["defect_free"]) {
            EXPECT_EQ(found["verdict"], "pass") << name << " " << line;
            continue;
        }
        EXPECT_EQ(found["verdict"], "reject") << name;
        ASSERT_FALSE(found["defects"].empty()) << name;
        const auto& centre = truth["defect_components"][0]["centroid_lenslet"];
        const double dm = found["defects"][0]["m"].get<double>() - centre[0].get<double>();
        const double dn = found["defects"][0]["n"].get<double>() - centre[1].get<double>();
        EXPECT_LE(std::hypot(dm, dn), 2.0) << name << " " << line;
        EXPECT_EQ(found["defects"].size(), 1U) << "one defect, one finding: " << line;
    }
}

}  // namespace
}  // namespace hord::test
