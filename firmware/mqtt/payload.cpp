#include "firmware/mqtt/payload.h"

#include <bit>
#include <cstring>
#include <string>

namespace hord::firmware::mqtt {
namespace {

// Protobuf's wire types: a field is a key (number and wire type) and a value.
enum class Wire : std::uint8_t { varint = 0, eight_bytes = 1, length = 2, four_bytes = 5 };

// Field numbers of sparkplug_b.proto.
enum PayloadField : std::uint32_t { kPayloadTime = 1, kPayloadMetrics = 2, kPayloadSeq = 3 };
enum MetricField : std::uint32_t {
    kName = 1,
    kAlias = 2,
    kTime = 3,
    kDataType = 4,
    kHistorical = 5,
    kNull = 7,
    kProperties = 9,
    kInt = 10,
    kLong = 11,
    kFloat = 12,
    kDouble = 13,
    kBoolean = 14,
    kString = 15,
};
enum PropertyField : std::uint32_t { kKeys = 1, kValues = 2, kPropertyType = 1, kPropertyString = 8 };

// -- writing

void put_varint(std::string& out, std::uint64_t value) {
    while (value >= 0x80) {
        out += static_cast<char>(value | 0x80);
        value >>= 7;
    }
    out += static_cast<char>(value);
}
void put_key(std::string& out, std::uint32_t field, Wire wire) {
    put_varint(out, field << 3U | static_cast<std::uint32_t>(wire));
}
void put(std::string& out, std::uint32_t field, std::uint64_t value) {
    put_key(out, field, Wire::varint);
    put_varint(out, value);
}
void put(std::string& out, std::uint32_t field, std::string_view bytes) {
    put_key(out, field, Wire::length);
    put_varint(out, bytes.size());
    out += bytes;
}
void put(std::string& out, std::uint32_t field, double value) {
    put_key(out, field, Wire::eight_bytes);
    const auto bits = std::bit_cast<std::uint64_t>(value);
    for (unsigned byte = 0; byte < 8; ++byte) out += static_cast<char>(bits >> 8U * byte);
}

void put_value(std::string& out, const MetricValue& value) {
    if (std::holds_alternative<std::monostate>(value)) put(out, kNull, std::uint64_t{1});
    else if (const auto* truth = std::get_if<bool>(&value)) put(out, kBoolean, std::uint64_t{*truth ? 1U : 0U});
    else if (const auto* whole = std::get_if<std::int64_t>(&value)) put(out, kLong, static_cast<std::uint64_t>(*whole));
    else if (const auto* natural = std::get_if<std::uint64_t>(&value)) put(out, kLong, *natural);
    else if (const auto* real = std::get_if<double>(&value)) put(out, kDouble, *real);
    else put(out, kString, std::string_view(std::get<std::string>(value)));
}

std::string encode_metric(const Metric& metric) {
    std::string out;
    if (!metric.name.empty()) put(out, kName, std::string_view(metric.name));
    if (metric.alias) put(out, kAlias, *metric.alias);
    if (metric.time_ms) put(out, kTime, static_cast<std::uint64_t>(*metric.time_ms));
    if (metric.type != DataType::none) put(out, kDataType, std::uint64_t{static_cast<std::uint32_t>(metric.type)});
    if (metric.historical) put(out, kHistorical, std::uint64_t{1});
    if (!metric.unit.empty()) {
        std::string value, properties;
        put(value, kPropertyType, std::uint64_t{static_cast<std::uint32_t>(DataType::text)});
        put(value, kPropertyString, std::string_view(metric.unit));
        put(properties, kKeys, std::string_view("engUnit"));
        put(properties, kValues, std::string_view(value));
        put(out, kProperties, std::string_view(properties));
    }
    put_value(out, metric.value);
    return out;
}

// -- reading

struct Field {
    std::uint32_t number = 0;
    Wire wire = Wire::varint;
    std::uint64_t value = 0;      // of all but length
    std::string_view bytes = {};  // of length
};

// Parses fields one by one; `broken` when the bytes are no protobuf.
class Fields {
  public:
    explicit Fields(std::string_view bytes) : left_(bytes) {}
    [[nodiscard]] bool broken() const { return broken_; }

    std::optional<Field> next() {
        if (left_.empty() || broken_) return std::nullopt;
        const auto key = varint();
        if (!key || *key >> 3U == 0 || *key >> 3U > 0x1FFFFFFF) return give_up();
        Field field;
        field.number = static_cast<std::uint32_t>(*key >> 3U);
        field.wire = static_cast<Wire>(*key & 7U);
        switch (field.wire) {
            case Wire::varint: {
                const auto value = varint();
                if (!value) return give_up();
                field.value = *value;
                return field;
            }
            case Wire::eight_bytes: return fixed(field, 8);
            case Wire::four_bytes: return fixed(field, 4);
            case Wire::length: {
                const auto size = varint();
                if (!size || *size > left_.size()) return give_up();
                field.bytes = left_.substr(0, *size);
                left_.remove_prefix(*size);
                return field;
            }
        }
        return give_up();  // groups and undefined wire types
    }

  private:
    std::optional<Field> give_up() {
        broken_ = true;
        return std::nullopt;
    }
    std::optional<Field> fixed(Field field, std::size_t size) {
        if (left_.size() < size) return give_up();
        for (std::size_t byte = 0; byte < size; ++byte)
            field.value |= std::uint64_t{static_cast<std::uint8_t>(left_[byte])} << 8U * byte;
        left_.remove_prefix(size);
        return field;
    }
    std::optional<std::uint64_t> varint() {
        std::uint64_t value = 0;
        for (unsigned shift = 0; shift < 64; shift += 7) {
            if (left_.empty()) return std::nullopt;
            const auto byte = static_cast<std::uint8_t>(left_.front());
            left_.remove_prefix(1);
            if (shift == 63 && byte > 1) return std::nullopt;
            value |= std::uint64_t{byte & 0x7FU} << shift;
            if (byte < 0x80) return value;
        }
        return std::nullopt;
    }
    std::string_view left_;
    bool broken_ = false;
};

bool decode_metric(std::string_view bytes, Metric& metric) {
    Fields fields(bytes);
    while (const auto field = fields.next()) {
        const bool number = field->wire == Wire::varint, text = field->wire == Wire::length;
        if (field->number == kName && text) metric.name = field->bytes;
        else if (field->number == kAlias && number) metric.alias = field->value;
        else if (field->number == kTime && number) metric.time_ms = static_cast<UtcMs>(field->value);
        else if (field->number == kDataType && number)
            metric.type = static_cast<DataType>(static_cast<std::uint32_t>(field->value));
        else if (field->number == kHistorical && number) metric.historical = field->value != 0;
        else if ((field->number == kInt || field->number == kLong) && number) metric.value = field->value;
        else if (field->number == kDouble && field->wire == Wire::eight_bytes)
            metric.value = std::bit_cast<double>(field->value);
        else if (field->number == kFloat && field->wire == Wire::four_bytes)
            metric.value = static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(field->value)));
        else if (field->number == kBoolean && number) metric.value = field->value != 0;
        else if (field->number == kString && text) metric.value = std::string(field->bytes);
    }
    return !fields.broken();
}

}  // namespace

std::string encode(const Payload& payload) {
    std::string out;
    if (payload.time_ms) put(out, kPayloadTime, static_cast<std::uint64_t>(*payload.time_ms));
    for (const Metric& metric : payload.metrics) put(out, kPayloadMetrics, std::string_view(encode_metric(metric)));
    if (payload.seq) put(out, kPayloadSeq, std::uint64_t{*payload.seq});
    return out;
}

Result<Payload> decode_command(std::string_view bytes) {
    if (bytes.size() > kMaxCommandBytes) {
        return fail(ErrorCode::unreadable, "a command of more than " + std::to_string(kMaxCommandBytes) + " bytes",
                    "see who writes to the command topic");
    }
    const auto no_payload = [] {
        return fail(ErrorCode::unreadable, "a command that is no Sparkplug B payload",
                    "see who writes to the command topic");
    };
    Payload payload;
    Fields fields(bytes);
    while (const auto field = fields.next()) {
        if (field->number == kPayloadTime && field->wire == Wire::varint)
            payload.time_ms = static_cast<UtcMs>(field->value);
        else if (field->number == kPayloadSeq && field->wire == Wire::varint)
            payload.seq = static_cast<std::uint8_t>(field->value);
        else if (field->number == kPayloadMetrics && field->wire == Wire::length) {
            if (payload.metrics.size() == kMaxCommandMetrics) return no_payload();
            if (!decode_metric(field->bytes, payload.metrics.emplace_back())) return no_payload();
        }
    }
    if (fields.broken()) return no_payload();
    return payload;
}

}  // namespace hord::firmware::mqtt
