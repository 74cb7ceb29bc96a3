// Sparkplug B payloads as bytes (sparkplug_b.proto): written for what a station sends, read for the commands that it is
// sent.
//
// Integers of every width travel as Int64 or UInt64, about whose field no two readers disagree. Pure functions; any
// thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "common/result.h"

namespace hord::firmware::mqtt {

using UtcMs = std::int64_t;  // milliseconds since 1970-01-01T00:00:00 UTC

// Numbers of the specification. `none`: left out.
enum class DataType : std::uint32_t {
    none = 0,
    int64 = 4,
    uint64 = 8,
    real = 10,
    boolean = 11,
    text = 12,
    date_time = 13
};

// monostate: null. Which field it travels in follows from the type here, not from DataType.
using MetricValue = std::variant<std::monostate, bool, std::int64_t, std::uint64_t, double, std::string>;

struct Metric {
    std::string name;  // empty: left out, the alias says which
    std::optional<std::uint64_t> alias;
    std::optional<UtcMs> time_ms;
    DataType type = DataType::none;
    bool historical = false;
    MetricValue value;
    std::string unit;  // property engUnit; empty: none
    bool operator==(const Metric&) const = default;
};

struct Payload {
    std::optional<UtcMs> time_ms;
    std::vector<Metric> metrics;
    std::optional<std::uint8_t> seq;
    bool operator==(const Payload&) const = default;
};

std::string encode(const Payload& payload);

// What a stranger may send: bytes beyond these are refused before anything is copied.
constexpr std::size_t kMaxCommandBytes = 4096, kMaxCommandMetrics = 32;

// Fields that a station does not know are skipped, values of other kinds read as null. Fails with unreadable (cut off,
// no protobuf, too large, too many metrics); never reads outside `bytes`, never allocates more than they hold.
Result<Payload> decode_command(std::string_view bytes);

}  // namespace hord::firmware::mqtt
