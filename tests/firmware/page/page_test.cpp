// Units of the page: values in memory, store and picture ring, metrics for Prometheus and Grafana.
#include <algorithm>
#include <regex>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/core/faults.h"
#include "tests/firmware/page/small_page.h"
#include "tests/system/cli/program.h"

namespace hord::firmware::page::test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;
using store::test::TempFolder;
using store::test::write_text;

// -- values in memory

TEST(PageHistory, stays_of_its_size_and_the_worst_latency_of_a_long_step_is_kept) {
    History history;
    for (int k = 0; k < 100'000; ++k) {
        HistoryValues values;
        values[0] = static_cast<float>(k % 120 < 60 ? 100 : 200);
        if (k % 120 == 7) values[5] = 93.0F;
        history.add(1'000'000 + 2 * k, values);
    }
    EXPECT_EQ(history.size(false), History::kShortKept);
    EXPECT_EQ(history.size(true), History::kLongKept);
    const Json day = Json::parse(history.json(true));
    EXPECT_EQ(day["step_s"], 240);
    EXPECT_EQ(day["rows"].size(), History::kLongKept);
    for (const Json& row : day["rows"]) {
        EXPECT_EQ(row[1], 150);
        EXPECT_EQ(row[6], 93);
        EXPECT_TRUE(row[2].is_null());
    }
}

TEST(PageViewers, are_so_many_and_no_more_and_a_slow_one_is_told_to_ask_anew) {
    Viewers viewers(2);
    auto one = viewers.enter();
    auto two = viewers.enter();
    ASSERT_TRUE(one && two);
    EXPECT_FALSE(viewers.enter());
    two.reset();
    EXPECT_TRUE(viewers.enter());
    for (std::size_t k = 0; k <= Viewers::kQueue; ++k) viewers.publish("result", "{}");
    EXPECT_EQ(one->next(), "event: overrun\ndata: {}\n\n");
    viewers.publish("state", "{}");
    EXPECT_EQ(one->next(), "event: state\ndata: {}\n\n");
    EXPECT_EQ(one->next(), "");
    viewers.keep_alive();
    EXPECT_THAT(*one->next(), HasSubstr(": "));  // a comment that keeps the connection open
    viewers.end();
    EXPECT_FALSE(one->next());
    EXPECT_FALSE(viewers.enter());
}

TEST(PageViewers, sleep_without_an_event_and_are_woken_once) {
    Viewers viewers(1);
    int slept = 0, woken = 0;
    const auto one = viewers.enter([&] { ++slept; }, [&] { ++woken; });
    viewers.publish("state", "{}");
    EXPECT_EQ(woken, 0);  // it was awake
    (void)one->next();
    EXPECT_EQ(one->next(), "");
    EXPECT_EQ(slept, 1);
    viewers.publish("state", "{}");
    viewers.publish("state", "{}");
    viewers.keep_alive();
    EXPECT_EQ(woken, 1);
    (void)one->next();
    (void)one->next();
    viewers.end();
    EXPECT_EQ(woken, 2);
}

std::set<std::string> names_in(const std::string& text, const std::regex& pattern) {
    std::set<std::string> names;
    for (auto at = std::sregex_iterator(text.begin(), text.end(), pattern); at != std::sregex_iterator(); ++at)
        names.insert((*at)[1].str());
    return names;
}

TEST(PageLive, keeps_a_strip_of_fixed_length_and_says_when_nobody_answers) {
    Viewers viewers(1);
    Live live(viewers);
    for (std::uint32_t k = 1; k <= 1000; ++k) live.add_result(seen(k, k % 4 == 0 ? "reject" : "pass"));
    live.set_station(example_snapshot());
    live.set_light(0.5);
    Json page = live.page_json();
    EXPECT_EQ(page["results"].size(), Live::kStrip);
    EXPECT_EQ(page["results"].back()["sequence"], 1000);
    EXPECT_EQ(page["state"]["rows"]["status"]["state"], "ContinuousExecution");
    EXPECT_EQ(page["state"]["light_share"], 0.5);
    ASSERT_EQ(page["state"]["faults_active"].size(), 1U);
    EXPECT_THAT(page["state"]["faults_active"][0]["cure"].get<std::string>(), ::testing::Not(::testing::IsEmpty()));
    EXPECT_EQ(page["state"]["faults_latched"].size(), 1U);  // an active fault is not listed again as latched
    live.set_unreachable({ErrorCode::disconnected, "station 1 cannot be reached", "check the cable"});
    const Json state = live.state_json();
    EXPECT_EQ(state["up"], false);
    EXPECT_EQ(state["trouble"]["cure"], "check the cable");
    EXPECT_TRUE(state["faults_active"].empty());
    for (const char* bit : {"line_stop", "run_permit", "plc_lost", "results_overrun"})
        EXPECT_TRUE(state.contains(bit) && state[bit].is_null()) << bit << " is not known";
}

TEST(PageLive, state_has_every_key_that_the_page_reads) {
    Viewers viewers(1);
    Live live(viewers);
    live.set_unreachable({ErrorCode::disconnected, "station 1 cannot be reached", "check the cable"});
    live.set_light(0.8);
    const Json state = live.state_json();
    const std::string script =
        store::test::read_text(std::filesystem::path(HORD_SOURCE_DIR) / "firmware/page/site/page.js");
    const std::set<std::string> keys = names_in(script, std::regex(R"(\bstate\.([a-z_]+))"));
    EXPECT_GE(keys.size(), 10U);
    for (const std::string& key : keys) EXPECT_TRUE(state.contains(key)) << key;
    EXPECT_EQ(state["light_share"], 0.8);
}

// -- the store and the ring

TEST(PageParts, have_two_kinds_of_names_and_nothing_else_is_one) {
    EXPECT_EQ(parse_part_key("4711")->number, 4711);
    const auto live = parse_part_key("0a1b2c3d-42");
    ASSERT_TRUE(live);
    EXPECT_EQ(live->boot, 0x0a1b2c3dU);
    EXPECT_EQ(live->part, 42U);
    for (const char* wrong : {"", "0", "-1", "+1", "1 ", "4711x", "..", "0a1b2c3d-", "0a1b2c3d-4294967296",
                              "0a1b2c3-42", "0a1b2c3d-42-1", "0x1b2c3d-42", "99999999999999999999", "%31"}) {
        EXPECT_FALSE(parse_part_key(wrong)) << wrong;
    }
}

TEST(PageResults, are_found_page_by_page) {
    SmallPage page;
    std::int64_t before = 0;
    std::vector<std::int64_t> numbers;
    for (bool more = true; more;) {
        Fields fields{{"limit", "7"}};
        if (before != 0) fields.emplace("before", std::to_string(before));
        const auto text = page.results.search(fields);
        ASSERT_TRUE(text) << text.error().message();
        const Json found = *text;
        for (const Json& row : found["rows"]) numbers.push_back(row["number"]);
        before = numbers.back();
        more = found["more"];
    }
    ASSERT_EQ(numbers.size(), 30U);
    for (std::size_t k = 0; k < numbers.size(); ++k) EXPECT_EQ(numbers[k], static_cast<std::int64_t>(30 - k));
    const auto count = [&](const Fields& fields) { return page.results.search(fields)->at("rows").size(); };
    EXPECT_EQ(count({{"verdict", "reject"}}), 3U);
    EXPECT_EQ(count({{"kind", "scratch"}}), 3U);
    EXPECT_EQ(count({{"part", "110"}}), 1U);
    EXPECT_EQ(count({{"recipe", "lens"}}), 30U);
    EXPECT_EQ(count({{"until", "2026-01-01"}}), 0U);
    for (const Fields& wrong : {Fields{{"limit", "0"}},
                                {{"limit", "201"}},
                                {{"part", "x"}},
                                {{"since", "yesterday"}},
                                {{"since", "2026-11-22"}, {"until", "2026-11-21"}},
                                {{"verdcit", "reject"}},
                                {{"kind", "' OR 1=1 --"}},
                                {{"recipe", "' OR 1=1 --"}},
                                {{"reason", std::string(101, 'a')}},
                                {{"recipe", "a\nb"}}}) {
        const auto refused = page.results.search(wrong);
        ASSERT_FALSE(refused) << wrong.begin()->first;
        EXPECT_EQ(refused.error().code, ErrorCode::invalid_argument);
    }
}

TEST(PageResults, of_a_store_that_is_away_or_none_are_a_clear_refusal) {
    Results none{""};
    EXPECT_THAT(none.search({}).error().cure, HasSubstr("page.toml"));
    Results away{"/nowhere"};
    EXPECT_EQ(away.search({}).error().code, ErrorCode::not_found);
    const TempFolder folder;
    write_text(folder.path() / "results.db", std::string(5000, 'x'));
    Results damaged{folder.path()};
    EXPECT_EQ(damaged.search({}).error().code, ErrorCode::unreadable);
}

TEST(PageResults, are_read_while_a_station_writes) {
    SmallPage page;
    const auto store = store::test::open(page.folder);
    ASSERT_TRUE(store->write(store::test::Story(store::test::start(9)).add_results(1, 5).entries()));
    EXPECT_EQ(page.results.search({})->at("rows").size(), 35U);
    EXPECT_EQ(page.results.one({std::nullopt, 9, 103})->number, 33);
    EXPECT_EQ(page.results.one({std::nullopt, kBoot, 103})->number, 3);  // the same number of an earlier start
    EXPECT_EQ(page.results.one({std::nullopt, 8, 103}).error().code, ErrorCode::not_found);
}

// As in hord-page.service: the user reads the folder as a member of its group and writes nothing.
TEST(PageResults, are_read_without_the_right_to_write_while_a_station_runs_and_when_none_does) {
    if (::geteuid() != 0 || !std::filesystem::exists("/usr/bin/setpriv"))
        GTEST_SKIP() << "needs root and setpriv, to be another user";
    SmallPage page;
    constexpr gid_t kGroup = 4711;
    const auto give = [&] {
        ASSERT_EQ(::chown(page.folder.path().c_str(), 0, kGroup), 0);
        ASSERT_EQ(::chmod(page.folder.path().c_str(), 0750), 0);
        for (const auto& entry : std::filesystem::directory_iterator(page.folder.path())) {
            ASSERT_EQ(::chown(entry.path().c_str(), 0, kGroup), 0);
            if (!entry.is_directory()) {
                ASSERT_EQ(::chmod(entry.path().c_str(), 0640), 0);
            }
        }
    };
    const auto as_member = [&] {
        return hord::test::run("/usr/bin/setpriv",
                               {"--reuid=4712", "--regid=4712", "--groups=4711", std::string(HORD_BIN_DIR) + "/hordctl",
                                "results", "--store", page.folder.path().string(), "--format", "csv"});
    };
    give();
    const auto at_rest = as_member();
    EXPECT_EQ(at_rest.status, 0) << at_rest.err;
    EXPECT_EQ(std::count(at_rest.out.begin(), at_rest.out.end(), '\n'), 31);
    const auto store = store::test::open(page.folder);
    ASSERT_TRUE(store->write(store::test::Story(store::test::start(9)).add_results(1, 5).entries()));
    give();
    const auto running = as_member();
    EXPECT_EQ(running.status, 0) << running.err;
    EXPECT_EQ(std::count(running.out.begin(), running.out.end(), '\n'), 36);
}

TEST(PageFrames, belong_to_the_part_of_one_start_and_a_torn_one_is_told) {
    SmallPage page;
    const auto kept = page.frames.find(kBoot, kBadPart);
    ASSERT_TRUE(kept) << kept.error().message();
    EXPECT_EQ(page.frames.find(kBoot + 1, kBadPart).error().code, ErrorCode::not_found);
    EXPECT_EQ(page.frames.find(kBoot, 111).error().code, ErrorCode::not_found);
    ASSERT_TRUE(page.frames.newest());
    EXPECT_FALSE(page.frames.newest());          // nothing new
    keep_frame(page.folder.path(), 112, false);  // passed, and is not kept
    ASSERT_TRUE(page.frames.newest_reject());
    EXPECT_FALSE(page.frames.newest_reject());
    const auto file = page.folder.path() / store::kFramesFolder / kept->name;
    std::filesystem::resize_file(file, std::filesystem::file_size(file) / 2);
    EXPECT_EQ(page.frames.find(kBoot, kBadPart).error().code, ErrorCode::unreadable);
    std::filesystem::remove(file);
    EXPECT_EQ(page.frames.find(kBoot, kBadPart).error().code, ErrorCode::not_found);
}

TEST(PagePicture, shows_what_the_inspection_said_then) {
    SmallPage page;
    const Json found = Json::parse(page.get("/parts/00000007-110/found.json").body);
    ASSERT_FALSE(found["defects"].empty());
    // In the picture, and in mm from the middle of 24 by 24 lenslets of half a millimetre.
    const Json& worst = found["defects"][0];
    EXPECT_LT(worst["at"][0], found["width"]);
    EXPECT_LT(worst["at"][1], found["height"]);
    EXPECT_NEAR(worst["x_mm"].get<double>(), 0.5 * (worst["m"].get<double>() - 11.5), 1e-5);
    EXPECT_NEAR(worst["y_mm"].get<double>(), 0.5 * (worst["n"].get<double>() - 11.5), 1e-5);
    for (const Json& map : found["maps"])
        EXPECT_EQ(page.get("/parts/00000007-110/map.png", {{"map", map["name"]}}).status, 200) << map;
    EXPECT_EQ(found["part"], kBadPart);
    EXPECT_EQ(found["verdict"], "reject");
    EXPECT_EQ(found["same_as_then"], true);
    ASSERT_GE(found["defects"].size(), 1U);
    EXPECT_NEAR(found["defects"][0]["m"].get<double>(), 12, 2);  // where the spots are displaced
    EXPECT_NEAR(found["defects"][0]["n"].get<double>(), 11, 2);
    const Reply map = page.get("/parts/00000007-110/map.png");
    EXPECT_EQ(map.type, "image/png");
    EXPECT_TRUE(map.body.starts_with("\x89PNG"));
    EXPECT_NE(page.get("/parts/10/map.png", {{"map", "transmission"}}).body, map.body);
    // Without a name the map that decided; its name among others.
    const auto decided = found["map"].get<std::string>();
    EXPECT_EQ(page.get("/parts/00000007-110/map.png", {{"map", decided}}).body, map.body) << decided;
    EXPECT_TRUE(found["sentence"].get<std::string>().starts_with("Rejected: "));
    EXPECT_EQ(page.get("/parts/00000007-110/map.png", {{"map", "sums"}}).status, 200);
    EXPECT_EQ(found["defect_count"], found["defects"].size());  // fewer than 20
    for (const char* wrong : {"/parts/10/map.png", "/parts/10/part.json", "/parts/10/found.json"}) {
        EXPECT_EQ(page.get(wrong, {{"map", "../x"}}).status, 400) << wrong;
    }
    EXPECT_NEAR(brightest_share(page.frames.find(kBoot, kBadPart)->frame.frame.view()), 200.0 / 255, 0.02);
}

TEST(PageRecord, holds_everything_and_an_archive_that_tar_reads) {
    SmallPage page;
    const Reply reply = page.get("/parts/10/record.tar");
    ASSERT_EQ(reply.status, 200);
    const TempFolder folder;
    write_text(folder.path() / "r.tar", reply.body);
    const auto said =
        hord::test::run("/bin/tar", {"-xf", (folder.path() / "r.tar").string(), "-C", folder.path().string()});
    ASSERT_EQ(said.status, 0) << said.err;
    const auto inside = folder.path() / "part-00000007-110";
    const Json record = Json::parse(store::test::read_text(inside / "record.json"));
    EXPECT_EQ(record["result"]["number"], 10);
    EXPECT_EQ(record["frame_metadata"]["recipe"], std::string(kKeptRecipe));
    EXPECT_EQ(store::test::read_text(inside / "frame.png"), page.get("/parts/10/frame.png").body);
    EXPECT_THAT(Json::parse(page.get("/parts/11/record.json").body)["no_frame"].get<std::string>(),
                HasSubstr("no frame of part 111"));
}

// -- Prometheus and Grafana

std::string example_metrics() {
    Viewers viewers(1);
    Live live(viewers);
    live.set_station(example_snapshot());
    live.add_result(seen(1));
    live.add_result(seen(2, "reject"));
    live.set_light(0.8);
    return metrics_text(live.figures(), {"0.0.1", 1, {{200, 3}}, {{"completed", 1}}, 2});
}

TEST(PageMetrics, are_as_prometheus_wants_them) {
    if (!std::filesystem::exists("/usr/bin/promtool")) GTEST_SKIP() << "promtool is not installed (package prometheus)";
    const TempFolder folder;
    write_text(folder.path() / "m", example_metrics());
    const auto said = hord::test::run("/bin/sh", {"-c", "promtool check metrics <" + (folder.path() / "m").string()});
    EXPECT_EQ(said.status, 0);
    EXPECT_EQ(said.out + said.err, "");
}

// The rules and what they are there for: tests/firmware/page/alerts_*test.yml.
TEST(PageMetrics, alerts_fire_when_they_should_and_a_quiet_line_fires_none) {
    if (!std::filesystem::exists("/usr/bin/promtool")) GTEST_SKIP() << "promtool is not installed (package prometheus)";
    const std::filesystem::path tree(HORD_SOURCE_DIR);
    const TempFolder folder;  // the test files name the rules beside themselves
    std::filesystem::copy(tree / "deploy/prometheus/hord-station.rules.yml", folder.path());
    const std::string rules = (folder.path() / "hord-station.rules.yml").string();
    const auto checked = hord::test::run("/usr/bin/promtool", {"check", "rules", "--lint=all", "--lint-fatal", rules});
    EXPECT_EQ(checked.status, 0) << checked.out << checked.err;
    std::string test;
    for (const char* name : {"alerts_test.yml", "alerts_trend_test.yml"}) {
        std::filesystem::copy(tree / "tests/firmware/page" / name, folder.path());
        const auto tested = hord::test::run("/usr/bin/promtool", {"test", "rules", (folder.path() / name).string()});
        EXPECT_EQ(tested.status, 0) << name << tested.out << tested.err;
        test += store::test::read_text(folder.path() / name);
    }
    const std::string text = store::test::read_text(rules);
    const std::string page = store::test::read_text(tree / "docs/page.md");
    const std::set<std::string> alerts = names_in(text, std::regex("- alert: (\\w+)"));
    EXPECT_GT(alerts.size(), 15U);
    for (const std::string& alert : alerts) {
        EXPECT_THAT(test, HasSubstr(alert));
        EXPECT_THAT(page, HasSubstr("`" + alert + "`"));
    }
    // Faults are named as the station names them.
    for (const std::string& fault : names_in(text, std::regex("HORD_FAULT=([a-z-]+)"))) {
        const bool known = std::any_of(kFaultTable.begin(), kFaultTable.end(),
                                       [&](const FaultInfo& info) { return info.name == fault; });
        EXPECT_TRUE(known) << fault;
    }
}

TEST(PageMetrics, say_what_the_station_said) {
    const std::string text = example_metrics();
    for (const char* line :
         {"hord_station_up 1\n", "hord_station_state{state=\"ContinuousExecution\"} 1\n",
          "hord_station_state{state=\"Error\"} 0\n", "hord_fault_active{fault=\"light-level\"} 1\n",
          "hord_parts_judged_total{verdict=\"pass\"} 9\n", "hord_verdict_latency_seconds_bucket{le=\"0.15\"} 2\n",
          "hord_verdict_latency_seconds_bucket{le=\"0.1\"} 0\n", "hord_reject_latency_seconds_count 1\n",
          "hord_store_disk_free_ratio 0.5\n", "hord_plc_heartbeat_age_seconds 0.02\n", "hord_grid_drift_pixels 0.02\n",
          "name=\"lens \\\"a\\\"\\\\\""}) {
        EXPECT_THAT(text, HasSubstr(line));
    }
    Viewers viewers(1);
    Live away(viewers);
    away.set_station(example_snapshot());
    away.set_unreachable({ErrorCode::disconnected, "gone", ""});
    const std::string without = metrics_text(away.figures(), {});
    EXPECT_THAT(without, HasSubstr("hord_station_up 0\n"));
    EXPECT_THAT(without, ::testing::Not(HasSubstr("hord_run_permit")));  // no stale values
}

TEST(PageMetrics, all_that_dashboard_and_alerts_ask_for_exist_and_all_are_described) {
    const std::filesystem::path tree(HORD_SOURCE_DIR);
    const Json dashboard =
        Json::parse(store::test::read_text(tree / "deploy/grafana/hord-station.json"), nullptr, false);
    ASSERT_TRUE(dashboard.is_object());
    const std::string metrics = example_metrics();
    std::string asked;
    int queries = 0;
    for (const Json& panel : dashboard["panels"]) {
        if (!panel.contains("targets")) continue;
        for (const Json& target : panel["targets"]) {
            asked += target["expr"].get<std::string>() + "\n";
            ++queries;
        }
    }
    EXPECT_GT(queries, 10);
    for (const char* ageing :
         {"hord_light_output_ratio", "hord_dark_drift_dn", "hord_light_uneven_ratio", "hord_dust_specks"})
        EXPECT_THAT(asked, HasSubstr(ageing));
    asked += store::test::read_text(tree / "deploy/prometheus/hord-station.rules.yml");
    const std::set<std::string> there = names_in(metrics, std::regex("(?:^|\n)([a-z_][a-z0-9_]*)[{ ]"));
    for (const std::string& name : names_in(asked, std::regex("\\b((?:hord|process)_[a-z0-9_]+)")))
        EXPECT_TRUE(there.contains(name)) << name;
    const std::string page = store::test::read_text(tree / "docs/page.md");
    for (const std::string& name : names_in(metrics, std::regex("# TYPE ([a-z0-9_]+)")))
        EXPECT_THAT(page, HasSubstr("`" + name + "`"));
}

}  // namespace
}  // namespace hord::firmware::page::test
