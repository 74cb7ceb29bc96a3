// The reference on the page: with its report, without, with a damaged one, and addresses that name something else.
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <sys/stat.h>

#include "common/crc32.h"
#include "firmware/page/reference_report.h"
#include "tests/firmware/page/small_page.h"

namespace hord::firmware::page::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;
using store::test::TempFolder;
using store::test::write_text;

constexpr std::uint32_t kReferenceCrc = 0x0A1B2C3D;
const std::string kPicture = "\x89PNG and what a picture holds";

class PageReference : public ::testing::Test {
  protected:
    PageReference() {
        // A reference's file as far as the page reads it: magic, version, 12 numbers, maps, checksum.
        const auto put = [](std::string& text, std::uint32_t value) {
            for (unsigned byte = 0; byte < 4; ++byte) text += static_cast<char>(value >> 8 * byte & 0xFFU);
        };
        std::string text = "HORDREF\n";
        for (const std::uint32_t value : {2U, 61U, 61U, 9U, 9U, 12U, 48U, 100U, 4000U, 23U, 0U, 0U, 0U})
            put(text, value);
        text += std::string(1000, 'm');
        put(text, kReferenceCrc);
        write_text(file, text);
        write_text(folder.path() / "taught-7-1.learn.png", kPicture);
        write_report(good_report());
    }
    static Json good_report() {
        return {{"schema", 1},
                {"reference", "taught-7-1.hordref"},
                {"reference_crc32", fmt::format("{:08X}", kReferenceCrc)},
                {"learned", "2026-11-26T23:43:12.170Z"},
                {"parts", 23},
                {"parts_given", 24},
                {"modes", {0.5, 0.2, 0.1}},
                {"flaws",
                 {{{"kind", "scratch"},
                   {"size", "half width"},
                   {"unit", "lenslets"},
                   {"a90", 0.1},
                   {"a90_95", nullptr},
                   {"trials", 96},
                   {"found", 60}}}},
                {"left_out", {{{"frame", "part 31"}, {"why", "it differs"}}}},
                {"sentences", {{{"about", "left-out"}, {"text", "Left out: part 31: it differs."}}}},
                {"false_rejects", {{"parts", 23}, {"rejected", 0}, {"bound", 0.122}, {"tail_bound", nullptr}}},
                {"picture",
                 {{"crc32", fmt::format("{:08X}", common::crc32(kPicture))}, {"width", 1948}, {"height", 2658}}}};
    }
    void write_report(const Json& report) { write_report(report.dump()); }
    void write_report(const std::string& text) { write_text(report_path, text); }
    store::Json recipe() const { return {{"name", "lens"}, {"time", "2026-11-26T23:44:00Z"}, {"text", recipe_text()}}; }
    std::string recipe_text() const {
        return "number = 7\nname = \"lens\"\n[reference]\nfile = \"" + file.string() + "\"\n";
    }
    store::Json shown() const { return reference_json(recipe()); }
    std::string note() const {
        const store::Json json = shown();
        EXPECT_TRUE(json["report"].is_null());
        return json.value("note", "none");
    }
    // The page of a station whose store names this reference.
    void tell(SmallPage& page) const {
        store::test::Story story(store::test::start(kBoot + 1));
        story.add(store::test::recipe("lens", recipe_text()));
        store::test::write(page.folder, story);
    }
    static std::string picture_name(const std::string& picture = kPicture) {
        return fmt::format("/reference/{:08X}.png", common::crc32(picture));
    }

    TempFolder folder;
    const fs::path file = folder.path() / "taught-7-1.hordref", report_path = folder.path() / "taught-7-1.learn.json",
                   picture_path = folder.path() / "taught-7-1.learn.png";
};

TEST_F(PageReference, is_shown_with_its_report_and_its_picture) {
    SmallPage page;
    tell(page);
    const Reply reply = page.get("/api/reference");
    ASSERT_EQ(reply.status, 200) << reply.body;
    const Json shown = Json::parse(reply.body);
    EXPECT_EQ(shown["file"], "taught-7-1.hordref");
    EXPECT_EQ(shown["parts"], 23);
    EXPECT_FALSE(shown.contains("note"));
    const Json& report = shown["report"];
    EXPECT_EQ(report["learned"], "2026-11-26T23:43:12.170Z");
    EXPECT_EQ(report["parts_given"], 24);
    EXPECT_EQ(report["left_out"][0]["frame"], "part 31");
    EXPECT_EQ(report["sentences"][0]["text"], "Left out: part 31: it differs.");
    EXPECT_NEAR(report["false_rejects"]["bound"], 0.122, 1e-6);
    EXPECT_NEAR(report["flaws"][0]["a90"], 0.1, 1e-6);
    EXPECT_TRUE(report["flaws"][0]["a90_95"].is_null());
    EXPECT_THAT(reply.body, Not(HasSubstr(folder.path().string())));
    const Reply picture = page.get("/reference/" + report["picture"]["crc32"].get<std::string>() + ".png");
    EXPECT_EQ(picture.status, 200) << picture.body;
    EXPECT_EQ(picture.type, "image/png");
    EXPECT_EQ(picture.body, kPicture);
    EXPECT_EQ(page.get("/api/reference", {{"file", "/etc/passwd"}}).status, 400);
}

TEST_F(PageReference, that_is_not_there_is_told_in_a_sentence) {
    SmallPage page;  // its recipe has no reference
    EXPECT_THAT(page.get("/api/reference").body, HasSubstr("judges without a reference"));
    EXPECT_EQ(page.get(picture_name()).status, 404);
    Results nothing("/nonexistent");
    EXPECT_FALSE(nothing.recipe_in_use());

    fs::remove(picture_path);
    EXPECT_EQ(reference_picture(recipe(), common::crc32(kPicture)).error().code, ErrorCode::not_found);
    fs::remove(report_path);
    EXPECT_THAT(note(), HasSubstr("There is no report of this reference"));
    EXPECT_EQ(shown()["parts"], 23);
    write_text(file, "HORDREF\n");
    EXPECT_THAT(note(), HasSubstr("cannot read the reference's file"));
    fs::remove(file);
    EXPECT_THAT(note(), HasSubstr("does not find the reference's file"));
    store::Json other = recipe();
    other["text"] = "[reference]\nfile = \"lens.hordref\"\n";
    EXPECT_THAT(reference_json(other)["note"].get<std::string>(), HasSubstr("where the station was started"));
    other["text"] = "no TOML [";
    EXPECT_THAT(reference_json(other)["note"].get<std::string>(), HasSubstr("without a reference"));
    EXPECT_FALSE(reference_picture(other, 1));
}

TEST_F(PageReference, a_damaged_report_is_told_and_nothing_of_it_is_shown) {
    std::string nested(200'000, '[');
    for (const std::string& text : {std::string(), std::string("{"), std::string("[]"), std::string("7"), nested,
                                    good_report().dump().substr(0, 300), std::string(2'000'000, ' ')}) {
        write_report(text);
        EXPECT_THAT(note(), HasSubstr("damaged")) << text.substr(0, 40);
        EXPECT_FALSE(reference_picture(recipe(), common::crc32(kPicture)));
    }
    Json other = good_report();
    other["schema"] = 2;
    write_report(other);
    EXPECT_THAT(note(), HasSubstr("damaged"));
    other = good_report();
    other["reference_crc32"] = "00000000";
    write_report(other);
    EXPECT_THAT(note(), HasSubstr("is of another one"));
    EXPECT_FALSE(reference_picture(recipe(), common::crc32(kPicture)));
}

TEST_F(PageReference, members_of_another_type_are_left_out_and_texts_are_bounded) {
    Json strange = good_report();
    strange["sentences"] = Json::array({7, {{"about", 7}, {"text", std::string(5000, 'x') + "é"}}});
    for (int k = 0; k < 1000; ++k) strange["left_out"].push_back({{"frame", "a"}, {"why", nullptr}});
    strange["flaws"] = "many";
    strange["false_rejects"] = Json::array();
    strange["picture"] = 7;
    strange["learned"] = {{"a", 1}};
    write_report(strange);
    const store::Json report = shown()["report"];
    EXPECT_EQ(report["sentences"].size(), 2U);
    EXPECT_EQ(report["sentences"][0]["text"], "");
    EXPECT_EQ(report["sentences"][1]["text"].get<std::string>().size(), 1000U);
    EXPECT_EQ(report["left_out"].size(), 200U);
    EXPECT_TRUE(report["flaws"].empty());
    EXPECT_TRUE(report["false_rejects"]["bound"].is_null());
    EXPECT_EQ(report["picture"]["crc32"], "");
    EXPECT_EQ(report["learned"], "");
    EXPECT_FALSE(reference_picture(recipe(), common::crc32(kPicture)));
}

TEST_F(PageReference, a_picture_that_is_not_the_reports_is_not_sent) {
    SmallPage page;
    tell(page);
    write_text(picture_path, kPicture + "?");
    const Reply damaged = page.get(picture_name());
    EXPECT_EQ(damaged.status, 500);
    EXPECT_THAT(damaged.body, HasSubstr("the picture is damaged"));
    EXPECT_EQ(page.get(picture_name(kPicture + "?")).status, 404);
    fs::remove(picture_path);
    EXPECT_EQ(page.get(picture_name()).status, 404);
}

TEST_F(PageReference, links_and_what_is_no_file_are_not_followed) {
    const fs::path secret = folder.path() / "secret";
    write_text(secret, kPicture);
    fs::remove(picture_path);
    fs::create_symlink(secret, picture_path);
    EXPECT_FALSE(reference_picture(recipe(), common::crc32(kPicture)));
    fs::remove(picture_path);
    ASSERT_EQ(::mkfifo(picture_path.c_str(), 0600), 0);
    EXPECT_FALSE(reference_picture(recipe(), common::crc32(kPicture)));
    fs::rename(report_path, secret);
    fs::create_symlink(secret, report_path);
    EXPECT_THAT(note(), HasSubstr("damaged"));
    fs::remove(report_path);
    fs::create_directory(report_path);
    EXPECT_THAT(note(), HasSubstr("damaged"));
}

TEST_F(PageReference, an_address_names_a_checksum_and_no_file) {
    SmallPage page;
    tell(page);
    const std::string right = picture_name();
    ASSERT_EQ(page.get(right).status, 200);
    std::string lower = right;
    for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    ASSERT_NE(lower, right);  // else another picture is needed
    for (const std::string& name :
         {std::string("/reference"), std::string("/reference/"), std::string("/reference/taught-7-1.learn.png"),
          std::string("/reference/../taught-7-1.learn.png"), "/reference/.." + right, "/reference//" + right.substr(11),
          std::string("/reference/../../../../etc/passwd"), right + "/", right + ".png",
          right.substr(0, right.size() - 4), "/reference/0" + right.substr(11), "/reference/-" + right.substr(11),
          "/reference/ " + right.substr(11), std::string("/reference/FFFFFFFFFF.png"),
          std::string("/reference/00000000.png"), std::string("/reference/") + std::string(5000, 'A') + ".png"}) {
        const Reply reply = page.get(name);
        EXPECT_EQ(reply.status, 404) << name.substr(0, 60);
        EXPECT_THAT(reply.body, Not(HasSubstr("PNG"))) << name.substr(0, 60);
    }
    EXPECT_EQ(page.get(lower).status, 404);
}

}  // namespace
}  // namespace hord::firmware::page::test
