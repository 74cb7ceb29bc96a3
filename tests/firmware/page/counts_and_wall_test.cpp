// What the store gives besides a search, and the file of a wall of stations.
#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/firmware/page/small_page.h"

namespace hord::firmware::page::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;
using store::test::TempFolder;
using store::test::write_text;

TEST(PageResults, are_downloaded_as_csv_by_the_same_filters) {
    SmallPage page;
    const Reply all = page.get("/api/results.csv"), some = page.get("/api/results.csv", {{"verdict", "reject"}});
    EXPECT_EQ(all.type, "text/csv; charset=utf-8");
    EXPECT_EQ(std::ranges::count(all.body, '\n'), 31);  // with the head
    EXPECT_EQ(std::ranges::count(some.body, '\n'), 4);
    EXPECT_EQ(page.get("/api/results.csv", {{"limit", "10001"}}).status, 400);
    EXPECT_EQ(page.get("/api/counts", {{"span", "1y"}}).status, 400);
    EXPECT_EQ(Json::parse(page.get("/api/counts", {{"span", "7d"}}).body)["step_s"], 3600);
}

TEST(PageResults, refuse_a_filter_that_no_result_can_meet_and_name_those_that_can) {
    SmallPage page;
    const auto refused = [&](const char* path, const Fields& query, const char* error, const char* cure) {
        const Reply reply = page.get(path, query);
        EXPECT_EQ(reply.status, 400) << path << " " << reply.body;
        const Json told = Json::parse(reply.body);
        EXPECT_EQ(told.value("error", ""), error);
        EXPECT_THAT(told.value("cure", ""), HasSubstr(cure));
    };
    for (const char* path : {"/api/results", "/api/results.csv"}) {
        refused(path, {{"verdict", "bad"}}, "verdict cannot be \"bad\"", "use one of pass, reject, unfit");
        refused(path, {{"reason", "late"}}, "reason cannot be \"late\"", "neighbours-disagree, deflection-gradient");
        refused(path, {{"kind", "bubble"}}, "kind cannot be \"bubble\"",
                "use one of scattering, absorbing, surface, scratch, unknown");
        refused(path, {{"recipe", "lense"}}, "recipe cannot be \"lense\"", "use one of lens");
        refused(path, {{"part", "x"}}, "part cannot be \"x\"", "a part's number");
        refused(path, {{"before", "x"}}, "before cannot be \"x\"", "a result's number");
        refused(path, {{"before", "0"}}, "before cannot be \"0\"", "a result's number");
        refused(path, {{"before", "-1"}}, "before cannot be \"-1\"", "a result's number");
        refused(path, {{"part", "0"}}, "part cannot be \"0\"", "a part's number");
        refused(
            path, {{"since", "2026-01-02"}, {"until", "2026-01-01"}},
            "since (2026-01-02T00:00:00.000Z) is not before until (2026-01-01T00:00:00.000Z): no result is in between",
            "give the earlier time as since");
        refused(path, {{"limit", "0"}}, "limit cannot be \"0\"", "write 1 to ");
        refused(path, {{"verdict", "pass"}, {"verdict", "reject"}}, "verdict is given more than once", "once");
        refused(path, {{"verdct", "pass"}}, (std::string(path) + " has no \"verdct\"").c_str(), "use verdict, reason");
        EXPECT_EQ(page.get(path, {{"since", "soon"}}).status, 400);
        EXPECT_EQ(page.get(path, {{"recipe", "lens"}, {"verdict", ""}, {"until", "2000-01-01"}}).status, 200)
            << "a known recipe without results of that time";
    }
    for (const char* path : {"/api/counts", "/api/scores", "/api/history"})
        refused(path, {{"days", "1"}}, (std::string(path) + " has no \"days\"").c_str(), "use span");
    for (const char* path : {"/api/state", "/api/page", "/api/recipe", "/api/changes"})
        refused(path, {{"x", "1"}}, (std::string(path) + " has no \"x\"").c_str(), "leave it out");
    refused("/parts/10/found.json", {{"maps", "emd"}}, "/parts/10/found.json has no \"maps\"", "use map");
    EXPECT_EQ(page.get("/", {{"x", "1"}}).status, 200);
}

TEST(PageResults, give_the_trend_of_scores) {
    SmallPage page;
    EXPECT_EQ(page.get("/api/scores", {{"span", "7d"}}).status, 400);
    const Json day = Json::parse(page.get("/api/scores", {{"span", "24h"}}).body);
    EXPECT_EQ(day["step_s"], 300);
    EXPECT_EQ(day["fields"], Json::parse(R"(["passed_mean","passed_highest","other_highest"])"));
    EXPECT_EQ(Json::parse(page.get("/api/scores").body)["step_s"], 5);
    EXPECT_TRUE(Json::parse(page.get("/api/scores").body)["rows"].empty());  // the results are of another day
    Request request;
    request.path = "/api/scores";
    EXPECT_FALSE(Pages::is_in_memory(request));
}

TEST(PageResults, that_do_not_exist_yet_are_told_without_a_path) {
    SmallPage page;
    const std::string folder = page.folder.path().string();
    std::filesystem::remove_all(page.folder.path());
    for (const char* path : {"/api/results", "/api/counts", "/api/scores", "/api/recipe", "/api/changes"}) {
        const Reply reply = page.get(path);
        EXPECT_EQ(reply.status, 200) << path;
        EXPECT_TRUE(Json::parse(reply.body)["rows"].empty()) << path;
        EXPECT_THAT(reply.body, HasSubstr("yet")) << path;
        EXPECT_THAT(reply.body, Not(HasSubstr(folder))) << path;
    }
    const Json part = Json::parse(page.get("/parts/00000007-110/part.json").body);
    EXPECT_FALSE(part.contains("result"));
    EXPECT_TRUE(part.contains("no_result") && part.contains("no_frame"));
}

TEST(PageWall, its_file_is_read_strictly) {
    const TempFolder folder;
    const auto file = folder.path() / "stations.toml";
    write_text(file,
               "[[station]]\nname = \"a\"\nmodbus = \"h:1502\"\npage = \"https://h/\"\n"
               "[[station]]\nname = \"b\"\nmodbus = \"i\"\n");
    const auto read = load_stations(file);
    ASSERT_TRUE(read) << read.error().message();
    ASSERT_EQ(read->size(), 2U);
    EXPECT_EQ(read->at(0).modbus.port, 1502);
    EXPECT_EQ(read->at(1).page, "");
    write_text(file,
               "[[station]]\nname = \"a\"\nmodbus = \"h:x\"\npage = \"javascript:alert(1)\"\n"
               "[[station]]\nname = \"a\"\nmodbus = \"h\"\nport = 3\n");
    const auto wrong = load_stations(file);
    ASSERT_FALSE(wrong);
    for (const char* part : {":3", "javascript", "two stations are called", "port"})
        EXPECT_THAT(wrong.error().what, HasSubstr(part));
    write_text(file, "# none\n");
    EXPECT_FALSE(load_stations(file));
    EXPECT_FALSE(load_stations(folder.path() / "away.toml"));
}

}  // namespace
}  // namespace hord::firmware::page::test
