// Helpers to write a row of the register map. Only for station_blocks.h and plc_blocks.h.
#pragma once

#include <array>

#include "firmware/core/enum_values.h"
#include "firmware/registers/register_map.h"

namespace hord::firmware::rows {

using Source = RegisterValues;
using Type = RegisterType;
using Number = std::optional<double>;

// Every value of E with its name_of().
template <class E>
inline constexpr auto kNamesOf = [] {
    std::array<NamedValue, kValuesOf<E>.size()> names{};
    for (std::size_t k = 0; k < names.size(); ++k) {
        names[k] = {static_cast<std::uint32_t>(kValuesOf<E>[k]), name_of(kValuesOf<E>[k])};
    }
    return names;
}();

constexpr Register number(std::uint16_t address, Type type, std::string_view name, std::string_view unit,
                          std::string_view meaning, Number (*read)(const Source&),
                          std::span<const NamedValue> values = {}, double scale = 1) {
    const bool two = type == Type::u32 || type == Type::s32 || type == Type::bits32;
    return {.address = address,
            .type = type,
            .words = static_cast<std::uint16_t>(two ? 2 : 1),
            .name = name,
            .unit = unit,
            .scale = scale,
            .meaning = meaning,
            .values = values,
            .number = read};
}
constexpr Register text(std::uint16_t address, std::uint16_t words, std::string_view name, std::string_view meaning,
                        std::string_view (*read)(const Source&)) {
    return {.address = address, .type = Type::text, .words = words, .name = name, .meaning = meaning, .text = read};
}
constexpr Register writable(Register row) {
    row.access = RegisterAccess::read_write;
    return row;
}
constexpr Register nullable(Register row) {
    row.nullable = true;
    return row;
}

// Converts an optional of any number type to the encoder's type.
template <class T>
Number maybe(const std::optional<T>& value) {
    return value ? Number{static_cast<double>(*value)} : Number{};
}
// The value of most rows: a member of one of the source's structs, given as a pointer to member.
template <auto member>
Number snapshot(const Source& s) {
    return static_cast<double>(s.snapshot.*member);
}
template <auto member>
Number counter(const Source& s) {
    return s.snapshot.counters.*member;
}
template <auto member>
Number health(const Source& s) {
    return maybe(s.extras.health.*member);
}
template <auto member>
Number optics(const Source& s) {
    return maybe(s.extras.health.optics.*member);
}
template <auto member>
Number statistic(const Source& s) {
    return maybe(s.extras.statistics.*member);
}
template <auto member>
Number calibration(const Source& s) {
    return maybe(s.extras.calibration.*member);
}

// A value computed from the PlcView; not available without a PLC interface.
template <class F>
Number from_plc(const Source& s, F read) {
    return s.extras.plc ? Number{static_cast<double>(read(*s.extras.plc))} : Number{};
}
// A member of the PlcView, or a member of one: plc<&PlcView::reply, &CommandReply::state>.
template <auto member>
Number plc(const Source& s) {
    return from_plc(s, [](const PlcView& view) { return view.*member; });
}
template <auto part, auto member>
Number plc(const Source& s) {
    return from_plc(s, [](const PlcView& view) { return view.*part.*member; });
}
// The same for bit sets and checksums, which are always available: 0 without a PLC interface.
template <auto... path>
Number plc_bits(const Source& s) {
    return plc<path...>(s).value_or(0);
}

}  // namespace hord::firmware::rows
