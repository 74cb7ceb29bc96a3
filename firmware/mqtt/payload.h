// Sparkplug B payloads as bytes (sparkplug_b.proto): encodes what a station publishes, decodes the commands it
// receives. docs/adr/0006-sparkplug-payload-by-hand.md: why not libprotobuf.
//
// Integers of every width are sent as Int64 or UInt64: readers disagree on the fields of shorter ones. Pure functions;
// any thread.
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
};

// monostate: null. This type, not DataType, selects the protobuf field.
using MetricValue = std::variant<std::monostate, bool, std::int64_t, std::uint64_t, double, std::string>;

struct Metric {
    std::string name = {};  // empty: left out, the alias names the metric
    std::optional<std::uint64_t> alias = {};
    std::optional<UtcMs> time_ms = {};
    DataType type = DataType::none;
    bool historical = false;
    MetricValue value = {};
    std::string unit = {};  // property engUnit; empty: none
    bool operator==(const Metric&) const = default;
};

struct Payload {
    std::optional<UtcMs> time_ms;
    std::vector<Metric> metrics;
    std::optional<std::uint8_t> seq;
    bool operator==(const Payload&) const = default;
};

std::string encode(const Payload& payload);

// Limits for commands, which any client of the broker may send: checked before anything is copied.
constexpr std::size_t kMaxCommandBytes = 4096, kMaxCommandMetrics = 32;

// Skips unknown fields; reads values of other types as null. Fails with unreadable (truncated, no protobuf, too large,
// too many metrics). Never reads outside `bytes`, never allocates more than their size.
Result<Payload> decode_command(std::string_view bytes);

}  // namespace hord::firmware::mqtt
