// The report of a learned reference: what it tells, and its files.
#include "firmware/diagnostics/learn_report.h"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "common/crc32.h"
#include "firmware/recipes/reference_file.h"
#include "tests/firmware/recipes/drawn_lens.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Json = nlohmann::json;

class LearnReportTest : public ::testing::Test {
  protected:
    LearnReportTest() {
        std::string name = fs::temp_directory_path() / "hord-learn-report-XXXXXX";
        folder = ::mkdtemp(name.data());
    }
    ~LearnReportTest() override { fs::remove_all(folder); }

    // `parts` drawn lenses; the last one shows nothing.
    LearnedParts learn(std::size_t parts) {
        LearnedParts learned;
        learned.file = folder / "lens.hordref";
        learned.recipe.emd_limit_bins = learned.recipe.frobenius_limit_bins = 3;
        learned.recipe.transmission_limit = 0.5F;
        for (std::size_t k = 1; k <= parts; ++k) learned.frames.push_back("part " + std::to_string(k));
        learned.frame_of = [parts](std::size_t k) -> Result<Frame> {
            if (k + 1 == parts) return Frame(kDrawnExtents.width_px(), kDrawnExtents.height_px(), kDrawnBits);
            return drawn_lens(k + 1);
        };
        learned.learning.levels = algo::light_levels(learned.recipe, kDrawnBits);
        learned.learning.electrons_per_dn = 1;
        learned.learning.read_dn = 2;
        auto result = algo::learn_reference(kDrawnExtents, kDrawnBits, parts, learned.frame_of, learned.learning);
        EXPECT_TRUE(result) << result.error().message();
        learned.reference = std::make_shared<const algo::Reference>(std::move(result->reference));
        learned.left_out = result->left_out;
        learned.poses = result->poses;
        learned.electrons_from = "given";
        learned.read_noise_from = "assumed";
        return learned;
    }
    static std::string text_of(const fs::path& file) {
        std::ifstream in(file, std::ios::binary);
        return {std::istreambuf_iterator<char>(in), {}};
    }
    std::vector<std::string> files() const {
        std::vector<std::string> names;
        for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
        std::ranges::sort(names);
        return names;
    }

    fs::path folder;
};

TEST_F(LearnReportTest, tells_what_was_left_out_what_varies_and_what_will_be_found) {
    const LearnedParts parts = learn(17);
    double progress = 0;
    const auto report = check_learned(parts, 24, [&](double done) { progress = done; });
    ASSERT_TRUE(report) << report.error().message();
    EXPECT_EQ(progress, 1);
    const auto written = write_learn_report(*report);
    ASSERT_TRUE(written) << written.error().message();
    EXPECT_THAT(files(), ElementsAre("lens.learn.csv", "lens.learn.json", "lens.learn.md", "lens.learn.png"));

    const Json told = Json::parse(text_of(folder / "lens.learn.json"));
    EXPECT_EQ(told["schema"], 1);
    EXPECT_EQ(told["reference"], "lens.hordref");
    EXPECT_EQ(told["parts"], 16);
    EXPECT_EQ(told["parts_given"], 17);
    EXPECT_EQ(told["left_out"].at(0)["frame"], "part 17");
    EXPECT_EQ(told["false_rejects"]["parts"], 16);
    EXPECT_EQ(told["flaws"].size(), algo::kPaintedFlaws.size());
    EXPECT_EQ(told["modes"].size(), 3U);
    std::set<std::string> about;
    for (const Json& sentence : told["sentences"]) about.insert(sentence["about"]);
    EXPECT_THAT(about, ElementsAre("false-rejects", "flaws", "left-out", "variation"));

    ASSERT_TRUE(write_reference(parts.file, *parts.reference));
    EXPECT_EQ(told["reference_crc32"], fmt::format("{:08X}", read_reference_facts(parts.file)->crc32));
    const std::string picture = text_of(folder / "lens.learn.png");
    EXPECT_TRUE(picture.starts_with("\x89PNG"));
    EXPECT_EQ(told["picture"]["crc32"], fmt::format("{:08X}", common::crc32(picture)));

    const std::string page = text_of(folder / "lens.learn.md");
    for (const char* part : {"# What was learned: lens.hordref", "16 of 17 parts", "given 1 electrons a DN",
                             "assumed read noise", "Left out: part 17: ", "| part 17 | - | - | - | left out: ",
                             "![mean, spread and modes](lens.learn.png)", "| part 3 |"})
        EXPECT_THAT(page, HasSubstr(part));
}

TEST_F(LearnReportTest, of_few_parts_says_how_many_are_needed_and_shows_what_varies) {
    const LearnedParts parts = learn(9);
    const auto report = check_learned(parts, 24);
    ASSERT_TRUE(report) << report.error().message();
    ASSERT_TRUE(write_learn_report(*report));
    const Json told = Json::parse(text_of(folder / "lens.learn.json"));
    EXPECT_THAT(told.dump(), HasSubstr("give at least 11"));
    EXPECT_FALSE(told.contains("false_rejects"));
    EXPECT_TRUE(told["flaws"].empty());
    EXPECT_EQ(told["modes"].size(), 3U);
}

TEST_F(LearnReportTest, ends_with_its_frames) {
    LearnedParts parts = learn(17);
    for (const std::size_t most : {0U, 20U, 60U}) {
        std::size_t given = 0;
        parts.frame_of = [&](std::size_t k) -> Result<Frame> {
            if (given++ >= most) return fail(ErrorCode::refused, "not wanted any more", "none");
            return drawn_lens(k + 1);
        };
        const auto report = check_learned(parts, 24);
        ASSERT_FALSE(report) << most;
        EXPECT_EQ(report.error().code, ErrorCode::refused);
        EXPECT_EQ(given, most + 1);  // it asks for no other
    }
}

TEST_F(LearnReportTest, a_disk_that_takes_none_is_told_and_no_json_is_left) {
    const LearnedParts parts = learn(9);
    const auto report = check_learned(parts, 0);
    ASSERT_TRUE(report) << report.error().message();
    fs::create_directory(folder / "lens.learn.md");  // what cannot be replaced
    const auto written = write_learn_report(*report);
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().code, ErrorCode::refused);
    EXPECT_THAT(written.error().what, HasSubstr("lens.learn.md"));
    EXPECT_FALSE(fs::exists(folder / "lens.learn.json"));
}

}  // namespace
}  // namespace hord::firmware
