// Whole numbers of foreign JSON (nlohmann-json, which the including room links).
#pragma once

#include <concepts>
#include <cstdint>
#include <utility>

#include <nlohmann/json.hpp>

namespace hord::common {

using Json = nlohmann::ordered_json;

// The integer that `json` holds. Throws Json::exception where it holds none, or one that T cannot hold: get() converts
// these, and of a large number with a point or an exponent the result is undefined.
template <std::integral T>
T integer_of(const Json& json) {
    const bool fits = json.is_number_unsigned()
        ? std::in_range<T>(json.get<std::uint64_t>())
        : json.is_number_integer() && std::in_range<T>(json.get<std::int64_t>());
    if (!fits) throw Json::out_of_range::create(406, "no whole number in range", &json);
    return json.get<T>();
}
// That of a member; `otherwise` if there is none.
template <std::integral T>
T integer_of(const Json& json, const char* name, T otherwise) {
    return json.contains(name) ? integer_of<T>(json.at(name)) : otherwise;
}

}  // namespace hord::common
