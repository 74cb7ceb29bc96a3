#include "firmware/store/results/export.h"

#include <charconv>
#include <cstdio>
#include <ctime>
#include <set>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "firmware/store/results/records.h"

namespace hord::firmware::store {
namespace {

constexpr UtcMicros kSecondMicros = 1'000'000;

std::string csv_field(std::string_view text) {
    if (text.find_first_of(",\"\r\n") == std::string_view::npos) return std::string(text);
    std::string quoted = "\"";
    for (const char c : text) {
        if (c == '"') quoted += '"';
        quoted += c;
    }
    return quoted + '"';
}

// As the float that it was: 0.321..., not the digits of its double.
std::string score_text(const std::optional<double>& score) {
    return score ? fmt::format("{}", static_cast<float>(*score)) : std::string();
}

// What a table of results shows of the defects: the kinds that occur, and where the worst one is.
struct DefectSummary {
    std::string kinds, m, n;
};
DefectSummary summary_of(const std::string& defects) {
    DefectSummary summary;
    const Json list = Json::parse(defects, nullptr, false);
    if (!list.is_array()) return summary;
    std::set<std::string> kinds;
    for (const auto& defect : list) {
        if (!defect.is_object()) continue;
        if (summary.m.empty()) {
            summary.m = fmt::format("{}", defect.value("m", 0.0F));
            summary.n = fmt::format("{}", defect.value("n", 0.0F));
        }
        kinds.insert(defect.value("kind", std::string()));
    }
    for (const std::string& kind : kinds) summary.kinds += (summary.kinds.empty() ? "" : " ") + kind;
    return summary;
}

std::string one_line(const std::string& text) {
    if (text.find('\n') == std::string::npos && text.size() <= 60) return text;
    return fmt::format("({} bytes)", text.size());
}

}  // namespace

std::string format_utc(UtcMicros time_us) {
    UtcMicros seconds = time_us / kSecondMicros, micros = time_us % kSecondMicros;
    if (micros < 0) {
        micros += kSecondMicros;
        --seconds;
    }
    const auto time = static_cast<std::time_t>(seconds);
    std::tm utc{};
    gmtime_r(&time, &utc);
    return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", utc, micros / 1000);
}

Result<UtcMicros> parse_utc(std::string_view text, UtcMicros now_us) {
    const auto bad = [&] {
        return fail(ErrorCode::invalid_argument, "\"" + std::string(text) + "\" is no time",
                    "write 2026-11-21, 2026-11-21T07:15:30 (UTC), or how long ago: 30m, 12h, 7d");
    };
    std::int64_t count = 0;
    const auto read = std::from_chars(text.data(), text.data() + text.size(), count);
    if (read.ec == std::errc() && read.ptr + 1 == text.data() + text.size()) {
        const std::string_view units = "smhd";
        constexpr UtcMicros kUnit[] = {kSecondMicros, 60 * kSecondMicros, 3600 * kSecondMicros, 86'400 * kSecondMicros};
        const auto unit = units.find(*read.ptr);
        if (unit == std::string_view::npos || count < 0 || count > 1'000'000) return bad();
        return now_us - count * kUnit[unit];
    }
    if (text.ends_with('Z')) text.remove_suffix(1);
    std::tm utc{};
    int used = 0;
    const std::string copy(text);
    const int fields = std::sscanf(copy.c_str(), "%4d-%2d-%2d%nT%2d:%2d%n:%2d%n", &utc.tm_year, &utc.tm_mon,
                                   &utc.tm_mday, &used, &utc.tm_hour, &utc.tm_min, &used, &utc.tm_sec, &used);
    if ((fields != 3 && fields != 5 && fields != 6) || used != static_cast<int>(copy.size())) return bad();
    const std::tm wanted = utc;
    utc.tm_year -= 1900;
    utc.tm_mon -= 1;
    const std::time_t time = timegm(&utc);
    // timegm() takes February 30th for March 2nd; a person meant something else.
    if (utc.tm_mon + 1 != wanted.tm_mon || utc.tm_mday != wanted.tm_mday || utc.tm_hour != wanted.tm_hour ||
        utc.tm_min != wanted.tm_min)
        return bad();
    return static_cast<UtcMicros>(time) * kSecondMicros;
}

std::string csv_head_of_results() {
    return "number,time,boot,sequence,part,verdict,reason,score,defects,kinds,worst_m,worst_n,latency_us,reject,reject_"
           "latency_us,recipe,recipe_change,calibration,software";
}

std::string to_csv(const StoredResult& r) {
    const DefectSummary defects = summary_of(r.defects);
    return fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}", r.number, format_utc(r.time_us),
                       r.boot, r.sequence, r.part, r.verdict, r.reason, score_text(r.score), r.defect_count,
                       csv_field(defects.kinds), defects.m, defects.n, r.latency_us, r.reject, r.reject_latency_us,
                       csv_field(r.recipe), r.recipe_change, csv_field(r.calibration), csv_field(r.software));
}

Json to_json(const StoredResult& r) {
    Json defects = Json::parse(r.defects, nullptr, false);
    if (defects.is_discarded()) defects = r.defects;  // a row that was edited: hordctl verify reports it
    return {{"number", r.number},
            {"time", format_utc(r.time_us)},
            {"boot", r.boot},
            {"sequence", r.sequence},
            {"part", r.part},
            {"verdict", r.verdict},
            {"reason", r.reason},
            {"score", r.score ? Json(static_cast<float>(*r.score)) : Json()},
            {"defect_count", r.defect_count},
            {"defects", std::move(defects)},
            {"latency_us", r.latency_us},
            {"reject", r.reject},
            {"reject_latency_us", r.reject_latency_us},
            {"recipe", r.recipe},
            {"recipe_change", r.recipe_change},
            {"calibration", r.calibration},
            {"software", r.software}};
}

std::string table_head_of_results() {
    return fmt::format("{:>10}  {:<24} {:>8}  {:<7} {:<20} {:>8} {:>7}  {:<20} {:>10}  {:<10} {}", "number",
                       "time (UTC)", "part", "verdict", "reason", "score", "defects", "kinds", "latency ms", "reject",
                       "recipe");
}

std::string to_table(const StoredResult& r) {
    return fmt::format("{:>10}  {:<24} {:>8}  {:<7} {:<20} {:>8} {:>7}  {:<20} {:>10.1f}  {:<10} {}", r.number,
                       format_utc(r.time_us), r.part, r.verdict, r.reason,
                       r.score ? fmt::format("{:.3f}", *r.score) : "", r.defect_count, summary_of(r.defects).kinds,
                       static_cast<double>(r.latency_us) / 1000.0, r.reject, r.recipe);
}

std::string csv_head_of_changes() { return "number,time,run,what,peer,token,name,before,after"; }

std::string to_csv(const StoredChange& c) {
    return fmt::format("{},{},{},{},{},{},{},{},{}", c.number, format_utc(c.time_us), c.run, c.what, csv_field(c.peer),
                       c.token, csv_field(c.name), csv_field(c.before), csv_field(c.after));
}

Json to_json(const StoredChange& c) {
    return {{"number", c.number}, {"time", format_utc(c.time_us)},
            {"run", c.run},       {"what", c.what},
            {"peer", c.peer},     {"token", c.token},
            {"name", c.name},     {"before", c.before},
            {"after", c.after}};
}

std::string table_head_of_changes() {
    return fmt::format("{:<24} {:<13} {:<24} {:<24} {}", "time (UTC)", "what", "who", "name", "before -> after");
}

std::string to_table(const StoredChange& c) {
    const std::string who = c.peer.empty() ? "station" : c.token != 0 ? fmt::format("{} #{}", c.peer, c.token) : c.peer;
    return fmt::format("{:<24} {:<13} {:<24} {:<24} {} -> {}", format_utc(c.time_us), c.what, who, c.name,
                       one_line(c.before), one_line(c.after));
}

}  // namespace hord::firmware::store
