#include "firmware/store/results/export.h"

#include <charconv>
#include <chrono>
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

// A row's keys as the head of a CSV file.
std::string csv_head(const Json& row) {
    std::string line;
    for (const auto& [key, value] : row.items()) line += (line.empty() ? "" : ",") + key;
    return line;
}

std::string csv_line(const Json& row) {
    std::vector<std::string> fields;
    for (const auto& [key, value] : row.items()) {
        if (value.is_string()) fields.push_back(csv_field(value.get_ref<const std::string&>()));
        else fields.push_back(value.is_null() ? "" : to_line(value));
    }
    return fmt::format("{}", fmt::join(fields, ","));
}

// The kinds of defects that occur, each once.
std::string kinds_of(const Json& defects) {
    std::set<std::string> kinds;
    for (const auto& defect : defects) {
        if (const auto kind = text_in(defect, "kind")) kinds.insert(*kind);
    }
    return fmt::format("{}", fmt::join(kinds, " "));
}

// to_json() without nested values: of the defects the kinds that occur, and where the worst one is.
Json flat_row(const StoredResult& result) {
    Json row = to_json(result), flat;
    const Json& defects = row["defects"];
    const Json worst = defects.is_array() && !defects.empty() && defects[0].is_object() ? defects[0] : Json();
    for (const auto& [key, value] : row.items()) {
        if (key == "defect_count") flat["defects"] = value;
        else if (key != "defects") flat[key] = value;
        if (key != "defects") continue;
        flat["kinds"] = kinds_of(defects);
        flat["worst_m"] = worst.contains("m") ? worst["m"] : Json();
        flat["worst_n"] = worst.contains("n") ? worst["n"] : Json();
    }
    return flat;
}

constexpr char kResultTable[] = "{:>10}  {:<24} {:>8}  {:<7} {:<20} {:>8} {:>7}  {:<20} {:>10}  {:<10} {}";
constexpr std::size_t kWhoWidth = 36, kNameWidth = 24;
constexpr char kChangeTable[] = "{:<24} {:<13} {:<36} {:<24} {}";

// A longer value would move those behind it out of their columns. Its end tells files and senders apart; CSV and JSON
// have the whole.
std::string cell_of(const std::string& value, std::size_t width) {
    const auto begins = [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80; };
    auto chars = static_cast<std::size_t>(std::ranges::count_if(value, begins));
    if (chars <= width) return value;
    std::size_t from = 0;
    for (chars += 3; chars > width; --chars) {
        do ++from;
        while (from < value.size() && !begins(value[from]));
    }
    return "..." + value.substr(from);
}

std::string one_line(const std::string& text) {
    if (text.empty()) return "(none)";
    if (text.find('\n') == std::string::npos && text.size() <= 60) return text;
    return fmt::format("({} bytes)", text.size());
}

}  // namespace

UtcMicros utc_now() {
    using namespace std::chrono;
    return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
}

std::string format_utc(UtcMicros time_us) {
    using std::chrono::floor;
    // Years 0 to 9999; others were not written by a station.
    if (time_us < -62'167'219'200 * kSecondMicros || time_us >= 253'402'300'800 * kSecondMicros)
        return fmt::format("{} us", time_us);
    const std::chrono::sys_time<std::chrono::microseconds> time{std::chrono::microseconds(time_us)};
    const auto second = floor<std::chrono::seconds>(time);
    return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z",
                       fmt::gmtime(static_cast<std::time_t>(second.time_since_epoch().count())),
                       floor<std::chrono::milliseconds>(time - second).count());
}

Result<void> check_period(std::optional<UtcMicros> since, std::optional<UtcMicros> until) {
    if (!since || !until || *since < *until) return {};
    return fail(ErrorCode::invalid_argument,
                fmt::format("since ({}) is not before until ({}): no result is in between", format_utc(*since),
                            format_utc(*until)),
                "give the earlier time as since");
}

Result<UtcMicros> parse_utc(std::string_view text, UtcMicros now_us) {
    const auto bad = [given = text] {
        return fail(ErrorCode::invalid_argument, "\"" + std::string(given) + "\" is no time",
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
    // timegm() converts February 30th to March 2nd, and 24:00 to 0:00; such a time is refused.
    if (utc.tm_mon + 1 != wanted.tm_mon || utc.tm_hour != wanted.tm_hour || utc.tm_min != wanted.tm_min) return bad();
    return static_cast<UtcMicros>(time) * kSecondMicros;
}

std::string csv_head_of_results() { return csv_head(flat_row({})); }
std::string csv_head_of_changes() { return csv_head(to_json(StoredChange{})); }
std::string to_csv(const StoredResult& result) { return csv_line(flat_row(result)); }
std::string to_csv(const StoredChange& change) { return csv_line(to_json(change)); }

Json to_json(const StoredResult& r) {
    Json defects = parse_stored(r.defects);
    if (defects.is_discarded()) defects = r.defects;  // a row that was edited: hordctl verify reports it
    Json row{{"number", r.number},
             {"time", format_utc(r.time_us)},
             {"boot", r.boot},
             {"sequence", r.sequence},
             {"part", r.part},
             {"verdict", r.verdict},
             {"reason", r.reason},
             {"score", r.score ? Json(static_cast<float>(*r.score)) : Json()},
             {"bounded", r.bounded ? Json(*r.bounded) : Json()},
             {"defect_count", r.defect_count},
             {"defects", std::move(defects)},
             {"latency_us", r.latency_us},
             {"reject", r.reject},
             {"reject_latency_us", r.reject_latency_us},
             {"recipe", r.recipe},
             {"recipe_change", r.recipe_change},
             {"calibration", r.calibration},
             {"software", r.software}};
    if (!r.damage.empty()) row["damage"] = r.damage;
    return row;
}

Json to_json(const StoredChange& c) {
    Json row{{"number", c.number}, {"time", format_utc(c.time_us)},
             {"run", c.run},       {"what", c.what},
             {"peer", c.peer},     {"token", c.token},
             {"name", c.name},     {"before", c.before},
             {"after", c.after}};
    if (!c.damage.empty()) row["damage"] = c.damage;
    return row;
}

std::string table_head_of_results() {
    return fmt::format(kResultTable, "number", "time (UTC)", "part", "verdict", "reason", "score", "defects", "kinds",
                       "latency ms", "reject", "recipe");
}

std::string table_head_of_changes() {
    return fmt::format(kChangeTable, "time (UTC)", "what", "who", "name", "before -> after");
}

std::string to_table(const StoredResult& r) {
    return fmt::format(kResultTable, r.number, format_utc(r.time_us), r.part, r.verdict, r.reason,
                       r.score ? fmt::format("{}{:.3f}", r.bounded.value_or(false) ? "<=" : "", *r.score) : "",
                       r.defect_count, kinds_of(parse_stored(r.defects)),
                       fmt::format("{:.1f}", static_cast<double>(r.latency_us) / 1000.0), r.reject, r.recipe);
}

std::string describe_removal(const std::string& after) {
    const Json json = parse_stored(after);
    const auto from = integer_in(json, "from"), to = integer_in(json, "to");
    if (!from || !to) return after;
    const auto number = [&](const char* name) { return integer_in(json, name).value_or(0); };
    const auto text = [&](const char* name) { return text_in(json, name).value_or("?"); };
    std::string line = fmt::format("{} to {}", *from, *to);
    if (json.contains("first_time")) line += fmt::format(" ({} to {})", text("first_time"), text("last_time"));
    const std::string rule = text("rule");
    if (rule == "keep_days") {
        return line +
            fmt::format(
                   " removed: {} days old and more (keep_days {}), by the days that the clock has shown "
                   "since {}",
                   number("age_days"), number("limit"), text("witnessed"));
    }
    if (rule == "keep_mb") {
        constexpr std::int64_t kMegabyte = 1'000'000;
        return line +
            fmt::format(" removed: the store had {} MB (keep_mb {})", number("used_bytes") / kMegabyte,
                        number("limit_bytes") / kMegabyte);
    }
    return line + " removed";  // older software entered no reason
}

std::string to_table(const StoredChange& c) {
    const std::string who = c.peer.empty() ? "station" : c.token != 0 ? fmt::format("{} #{}", c.peer, c.token) : c.peer;
    const std::string change = c.what == "retention" ? describe_removal(c.after)
        : c.before.empty() && c.after.empty()        ? "no file: every key has its default"
                                                     : one_line(c.before) + " -> " + one_line(c.after);
    return fmt::format(kChangeTable, format_utc(c.time_us), c.what, cell_of(who, kWhoWidth),
                       cell_of(c.name, kNameWidth), change);
}

}  // namespace hord::firmware::store
