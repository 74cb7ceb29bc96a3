// What the page answers to requests: ordinary, malicious, too large, from another site. Through the same parsing as
// from a socket.
#include <regex>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "firmware/core/enum_values.h"
#include "firmware/page/site.h"
#include "tests/firmware/page/answer_bytes.h"
#include "tests/firmware/page/small_page.h"

namespace hord::firmware::page::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using Json = nlohmann::json;

std::string ask(SmallPage& page, const std::string& line, const std::string& more = "") {
    return answer_bytes(page.pages, page.viewers, line + " HTTP/1.1\r\nHost: localhost:8070\r\n" + more + "\r\n");
}
std::string status(const std::string& answer) { return answer.substr(0, answer.find("\r\n")); }

TEST(PageRequests, the_page_comes_whole_and_with_a_policy_that_lets_nothing_else_in) {
    SmallPage page;
    for (const char* path :
         {"/", "/page.css", "/page.js", "/charts.js", "/icon.svg", "/api/page", "/api/state", "/api/history?span=24h",
          "/api/results", "/api/recipe", "/api/changes", "/metrics", "/parts/10/record.json"}) {
        const std::string answer = ask(page, std::string("GET ") + path);
        EXPECT_EQ(status(answer), "HTTP/1.1 200 OK") << path;
        EXPECT_THAT(answer, HasSubstr("Content-Security-Policy: default-src 'none'; script-src 'self';"));
        EXPECT_THAT(answer, HasSubstr("X-Content-Type-Options: nosniff"));
    }
    EXPECT_THAT(ask(page, "GET /api/events"), HasSubstr("event: page"));
    EXPECT_EQ(page.viewers.count(), 0U);  // the viewer has left
}

TEST(PageRequests, the_site_names_no_outside_address_and_needs_no_inline_script) {
    for (const EmbeddedFile& file : site_files()) {
        std::string text(file.text);
        for (std::size_t at; (at = text.find("http://www.w3.org/")) != std::string::npos;)
            text.erase(at, 18);  // names of XML namespaces, never fetched
        EXPECT_THAT(text, Not(HasSubstr("http://"))) << file.path;
        EXPECT_THAT(text, Not(HasSubstr("https://"))) << file.path;
        EXPECT_THAT(text, Not(HasSubstr("innerHTML"))) << file.path;
        EXPECT_THAT(text, Not(HasSubstr("onclick="))) << file.path;
    }
}

TEST(PageRequests, the_page_learns_every_reason_that_its_search_offers) {
    SmallPage page;
    const Json reasons = Json::parse(page.get("/api/page").body)["reasons"];
    EXPECT_EQ(reasons.size(), kValuesOf<PartReason>.size() - 1);  // all but "none"
    EXPECT_EQ(reasons.front(), name_of(PartReason::neighbours_disagree));
    EXPECT_EQ(reasons.back(), name_of(PartReason::plc_lost));
}

TEST(PageRequests, a_command_that_the_page_does_not_send_is_refused_with_the_place_that_does) {
    SmallPage page;
    const auto told = [&](const char* body) { return Json::parse(page.reply_to(page.command(body)).body); };
    EXPECT_EQ(told(R"({"command":"teach"})")["error"], "the page does not send this command");
    EXPECT_THAT(told(R"({"command":"teach"})")["cure"].get<std::string>(), HasSubstr("hordctl teach"));
    EXPECT_THAT(told(R"({"command":"commit_recipe"})")["cure"].get<std::string>(), HasSubstr("the PLC's"));
    EXPECT_EQ(told(R"({"command":"jump"})")["error"], "there is no such command");
    EXPECT_THAT(
        told(R"({"command":"jump"})")["cure"].get<std::string>(),
        HasSubstr("use one of initialise, arm, disarm, start_single, start_continuous, stop, abort, halt, reset"));
    EXPECT_THAT(told(R"({"command":"use_recipe","argument":-1})")["error"].get<std::string>(),
                HasSubstr("no whole number of 0 to 4294967295"));
    EXPECT_EQ(told(R"({"command":"use_recipe"})")["error"], "use_recipe needs the recipe's number");
}

TEST(PageRequests, a_command_with_a_repeated_or_unknown_member_is_refused) {
    SmallPage page;
    for (const char* body : {R"({"command":"stop","command":"halt"})", R"({"command":"stop","at":1})",
                             R"({"command":"stop","argument":{"command":1}})"}) {
        const auto reply = page.reply_to(page.command(body));
        EXPECT_EQ(reply.status, 400) << body;
        EXPECT_EQ(Json::parse(reply.body)["error"], "that is no command") << body;
    }
}

TEST(PageRequests, for_the_csv_of_no_store_gives_its_head_alone) {
    SmallPage page;
    std::filesystem::remove_all(page.folder.path());
    const auto reply = page.get("/api/results.csv");
    EXPECT_EQ(reply.status, 200);
    EXPECT_EQ(std::count(reply.body.begin(), reply.body.end(), '\n'), 1) << reply.body;
}

TEST(PageRequests, two_on_one_connection_are_answered_one_after_the_other) {
    SmallPage page;
    const std::string one = "GET /api/state HTTP/1.1\r\nHost: localhost\r\n\r\n";
    const std::string answer = answer_bytes(page.pages, page.viewers, one + one);
    EXPECT_NE(answer.find("HTTP/1.1 200 OK"), answer.rfind("HTTP/1.1 200 OK"));
}

TEST(PageRequests, a_path_leads_nowhere_but_to_what_there_is) {
    SmallPage page;
    store::test::write_text(page.folder.path() / "secret.png", "secret");
    for (const char* path :
         {"/../../../../etc/passwd", "/..%2f..%2fetc/passwd", "/%2e%2e/%2e%2e/etc/passwd",
          "/parts/../secret.png/frame.png", "/parts/..%2F..%2Fsecret/frame.png", "/parts/10/../../secret.png",
          "/parts/10/frame.png%00.txt", "/parts/10%00/frame.png", "/page.css%00", "/parts/%2e%2e/frame.png",
          "/parts//frame.png", "/parts/10/", "//etc/passwd", "/parts/10/frame.png/", "/site/page.js",
          "/parts/-1/record.json", "/parts/00000007-110%0d%0aX-Evil:1/frame.png", "/%ff%fe", "/api/../metrics/.."}) {
        const std::string answer = ask(page, std::string("GET ") + path);
        EXPECT_THAT(status(answer), ::testing::AnyOf(StartsWith("HTTP/1.1 400"), StartsWith("HTTP/1.1 404"))) << path;
        EXPECT_THAT(answer, Not(HasSubstr("secret"))) << path;
        EXPECT_THAT(answer, Not(HasSubstr("root:"))) << path;
        EXPECT_THAT(answer, Not(HasSubstr("\r\nX-Evil"))) << path;
    }
}

TEST(PageRequests, only_by_its_own_names) {
    SmallPage page;
    const auto called = [&](const std::string& host) {
        return status(answer_bytes(page.pages, page.viewers, "GET /api/state HTTP/1.1\r\n" + host + "\r\n"));
    };
    for (const char* good :
         {"Host: localhost:8070\r\n", "Host: 127.0.0.1\r\n", "Host: [::1]:8070\r\n", "Host: WALL.example:80\r\n"})
        EXPECT_EQ(called(good), "HTTP/1.1 200 OK") << good;
    for (const char* bad :
         {"Host: evil.example\r\n", "Host: localhost.evil.example\r\n", "Host: \r\n", "Host: [::1].evil\r\n",
          "Host: 127.0.0.1:x@evil\r\n", "Host: 127.0.0.1:8070@evil\r\n", "Host: localhost:8070:1\r\n", "Host: [::1\r\n",
          "Host: [::1]8070\r\n", "Host: evil@localhost\r\n", "Host: localhost/evil\r\n"})
        EXPECT_THAT(called(bad), StartsWith("HTTP/1.1 421")) << bad;
    EXPECT_THAT(called(""), StartsWith("HTTP/1.1 400"));
    EXPECT_THAT(called("Host: localhost\r\nHost: evil.example\r\n"), StartsWith("HTTP/1.1 400"));
}

TEST(PageRequests, too_much_or_too_strange_is_refused) {
    SmallPage page;
    EXPECT_THAT(ask(page, "GET /" + std::string(9000, 'a')), StartsWith("HTTP/1.1 431"));
    EXPECT_THAT(ask(page, "GET /", "X: " + std::string(9000, 'a') + "\r\n"), StartsWith("HTTP/1.1 431"));
    EXPECT_THAT(answer_bytes(page.pages, page.viewers, std::string(100'000, 'a')), StartsWith("HTTP/1.1 4"));
    EXPECT_THAT(ask(page, "GET /", "A\r\n"), StartsWith("HTTP/1.1 400"));
    // A folded line is refused or part of the value before it (RFC 9112); never a header of its own.
    EXPECT_THAT(status(ask(page, "GET /", "A: b\r\n Host: evil\r\n")),
                ::testing::AnyOf("HTTP/1.1 200 OK", StartsWith("HTTP/1.1 400")));
    EXPECT_THAT(ask(page, "GET /", "A: \x01\r\n"), StartsWith("HTTP/1.1 400"));
    EXPECT_THAT(ask(page, "GET /", "Content-Length: 1\r\nContent-Length: 2\r\n"), StartsWith("HTTP/1.1 400"));
    EXPECT_THAT(ask(page, "DELETE /"), StartsWith("HTTP/1.1 405"));
    EXPECT_THAT(ask(page, "POST /"), StartsWith("HTTP/1.1 405"));
    EXPECT_EQ(answer_bytes(page.pages, page.viewers, "GET / HTTP/1.1\r\nHost: loc"), "");  // an incomplete request
    EXPECT_EQ(answer_bytes(page.pages, page.viewers, ""), "");
    // Thousands of ranges ask for the same bytes: they are answered once.
    const std::string ranges = ask(
        page, "GET /page.js",
        "Range: bytes=0-1" +
            [] {
                std::string s;
                for (int k = 0; k < 1500; ++k) s += ",0-9";
                return s;
            }() +
            "\r\n");
    EXPECT_EQ(status(ranges), "HTTP/1.1 200 OK");
}

TEST(PageRequests, a_malformed_one_is_answered_once_at_most) {
    SmallPage page;
    for (const char* line : {"GARBAGE", "GET", "GET  HTTP/1.1", "\x16\x03\x01", "GET / HTTP/9.9", ": HTTP/1.1"}) {
        std::string bytes = line;
        for (int k = 0; k < 50; ++k) bytes += "\r\nHost: localhost";
        const std::string answer = answer_bytes(page.pages, page.viewers, bytes + "\r\n\r\n");
        EXPECT_THAT(answer, Not(StartsWith("HTTP/1.1 2"))) << line;
        EXPECT_EQ(answer.find("HTTP/1."), answer.rfind("HTTP/1.")) << line << answer;
    }
}

TEST(PageCommands, that_are_refused_without_end_are_counted_and_hardly_logged) {
    SmallPage page;
    for (int k = 0; k < 1000; ++k) EXPECT_EQ(page.reply_to(page.command("{}", "wrong")).status, 401);
    EXPECT_EQ(page.log.size(), 5U);
    EXPECT_THAT(page.get("/metrics").body, HasSubstr("hord_page_commands_total{outcome=\"refused\"} 1000\n"));
}

TEST(PageCommands, need_a_token_and_are_recorded_with_its_owner) {
    SmallPage page;
    EXPECT_EQ(page.reply_to(page.command(R"({"command":"stop"})")).status, 200);
    ASSERT_EQ(page.commands.size(), 1U);
    EXPECT_EQ(page.commands[0].code, Command::stop);
    EXPECT_EQ(page.commands[0].who, "anna");
    EXPECT_THAT(page.log.back(), HasSubstr("stop for anna from 127.0.0.1"));
    for (const char* token : {"", "0123456789abcdef0123456", "wrong-wrong-wrong-wrong-wrong"})
        EXPECT_EQ(page.reply_to(page.command(R"({"command":"stop"})", token)).status, 401);
    Request bare = page.command(R"({"command":"stop"})");
    bare.authorization = kToken;
    EXPECT_EQ(page.reply_to(bare).status, 401);
    EXPECT_EQ(page.commands.size(), 1U);
    for (const std::string& line : page.log) EXPECT_THAT(line, Not(HasSubstr(kToken)));
    EXPECT_THAT(page.get("/metrics").body, HasSubstr("hord_page_commands_total{outcome=\"refused\"} 4\n"));
}

TEST(PageCommands, without_tokens_nobody_commands) {
    SmallPage page("");
    const Reply reply = page.reply_to(page.command(R"({"command":"stop"})"));
    EXPECT_EQ(reply.status, 403);
    EXPECT_THAT(reply.body, HasSubstr("page.toml"));
    EXPECT_TRUE(page.commands.empty());
    EXPECT_EQ(Json::parse(page.get("/api/page").body)["actions"], false);
}

TEST(PageCommands, are_not_taken_from_another_site_or_in_another_form) {
    SmallPage page;
    const auto with = [&](auto change) {
        Request request = page.command(R"({"command":"stop"})");
        change(request);
        return page.reply_to(request).status;
    };
    EXPECT_EQ(with([](Request& r) { r.origin = "http://evil.example"; }), 403);
    EXPECT_EQ(with([](Request& r) { r.origin = "null"; }), 403);
    EXPECT_EQ(with([](Request& r) { r.origin = "http://127.0.0.1:9999"; }), 403);
    EXPECT_EQ(with([](Request& r) { r.fetch_site = "cross-site"; }), 403);
    EXPECT_EQ(with([](Request& r) { r.fetch_site = "same-site"; }), 403);
    EXPECT_EQ(with([](Request& r) { r.content_type = "text/plain"; }), 415);
    EXPECT_EQ(with([](Request& r) { r.content_type = "multipart/form-data; boundary=x"; }), 415);
    EXPECT_EQ(with([](Request& r) { r.host = "evil.example"; }), 421);
    EXPECT_EQ(with([](Request& r) { r.method = "GET"; }), 404);
    for (const char* body :
         {"", "stop", "[]", "{}", R"({"command":5})", R"({"command":"explode"})", R"({"command":"commit_recipe"})",
          R"({"command":"teach"})", R"({"command":"use_recipe"})", R"({"command":"use_recipe","argument":-1})",
          R"({"command":"use_recipe","argument":4294967296})", R"({"command":"use_recipe","argument":"7"})",
          "{\"command\":\"st\xff\"}"}) {
        EXPECT_EQ(with([&](Request& r) { r.body = body; }), 400) << body;
    }
    EXPECT_TRUE(page.commands.empty());
    EXPECT_EQ(with([](Request& r) {
                  r.origin.clear();
                  r.fetch_site = "same-origin";
              }),
              200);
}

TEST(PageCommands, a_body_that_is_too_large_packed_or_chunked_is_not_read) {
    SmallPage page;
    const std::string head = "Authorization: Bearer " + std::string(kToken) + "\r\nContent-Type: application/json\r\n";
    const std::string body = R"({"command":"stop"})";
    const auto send = [&](const std::string& more, const std::string& what) {
        return answer_bytes(page.pages, page.viewers,
                            "POST /api/command HTTP/1.1\r\nHost: localhost\r\n" + head + more + "\r\n" + what);
    };
    EXPECT_THAT(send("Content-Length: 5000\r\n", std::string(5000, ' ')), StartsWith("HTTP/1.1 413"));
    EXPECT_THAT(send("Content-Length: 99999999999999\r\n", body), Not(StartsWith("HTTP/1.1 200")));
    EXPECT_THAT(send("Transfer-Encoding: chunked\r\n", "12\r\n" + body + "\r\n0\r\n\r\n"), StartsWith("HTTP/1.1 415"));
    EXPECT_THAT(send("Content-Encoding: br\r\nContent-Length: 18\r\n", body), StartsWith("HTTP/1.1 415"));
    EXPECT_TRUE(page.commands.empty());
    EXPECT_THAT(send("Content-Length: 18\r\n", body), StartsWith("HTTP/1.1 200"));
    EXPECT_EQ(page.commands.size(), 1U);
    // Bytes after a request with a body are never parsed as another request.
    const std::string hidden =
        "POST /api/command HTTP/1.1\r\nHost: localhost\r\n" + head + "Content-Length: 18\r\n\r\n" + body;
    answer_bytes(page.pages, page.viewers,
                 "GET /api/state HTTP/1.1\r\nHost: localhost\r\nContent-Length: " + std::to_string(hidden.size()) +
                     "\r\n\r\n" + hidden);
    EXPECT_EQ(page.commands.size(), 1U);
}

TEST(PageCommands, what_the_station_refuses_is_told_with_its_cure) {
    SmallPage page;
    page.answer = {CommandState::failed, CommandError::device_down, 0, "device_down"};
    const Reply reply = page.reply_to(page.command(R"({"command":"arm"})"));
    EXPECT_EQ(reply.status, 409);
    EXPECT_THAT(reply.body, HasSubstr("device_down"));
    EXPECT_THAT(reply.body, HasSubstr("see the active faults"));
}

TEST(PageCommands, a_reset_that_comes_too_early_is_told_that_the_line_stop_is_new) {
    SmallPage page;
    page.answer = {CommandState::failed, CommandError::not_yet, 0, "not_yet"};
    EXPECT_THAT(page.reply_to(page.command(R"({"command":"reset"})")).body,
                HasSubstr("a line stop is newer than 200 ms"));
}

TEST(PageCommands, a_refusal_by_the_state_names_the_next_command) {
    SmallPage page;
    page.live.set_station(example_snapshot());  // of the last poll: the refusal is newer
    page.answer = {CommandState::failed, CommandError::not_in_this_state, 0, "not_in_this_state", "", State::halted};
    const Json told = Json::parse(page.reply_to(page.command(R"({"command":"halt"})")).body);
    EXPECT_EQ(told["reason"], "not_in_this_state");
    EXPECT_EQ(told["cure"], "the station is Halted: next is reset; possible are also use_recipe");
    const Json state = Json::parse(page.get("/api/state").body);
    EXPECT_EQ(state["commands"], Json({"stop", "abort", "halt"})) << "the page refuses to send teach";
    EXPECT_TRUE(state["next"].is_null());
}

TEST(PageCommands, a_station_whose_device_is_down_is_not_offered_to_be_armed) {
    SmallPage page;
    const auto offered = [&](std::uint32_t faults) {
        page.live.set_station(example_snapshot(State::initialized, faults));
        return page.live.state_json();
    };
    EXPECT_EQ(offered(0)["commands"].dump(), R"(["arm","halt","reset","self_test","use_recipe"])");
    EXPECT_EQ(offered(kFaultSensor)["commands"].dump(), R"(["halt","reset","self_test","use_recipe"])");
    EXPECT_EQ(page.live.state_json()["next"], "arm") << "after the sensor is there";
    EXPECT_EQ(page.live.state_json()["devices_down"], "sensor");
}

TEST(PageState, numbers_are_written_as_short_as_they_can_be) {
    SmallPage page;
    page.live.set_station(example_snapshot());
    const std::string text = page.get("/api/state").body;
    EXPECT_FALSE(std::regex_search(text, std::regex(R"(\d\.\d{8})"))) << text;
    EXPECT_NE(text.find("\"staged_emd_limit\":0.7,"), std::string::npos) << text;
}

TEST(PageState, before_the_first_answer_of_the_station_it_says_that_it_waits) {
    SmallPage page;
    const Json state = page.live.state_json();
    EXPECT_EQ(state["up"], false);
    EXPECT_EQ(state["trouble"]["what"], "waiting for the station's first data");
    EXPECT_EQ(state["commands"], Json::array());
}

}  // namespace
}  // namespace hord::firmware::page::test
