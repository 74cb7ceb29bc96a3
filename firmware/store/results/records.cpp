#include "firmware/store/results/records.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace hord::firmware::store {
namespace {

Value integer(std::int64_t value) { return value; }
Value text(std::string_view value) { return std::string(value); }

// SQLite keeps no NaN and no negative zero: the hashed value must equal the value read back.
Value real(float value) { return std::isfinite(value) ? Value(static_cast<double>(value) + 0.0) : Value{}; }

}  // namespace

std::string_view name_of(ChangeRecord::What what) {
    constexpr std::string_view kNames[] = {"recipe", "configuration", "calibration", "lost", "command"};
    return kNames[static_cast<std::size_t>(what)];
}

Json parse_stored(const std::string& text) {
    constexpr int kDeepest = 16;
    bool deep = false;
    Json json = Json::parse(
        text,
        [&](int depth, Json::parse_event_t, const Json&) {
            deep = deep || depth > kDeepest;
            return depth <= kDeepest;
        },
        false);
    return deep ? Json(Json::value_t::discarded) : json;
}

std::optional<std::int64_t> integer_in(const Json& json, const char* name) {
    if (!json.is_object()) return std::nullopt;
    const auto found = json.find(name);
    if (found == json.end() || !found->is_number_integer()) return std::nullopt;
    const bool too_large = found->is_number_unsigned() &&
        found->get<std::uint64_t>() > static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
    return too_large ? std::nullopt : std::optional(found->get<std::int64_t>());
}

std::optional<std::string> text_in(const Json& json, const char* name) {
    if (!json.is_object()) return std::nullopt;
    const auto found = json.find(name);
    return found != json.end() && found->is_string() ? std::optional(found->get<std::string>()) : std::nullopt;
}

std::string to_line(const Json& json) {
    if (json.is_number_float()) return fmt::format("{}", static_cast<float>(json.get<double>()));
    if (!json.is_structured()) return to_text(json);
    std::string line;
    for (const auto& [key, value] : json.items())
        line += (line.empty() ? "" : ",") + (json.is_object() ? to_text(key) + ":" : "") + to_line(value);
    return json.is_object() ? "{" + line + "}" : "[" + line + "]";
}

Json to_json(std::span<const algo::Defect> defects) {
    Json list = Json::array();
    for (const algo::Defect& d : defects) {
        list.push_back({{"m", d.m}, {"n", d.n}, {"area", d.area}, {"peak", d.peak}, {"kind", algo::name_of(d.kind)}});
    }
    return list;
}

std::string to_json_line(const StartRecord& start) {
    return to_text({{"boot", start.boot}, {"software", start.software}});
}

std::vector<Value> values_of(const ResultRecord& record, const Value& recipe, const Value& calibration) {
    const PartResult& r = record.result;
    return {integer(r.sequence),
            integer(r.part),
            text(name_of(r.verdict)),
            text(name_of(r.reason)),
            real(r.score),
            integer(r.defects),
            to_line(to_json(std::span(record.defects).first(std::min(record.defects.size(), kDefectsKept)))),
            integer(r.latency_us),
            integer(r.reject_latency_us),
            text(name_of(r.reject)),
            recipe,
            calibration,
            integer(r.bounded ? 1 : 0)};
}

std::vector<Value> values_of(const ChangeRecord& record) {
    std::vector<Value> row{text(record.peer), integer(record.token), text(record.name), text(record.before),
                           text(record.after)};
    // The table of commands has no column `what`.
    if (record.what != ChangeRecord::What::command) row.insert(row.begin(), text(name_of(record.what)));
    return row;
}

std::vector<Value> values_of(const StartRecord& record, const std::string& before) {
    return {text("start"), text(""), integer(0), text(record.station), text(before), to_json_line(record)};
}

}  // namespace hord::firmware::store
