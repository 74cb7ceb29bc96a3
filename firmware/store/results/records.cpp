#include "firmware/store/results/records.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace hord::firmware::store {
namespace {

Value integer(std::int64_t value) { return value; }
Value text(std::string_view value) { return std::string(value); }

// SQLite keeps no NaN and no negative zero: what is hashed must be what is read back.
Value real(float value) { return std::isfinite(value) ? Value(static_cast<double>(value) + 0.0) : Value{}; }

}  // namespace

std::string_view name_of(ChangeRecord::What what) {
    switch (what) {
        case ChangeRecord::What::recipe: return "recipe";
        case ChangeRecord::What::configuration: return "configuration";
        case ChangeRecord::What::calibration: return "calibration";
        case ChangeRecord::What::lost: return "lost";
    }
    return "unknown";
}

std::string to_json(const algo::Defect& d) {
    return fmt::format("{{\"m\":{},\"n\":{},\"area\":{},\"peak\":{},\"kind\":\"{}\"}}", d.m, d.n, d.area, d.peak,
                       algo::name_of(d.kind));
}

std::string to_json(std::span<const algo::Defect> defects) {
    std::string json = "[";
    for (const algo::Defect& d : defects.first(std::min(defects.size(), kDefectsKept))) {
        if (json.size() > 1) json += ',';
        json += to_json(d);
    }
    return json + "]";
}

std::string json_escaped(std::string_view text) {
    std::string escaped;
    for (const char c : text) {
        if (c == '"' || c == '\\') {
            escaped += '\\';
            escaped += c;
        } else if (c == '\n') {
            escaped += "\\n";
        } else if (static_cast<unsigned char>(c) < 0x20) {
            escaped += fmt::format("\\u{:04x}", static_cast<unsigned>(static_cast<unsigned char>(c)));
        } else {
            escaped += c;
        }
    }
    return escaped;
}

std::string to_json(const StartRecord& start) {
    return fmt::format("{{\"boot\":{},\"software\":\"{}\"}}", start.boot, json_escaped(start.software));
}

std::vector<Value> values_of(const ResultRecord& record, const Value& recipe, const Value& calibration) {
    const PartResult& r = record.result;
    return {integer(r.sequence),
            integer(r.part),
            text(name_of(r.verdict)),
            text(name_of(r.reason)),
            real(r.score),
            integer(r.defects),
            to_json(record.defects),
            integer(r.latency_us),
            integer(r.reject_latency_us),
            text(name_of(r.reject)),
            recipe,
            calibration};
}

std::vector<Value> values_of(const CommandRecord& record) {
    return {text(record.peer), integer(record.token), text(record.name), text(record.before), text(record.after)};
}

std::vector<Value> values_of(const ChangeRecord& record) {
    return {text(name_of(record.what)), text(record.peer),   integer(record.token),
            text(record.name),          text(record.before), text(record.after)};
}

std::vector<Value> values_of(const StartRecord& record, const std::string& before) {
    return {text("start"), text(""), integer(0), text(record.station), text(before), to_json(record)};
}

}  // namespace hord::firmware::store
