// JSON text in the format of the store (nlohmann-json): keys in the order of insertion.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

namespace hord::firmware::store {

using Json = nlohmann::ordered_json;

// One line for indent -1, otherwise `indent` blanks a level. Bytes that are not UTF-8 become U+FFFD.
inline std::string to_text(const Json& json, int indent = -1) {
    return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

// Reads what a row of a store holds, which somebody may have edited. Discarded (is_discarded()) for a text that is no
// JSON, and for one that is nested more deeply than a store's: a recursive reader must not exhaust its stack.
Json parse_stored(const std::string& text);

// Members of an object. None: `json` is no object, has no such member, or one of another type.
std::optional<std::int64_t> integer_in(const Json& json, const char* name);
std::optional<std::string> text_in(const Json& json, const char* name);

// One line, each number that is not whole written with the shortest digits of a float: 0.1 and 40. These are the digits
// in every store and archive. nlohmann-json would write those of a double, 0.10000000149011612 and 40.0, and its digits
// are not always the shortest.
std::string to_line(const Json& json);

}  // namespace hord::firmware::store
