#include "firmware/mqtt/metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace hord::firmware::mqtt {
namespace {

using store::StoredResult;

bool is_noise(const Register& row) {
    return row.name == "heartbeat" || row.name == "plc_heartbeat_age" || row.name == "age" || row.name == "uptime" ||
        row.name == "modbus_requests";
}

DataType type_of(const Register& row) {
    if (row.type == RegisterType::text) return DataType::text;
    const bool whole = row.scale == std::floor(row.scale);
    if (!whole) return DataType::real;
    return row.type == RegisterType::s16 || row.type == RegisterType::s32 ? DataType::int64 : DataType::uint64;
}

MetricValue value_of(const Register& row, const Reading& reading) {
    if (row.type == RegisterType::text) return reading.text;
    if (!reading.number) return {};
    switch (type_of(row)) {
        case DataType::int64: return static_cast<std::int64_t>(*reading.number);
        case DataType::uint64: return static_cast<std::uint64_t>(*reading.number);
        default: return *reading.number;
    }
}

// The defect with the largest peak, which is the first of the list.
struct Worst {
    MetricValue kind, m, n;
};
Worst worst_of(const StoredResult& result) {
    const auto list = nlohmann::json::parse(result.defects, nullptr, false);
    if (!list.is_array() || list.empty() || !list[0].is_object()) return {};
    // Members of another type are of a row that somebody edited.
    const auto& worst = list[0];
    const auto number = [&](const char* name) {
        return worst.contains(name) && worst[name].is_number() ? worst[name].get<double>() : 0.0;
    };
    const bool named = worst.contains("kind") && worst["kind"].is_string();
    return {named ? worst["kind"].get<std::string>() : std::string(), number("m"), number("n")};
}

std::uint64_t natural(std::int64_t value) { return static_cast<std::uint64_t>(std::max<std::int64_t>(value, 0)); }

}  // namespace

std::vector<BlockId> published_blocks() {
    return {BlockId::ident, BlockId::status, BlockId::counters, BlockId::recipe, BlockId::health, BlockId::calibration};
}

std::vector<Metric> station_metrics(const std::vector<Reading>& readings) {
    std::map<const Register*, const Reading*> known;
    for (const Reading& reading : readings) known[reading.what] = &reading;
    std::vector<Metric> metrics;
    for (const BlockId id : published_blocks()) {
        const Block& block = *find_block(id);
        for (const Register& row : block.registers) {
            if (is_noise(row)) continue;
            const auto at = known.find(&row);
            metrics.push_back({.name = fmt::format("Station/{}/{}", block.name, row.name),
                               .alias = row.address,
                               .type = type_of(row),
                               .value = at != known.end() ? value_of(row, *at->second) : MetricValue(),
                               .unit = std::string(row.unit)});
        }
    }
    return metrics;
}

std::vector<Metric> result_metrics(const StoredResult* result, const std::string& store_id, bool historical) {
    std::vector<Metric> metrics;
    const auto add = [&](const char* name, DataType type, const char* unit, MetricValue value) {
        const std::uint64_t alias = kResultAlias + metrics.size();
        if (result == nullptr) {
            metrics.push_back({.name = std::string("Result/") + name, .alias = alias, .type = type, .unit = unit});
        } else {
            metrics.push_back({.alias = alias,
                               .time_ms = result->time_us / 1000,
                               .historical = historical,
                               .value = std::move(value)});
        }
    };
    static const StoredResult kNone;
    const StoredResult& r = result != nullptr ? *result : kNone;
    const Worst worst = worst_of(r);
    // Only append: the position is the alias.
    add("Number", DataType::uint64, "", natural(r.number));
    add("Store", DataType::text, "", store_id);
    add("Time", DataType::int64, "us", r.time_us);
    add("Boot", DataType::uint64, "", std::uint64_t{r.boot});
    add("Sequence", DataType::uint64, "", std::uint64_t{r.sequence});
    add("Part", DataType::uint64, "", std::uint64_t{r.part});
    add("Verdict", DataType::text, "", r.verdict);
    add("Reason", DataType::text, "", r.reason);
    add("Score", DataType::real, "", r.score ? MetricValue(*r.score) : MetricValue());
    add("Defects", DataType::uint64, "", natural(r.defect_count));
    add("Worst Kind", DataType::text, "", worst.kind);
    add("Worst M", DataType::real, "lenslets", worst.m);
    add("Worst N", DataType::real, "lenslets", worst.n);
    add("Rejection", DataType::text, "", r.reject);
    add("Latency", DataType::uint64, "us", natural(r.latency_us));
    add("Reject Latency", DataType::uint64, "us",
        r.reject_latency_us == 0 ? MetricValue() : MetricValue(natural(r.reject_latency_us)));
    add("Recipe", DataType::text, "", r.recipe);
    add("Bounded", DataType::boolean, "", r.bounded ? MetricValue(*r.bounded) : MetricValue());
    add("Damage", DataType::text, "", r.damage);
    return metrics;
}

}  // namespace hord::firmware::mqtt
