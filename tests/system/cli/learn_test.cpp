// `hordctl learn`, and `hordctl inspect` against the learned reference, as a person meets them.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "drivers/files/frame_file.h"
#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;

constexpr int kColumns = 26, kRows = 24;

// A weak lens that fills the field, 12 bits in a 16-bit file, one electron a DN; `speck`: nine lenslets with a third
// less light.
// `again`: the seed of another exposure's noise.
Frame part(std::uint64_t seed, bool speck = false, std::uint64_t again = 0) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> wobble(-0.3, 0.3);
    const double x0 = wobble(random), y0 = wobble(random);
    if (again != 0) random.seed(again);
    Frame frame(kColumns * 9, kRows * 9, 12);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const int m = x / 9, n = y / 9;
            const double dx = x % 9 - 4 - 0.08 * (m - 12.5 - x0), dy = y % 9 - 4 - 0.06 * (n - 11.5 - y0);
            double light = 1000 * std::exp(-(dx * dx + dy * dy) / 0.7);
            if (speck && std::abs(m - 15) <= 1 && std::abs(n - 9) <= 1) light *= 0.67;
            const double noisy = light + std::sqrt(light + 4) * normal(random);
            frame.set(x, y, static_cast<std::uint32_t>(std::clamp(std::lround(noisy), 0L, 4095L)));
        }
    }
    return frame;
}

class Learn : public ::testing::Test {
  protected:
    std::string write(const std::string& name, const Frame& frame) {
        const std::string file = folder / name;
        EXPECT_TRUE(drivers::write_frame(file, frame.view()));
        return file;
    }
    Said learn(int parts) {
        std::vector<std::string> arguments{"learn"};
        for (int k = 0; k < parts; ++k)
            arguments.push_back(write("good" + std::to_string(k) + ".png", part(static_cast<std::uint64_t>(k) + 1)));
        arguments.insert(arguments.end(),
                         {"--bits", "12", "--electrons-per-dn", "1", "--read-dn", "2", "--out", reference});
        return run("hordctl", arguments);
    }
    TemporaryFolder folder;
    std::string reference = folder / "lens.hordref";
};

TEST_F(Learn, what_was_learned_tells_good_from_bad_and_says_why) {
    const Said learned = learn(9);
    ASSERT_EQ(learned.status, 0) << learned.err;
    EXPECT_THAT(learned.out, HasSubstr("9 of 9 parts"));
    const std::string good = write("new.png", part(100)), bad = write("bad.png", part(101, true));

    EXPECT_EQ(run("hordctl", {"inspect", good, "--bits", "12", "--reference", reference}).status, 0);
    // The default recipe alone tolerates a loss of 30 % of the light.
    const Said said =
        run("hordctl", {"inspect", bad, "--bits", "12", "--reference", reference, "--json", "--out", folder / "maps"});
    ASSERT_EQ(said.status, 1) << said.err << said.out;
    const Json json = Json::parse(said.out);
    EXPECT_EQ(json["reason"], "absorption");
    EXPECT_NEAR(json["defects"][0]["m"].get<double>(), 15, 1);
    EXPECT_NEAR(json["defects"][0]["n"].get<double>(), 9, 1);
    EXPECT_EQ(json["defects"][0]["kind"], "absorbing");
    EXPECT_THAT(json["explain"].get<std::string>(), HasSubstr("Rejected: an absorbing defect"));
    EXPECT_EQ(json["feature"]["name"], "z-score");
    EXPECT_TRUE(json.contains("pose"));
    EXPECT_TRUE(std::filesystem::exists(folder / "maps/bad.z-score.png"));

    const Said former =
        run("hordctl", {"inspect", bad, "--bits", "12", "--reference", reference, "--json", "--feature", "surprise"});
    EXPECT_THAT(former.err, HasSubstr("the feature \"surprise\" is called \"z-score\" now"));
    EXPECT_EQ(Json::parse(former.out)["feature"]["name"], "z-score");
}

TEST_F(Learn, shows_what_varies_the_bound_of_false_rejects_and_what_will_be_found) {
    std::vector<std::string> arguments{"learn"};
    for (int k = 0; k < 13; ++k)
        arguments.push_back(
            write("good" + std::to_string(k) + ".png", part(static_cast<std::uint64_t>(k) + 1, k == 12)));
    // The last part has a speck: it is left out. Two more exposures of the first, and a copy.
    arguments.push_back(write("again0.png", part(1, false, 501)));
    arguments.push_back(write("again1.png", part(1, false, 502)));
    arguments.push_back(write("copy.png", part(1)));
    arguments.insert(arguments.end(),
                     {"--bits", "12", "--electrons-per-dn", "1", "--read-dn", "2", "--out", reference});
    const Said said = run("hordctl", arguments);
    ASSERT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.out,
                HasSubstr("16 frames show 13 distinct parts: 1 is a copy of an earlier one, 2 differ from "
                          "earlier ones by noise alone"));
    EXPECT_THAT(said.out, HasSubstr("12 of 13 parts"));
    EXPECT_THAT(said.out, HasSubstr("Left out: " + folder / "good12.png" + ": it differs from all others in"));
    EXPECT_THAT(said.out, HasSubstr("(95 % sure, from 12 distinct good parts, none of them rejected)"));
    EXPECT_THAT(said.out, HasSubstr("0.3 % takes 986 more parts"));
    EXPECT_THAT(said.out, HasSubstr("Bubble or speck: radius 0."));
    EXPECT_THAT(said.out, HasSubstr("reject_score 6"));
    std::ifstream page(folder / "lens.learn.md");
    const std::string text{std::istreambuf_iterator<char>(page), {}};
    EXPECT_THAT(text, HasSubstr("![mean, spread and modes](lens.learn.png)"));
    EXPECT_THAT(text, HasSubstr("| mode 1 |"));
    EXPECT_THAT(text, HasSubstr("good12.png | - | - | - | left out: "));
    std::ifstream table(folder / "lens.learn.csv");
    EXPECT_EQ(std::count(std::istreambuf_iterator<char>(table), {}, '\n'), 14);
    EXPECT_GT(std::filesystem::file_size(folder / "lens.learn.png"), 10'000U);

    std::filesystem::remove(folder / "lens.learn.md");
    arguments.emplace_back("--no-check");
    const Said brief = run("hordctl", arguments);
    ASSERT_EQ(brief.status, 0) << brief.err;
    EXPECT_EQ(brief.out.find("95 % sure"), std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(folder / "lens.learn.md"));
}

TEST_F(Learn, of_too_few_parts_says_how_many_more_the_check_takes) {
    const Said said = learn(8);
    ASSERT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.out, HasSubstr("Not checked: 8 distinct parts are too few"));
    EXPECT_THAT(said.out, HasSubstr("give at least 11"));
    const auto report = [&] {
        std::ifstream file(folder / "lens.learn.json");
        return Json::parse(file);
    };
    EXPECT_THAT(report()["not_checked"].get<std::string>(), HasSubstr("give at least 11"));
    EXPECT_FALSE(report().contains("false_rejects"));
    ASSERT_EQ(learn(11).status, 0);
    EXPECT_TRUE(report()["not_checked"].is_null());
}

TEST_F(Learn, a_recipe_names_its_reference_and_tolerates_in_mm) {
    ASSERT_EQ(learn(8).status, 0);
    const std::string bad = write("bad.png", part(101, true));
    const auto with = [&](const std::string& more) {
        const std::string file = folder / "recipe.toml";
        std::ofstream(file) << "schema = 1\n[reference]\nfile = \"lens.hordref\"\n" << more;
        return run("hordctl", {"inspect", bad, "--bits", "12", "--recipe", file});
    };
    EXPECT_EQ(with("").status, 1);
    const std::string scale = "[scale]\nlenslet_mm = 0.2\nbin_rad = 0.015\n";
    EXPECT_EQ(with(scale + "[[tolerate]]\nkinds = [\"absorbing\"]\nlargest_mm = 1.5\n").status, 0);
    EXPECT_EQ(with(scale + "[[tolerate]]\nkinds = [\"scratch\"]\nlargest_mm = 1.5\n").status, 1);
    // At (0.5, -0.5) mm from the middle.
    const std::string here = "shape = \"circle\"\ncentre = [0.5, -0.5]\nradius = 0.4\n",
                      there = "shape = \"circle\"\ncentre = [-1.5, 0.5]\nradius = 0.4\n";
    EXPECT_EQ(with(scale + "[[tolerate]]\nlargest_mm = 1.5\n" + here).status, 0);
    EXPECT_EQ(with(scale + "[[tolerate]]\nlargest_mm = 1.5\n" + there).status, 1);
    // Every problem at once.
    const Said refused = with("grow_score = 9\n[[tolerate]]\nkinds = [\"dent\"]\ndeepest_rad = 0.1\n");
    EXPECT_EQ(refused.status, 2);
    for (const char* problem : {"grow_score", "dent", "largest_mm", "lenslet_mm", "bin_rad"})
        EXPECT_THAT(refused.err, HasSubstr(problem));
}

// Copies and repeated exposures are no parts: a reference of fewer than eight distinct ones is not written.
TEST_F(Learn, as_many_files_of_fewer_parts_are_refused) {
    std::vector<std::string> arguments{"learn"};
    for (int k = 0; k < 9; ++k)
        arguments.push_back(write("good" + std::to_string(k) + ".png", part(static_cast<std::uint64_t>(k % 3) + 1)));
    arguments.insert(arguments.end(),
                     {"--bits", "12", "--electrons-per-dn", "1", "--read-dn", "2", "--out", reference});
    const Said said = run("hordctl", arguments);
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("9 frames show 3 distinct parts: 6 are copies of earlier ones"));
    EXPECT_THAT(said.err, HasSubstr("needs 8 distinct good parts: give frames of at least 5 more"));
    EXPECT_FALSE(std::filesystem::exists(reference));
}

// A frame whose light ends in the middle of the field.
TEST_F(Learn, a_part_that_cannot_be_learned_from_is_told_by_its_file) {
    std::vector<std::string> arguments{"learn"};
    for (int k = 0; k < 8; ++k)
        arguments.push_back(write("good" + std::to_string(k) + ".png", part(static_cast<std::uint64_t>(k) + 1)));
    Frame dark(kColumns * 9, kRows * 9, 12);
    for (int y = 0; y < dark.height_px(); ++y)
        for (int x = 0; x < dark.width_px(); ++x) dark.set(x, y, x % 9 == 4 && y % 9 == 4 && x < 90 ? 900U : 0U);
    arguments.insert(arguments.begin() + 1, write("odd.png", dark));
    arguments.erase(arguments.end() - 1);
    arguments.insert(arguments.end(),
                     {"--bits", "12", "--electrons-per-dn", "1", "--read-dn", "2", "--out", reference});
    const Said said = run("hordctl", arguments);
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("7 of 8 parts can be learned from: " + (folder / "odd.png") + ": "));
    EXPECT_THAT(said.err, Not(HasSubstr("part 1")));
}

TEST_F(Learn, a_damaged_reference_and_too_few_parts_are_refused) {
    EXPECT_EQ(learn(7).status, 2);
    ASSERT_EQ(learn(8).status, 0);
    std::string text;
    {
        std::ifstream stream(reference, std::ios::binary);
        text.assign(std::istreambuf_iterator<char>(stream), {});
    }
    text[text.size() / 2] = static_cast<char>(text[text.size() / 2] ^ 1);
    std::ofstream(reference, std::ios::binary) << text;
    const Said said = run("hordctl", {"inspect", folder / "good0.png", "--bits", "12", "--reference", reference});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("checksum"));
}

TEST_F(Learn, files_that_are_read_are_not_overwritten) {
    const std::string frame = write("good.png", part(1)), scene = folder / "scene.toml";
    const auto size = std::filesystem::file_size(frame);
    Said said = run("hordctl", {"learn", frame, "--out", std::string(folder / ".") + "/good.png"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("is one of the files that are read"));
    EXPECT_EQ(std::filesystem::file_size(frame), size);
    std::ofstream(scene) << "name = \"empty\"\n";
    said = run("hord-lab", {"render", scene, "--out", scene});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("is one of the files that are read"));
}

}  // namespace
}  // namespace hord::test
