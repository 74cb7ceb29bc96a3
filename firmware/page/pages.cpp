#include "firmware/page/pages.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <chrono>
#include <span>
#include <utility>

#include <fmt/format.h>

#include "firmware/core/enum_values.h"
#include "firmware/page/reference_report.h"
#include "firmware/page/site.h"
#include "firmware/store/results/export.h"

namespace hord::firmware::page {
namespace {

using store::Json;
using store::to_text;

constexpr const char* kNoStore =
    "No results are stored yet. They appear here when the station runs with a store that this page may read.";
constexpr const char* kNoRecipe = "No recipe is stored yet. It appears here when the station has run with its store.";
constexpr auto kFrameTimeout = std::chrono::seconds(5);

// An answer of the store. A store that does not exist yet is no fault of the client: it is told, with no rows.
Reply of_store(const Result<Json>& found, const char* about) {
    if (found) return {.body = store::to_line(*found)};
    if (found.error().code != ErrorCode::not_found) return refusal(found.error());
    return {.body = to_text({{"rows", Json::array()}, {"more", false}, {"note", about}})};
}

Reply json_text(std::string text) { return {.body = std::move(text)}; }
Reply json(const Result<Json>& json) { return json ? json_text(to_text(*json)) : refusal(json.error()); }
Reply file(std::string_view type, std::string body) { return {.type = std::string(type), .body = std::move(body)}; }

std::string bytes(const std::vector<std::uint8_t>& from) { return {from.begin(), from.end()}; }

std::string field(const Fields& fields, const std::string& name) {
    const auto at = fields.find(name);
    return at == fields.end() ? std::string() : at->second;
}

// The names in the query that an address understands. Others are refused: ignoring one would show something else.
std::span<const std::string_view> query_of(std::string_view path) {
    static constexpr std::string_view kSpan[] = {"span"}, kMap[] = {"map"};
    if (path == "/api/results" || path == "/api/results.csv") return kFilters;
    if (path == "/api/history" || path == "/api/scores" || path == "/api/counts") return kSpan;
    if (path.starts_with("/parts/")) return kMap;
    return {};
}

// Only what is asked of the station; a page's address may carry what other programs add.
std::optional<Reply> refuse_unknown_query(const Request& request) {
    if (!request.path.starts_with("/api/") && !request.path.starts_with("/parts/")) return std::nullopt;
    const auto known = query_of(request.path);
    for (const auto& [name, value] : request.query) {
        if (std::ranges::find(known, name) != known.end()) continue;
        return refusal(400, fmt::format("{} has no \"{}\"", request.path.substr(0, 40), name.substr(0, 40)),
                       known.empty() ? std::string("leave it out") : fmt::format("use {}", fmt::join(known, ", ")));
    }
    return std::nullopt;
}

// Whether `span` asks for the longer of two spans; without it, the shorter one.
Result<bool> longer_span(const Fields& fields, const char* shorter, const char* longer) {
    const std::string span = field(fields, "span");
    if (!span.empty() && span != shorter && span != longer)
        return fail(ErrorCode::invalid_argument, "there is no such span",
                    fmt::format("ask for {} or {}", shorter, longer));
    return span == longer;
}

// "localhost:8070", "[::1]:8070" without its port, in lower case. Empty: no host with or without a port (RFC 3986),
// such as "[::1].evil" or "127.0.0.1:x@evil".
std::string host_alone(std::string_view host) {
    const bool bracketed = host.starts_with('[');
    const auto end = std::min(bracketed ? host.find(']') : host.find(':'), host.size());
    const auto name = host.substr(0, end + (bracketed && end < host.size() ? 1 : 0));
    const auto port = host.substr(name.size());
    const auto allowed = [&](unsigned char c) {
        return std::isalnum(c) != 0 || c == '.' || c == '-' || c == '_' ||
            (bracketed && (c == ':' || c == '[' || c == ']'));
    };
    const auto digit = [](char c) { return c >= '0' && c <= '9'; };
    if (!std::ranges::all_of(name, allowed)) return {};
    if (!port.empty() && (port[0] != ':' || !std::ranges::all_of(port.substr(1), digit))) return {};
    return lower(name);
}

}  // namespace

const std::vector<std::pair<std::string, std::string>>& headers_of_every_reply() {
    static const std::vector<std::pair<std::string, std::string>> kHeaders{
        {"Content-Security-Policy",
         "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; base-uri "
         "'none'; form-action 'none'; frame-ancestors 'none'"},
        {"X-Content-Type-Options", "nosniff"},
        {"X-Frame-Options", "DENY"},
        {"Referrer-Policy", "no-referrer"},
        {"Cross-Origin-Resource-Policy", "same-origin"},
        {"Cross-Origin-Opener-Policy", "same-origin"},
        {"Permissions-Policy", "camera=(), microphone=(), geolocation=()"},
        {"Cache-Control", "no-store"},
    };
    return kHeaders;
}

bool Pages::may_be_called(std::string_view given) const {
    const std::string host = host_alone(given);
    if (host.empty()) return false;
    if (host == "localhost" || host == "127.0.0.1" || host == "[::1]" || host == host_alone(deps_.config.host))
        return true;
    return std::find(deps_.config.names.begin(), deps_.config.names.end(), host) != deps_.config.names.end();
}

Reply Pages::answer(const Request& request) {
    Reply reply = reply_to(request);
    const std::lock_guard lock(mutex_);
    ++replies_[reply.status];
    return reply;
}

bool Pages::is_in_memory(const Request& request) {
    constexpr std::string_view kSlow[] = {"/parts/",     "/api/results", "/api/counts",
                                          "/api/scores", "/api/recipe",  "/api/reference",
                                          "/reference/", "/api/changes", "/api/command"};
    return std::ranges::none_of(kSlow, [&](std::string_view path) { return request.path.starts_with(path); });
}

Reply Pages::reply_to(const Request& request) {
    if (!may_be_called(request.host)) {
        return refusal(421, "this page is not called \"" + request.host.substr(0, 80) + "\"",
                       "add the name to page.names in page.toml, or use the address that it listens at");
    }
    if (request.path.find('\0') != std::string::npos || request.path.empty() || request.path[0] != '/')
        return refusal(400, "that is no address of this page", "begin at /");
    if (request.method == "POST" && request.path == "/api/command") return commands_.execute(request);
    if (request.method == "GET" || request.method == "HEAD") return get(request);
    Reply reply = refusal(405, "this page only answers GET", "commands are sent to /api/command with POST");
    reply.headers.emplace_back("Allow", request.path == "/api/command" ? "POST" : "GET, HEAD");
    return reply;
}

Reply Pages::get(const Request& request) {
    std::string_view path = request.path;
    if (deps_.wall != nullptr && (path == "/" || path == "/index.html")) path = "/wall.html";
    for (const EmbeddedFile& known : site_files()) {
        if (path == known.path || (path == "/" && known.path == "/index.html"))
            return file(known.type, std::string(known.text));
    }
    if (deps_.wall != nullptr) {
        return path == "/api/stations"
            ? json(deps_.wall->json())
            : refusal(404, "a wall of stations has nothing at this address", "ask the station's own page");
    }
    if (path == "/metrics") return metrics();
    if (auto refused = refuse_unknown_query(request)) return std::move(*refused);
    if (path == "/api/page") {
        Json page = deps_.live.page_json();
        page["actions"] = !deps_.tokens.empty();
        page["version"] = deps_.version;
        page["shifts"] = deps_.config.shifts;
        page["kinds"] = page["reasons"] = Json::array();  // for the search
        for (const algo::DefectKind kind : kDefectKinds) page["kinds"].push_back(algo::name_of(kind));
        for (const PartReason reason : kValuesOf<PartReason>) {
            if (reason != PartReason::none) page["reasons"].push_back(name_of(reason));
        }
        return json(page);
    }
    if (path == "/api/state") return json(deps_.live.state_json());
    if (path == "/api/events") {
        Reply reply = file("text/event-stream", "retry: 1000\n\n");
        reply.events = true;
        return reply;
    }
    if (path == "/api/history") {
        const auto day = longer_span(request.query, "15m", "24h");
        return day ? json_text(deps_.live.history_json(*day)) : refusal(day.error());
    }
    if (path == "/api/scores") {
        const auto day = longer_span(request.query, "15m", "24h");
        return day ? of_store(deps_.results.scores(*day), kNoStore) : refusal(day.error());
    }
    if (path == "/api/results") {
        return of_store(deps_.results.search(request.query), kNoStore);
    }
    if (path == "/api/results.csv") {
        auto text = deps_.results.csv(request.query);
        if (!text && text.error().code == ErrorCode::not_found) text = store::csv_head_of_results() + "\r\n";
        if (!text) return refusal(text.error());
        Reply reply = file("text/csv; charset=utf-8", std::move(*text));
        reply.headers.emplace_back("Content-Disposition", "attachment; filename=\"results.csv\"");
        return reply;
    }
    if (path == "/api/counts") {
        const auto week = longer_span(request.query, "24h", "7d");
        return week ? of_store(deps_.results.counts(*week), kNoStore) : refusal(week.error());
    }
    if (path == "/api/recipe") return of_store(deps_.results.recipe_in_use(), kNoRecipe);
    if (path == "/api/reference") {
        const auto recipe = deps_.results.recipe_in_use();
        return of_store(recipe ? Result<Json>(reference_json(*recipe)) : recipe, kNoRecipe);
    }
    constexpr std::string_view kReference = "/reference/";
    if (path.starts_with(kReference)) return reference_picture_named(path.substr(kReference.size()));
    if (path == "/api/changes") return of_store(deps_.results.changes(30), kNoStore);
    constexpr std::string_view kParts = "/parts/";
    if (path.starts_with(kParts)) {
        const std::string_view rest = path.substr(kParts.size());
        const auto slash = rest.find('/');
        if (slash != std::string_view::npos) return part(request, rest.substr(0, slash), rest.substr(slash + 1));
    }
    return refusal(404, "there is nothing at this address", "begin at /");
}

// "0A1B2C3D.png": the address changes with the picture, so that no browser shows an older one.
Reply Pages::reference_picture_named(std::string_view name) {
    std::uint32_t crc32 = 0;
    const auto read = std::from_chars(name.data(), name.data() + name.size(), crc32, 16);
    if (read.ec != std::errc() || name != fmt::format("{:08X}.png", crc32))
        return refusal(404, "the reference has no such picture", "ask /api/reference for its picture's checksum");
    const auto recipe = deps_.results.recipe_in_use();
    if (!recipe) return refusal(recipe.error());
    auto picture = reference_picture(*recipe, crc32);
    return picture ? file("image/png", std::move(*picture)) : refusal(picture.error());
}

Reply Pages::part(const Request& request, std::string_view name, std::string_view what) {
    const auto key = parse_part_key(name);
    if (!key)
        return refusal(400, "that is no part",
                       "write a result's number, or the station's start and the part's number: 4711, 0a1b2c3d-42");
    constexpr std::string_view kFiles[] = {"record.json", "record.tar", "frame.png",
                                           "map.png",     "found.json", "part.json"};
    if (std::ranges::find(kFiles, what) == std::end(kFiles))
        return refusal(404, "a part has no such file",
                       "ask for part.json, record.json, record.tar, frame.png, map.png or found.json");
    if (what == "part.json") return part_for_people(*key, field(request.query, "map"));
    PartKey named = *key;
    std::optional<store::StoredResult> row;
    if (what.starts_with("record") || named.number) {
        auto found = deps_.results.one(*key);
        if (!found) return refusal(found.error());
        row = std::move(*found);
        named.boot = row->boot;
        named.part = row->part;
    }
    const std::string base = fmt::format("part-{:08x}-{}", named.boot, named.part);
    const auto download = [&](Reply reply, const std::string& as) {
        reply.headers.emplace_back("Content-Disposition", "attachment; filename=\"" + as + "\"");
        return reply;
    };
    const std::unique_lock turn(frame_mutex_, kFrameTimeout);
    if (!turn) return refusal(503, "others are looking at parts", "try again in a moment");
    auto kept = deps_.frames.find(named.boot, named.part);
    if (what.starts_with("record")) {
        // The row, the frame's metadata with the whole recipe, or the reason why there is no frame.
        Json record{{"result", Json::parse(store::to_line(store::to_json(*row)))}};
        record["boot"] = fmt::format("{:08x}", named.boot);
        if (kept) {
            record["frame"] = kept->name;
            record["frame_metadata"] = Json::parse(kept->frame.metadata, nullptr, false);
        } else {
            record["no_frame"] = kept.error().message();
        }
        const std::string text = to_text(record, 2) + "\n";
        if (what == "record.json") return download(file("application/json", text), base + ".json");
        const std::int64_t time_s = row->time_us / 1'000'000;
        Reply tar = file("application/x-tar",
                         tar_header(base + "/record.json", text.size(), time_s) + text + tar_padding(text.size()));
        if (kept) {
            tar.body += tar_header(base + "/frame.png", kept->file_size, time_s);
            tar.file = {std::move(kept->file), kept->file_size};
            tar.tail = tar_padding(kept->file_size);
        }
        tar.tail.append(2 * kTarBlock, '\0');
        return download(std::move(tar), base + ".tar");
    }
    if (!kept) return refusal(kept.error());
    if (what == "frame.png") {
        Reply png = file("image/png", "");
        png.file = {std::move(kept->file), kept->file_size};
        return download(std::move(png), base + ".png");
    }
    const auto drawn = deps_.pictures.draw(*kept, field(request.query, "map"));
    if (!drawn) return refusal(drawn.error());
    if (what == "found.json") return json_text((*drawn)->found);
    return file("image/png", bytes((*drawn)->png));
}

// What the page shows of a part: its result and its picture, or why there is none of them. Both may be missing, and
// that is no error.
Reply Pages::part_for_people(PartKey key, const std::string& map) {
    Json shown = Json::object();
    const auto row = deps_.results.one(key);
    if (row) {
        shown["result"] = Json::parse(store::to_line(store::to_json(*row)));
        key.boot = row->boot;
        key.part = row->part;
    } else if (row.error().code != ErrorCode::not_found) {
        return refusal(row.error());
    } else {
        shown["no_result"] = "Its result is not stored yet, or was removed because of its age.";
        if (key.number) return json(shown);
    }
    shown["key"] = fmt::format("{:08x}-{}", key.boot, key.part);
    const std::unique_lock turn(frame_mutex_, kFrameTimeout);
    if (!turn) return refusal(503, "others are looking at parts", "try again in a moment");
    const auto kept = deps_.frames.find(key.boot, key.part);
    const auto drawn =
        kept ? deps_.pictures.draw(*kept, map) : Result<std::shared_ptr<const DrawnPart>>(tl::unexpected(kept.error()));
    if (!drawn && kept && !map.empty() && deps_.pictures.draw(*kept, "")) return refusal(drawn.error());  // the name
    if (drawn) shown["found"] = Json::parse((*drawn)->found);
    else shown["no_frame"] = drawn.error().message();
    return json(shown);
}

Reply Pages::metrics() {
    PageFigures figures;
    figures.version = deps_.version;
    figures.viewers = deps_.viewers.count();
    figures.turned_away = turned_away_;
    figures.commands = commands_.counts();
    {
        const std::lock_guard lock(mutex_);
        figures.replies = replies_;
    }
    return file("text/plain; version=0.0.4; charset=utf-8", metrics_text(deps_.live.figures(), figures));
}

}  // namespace hord::firmware::page
